"""Learning to allocate: worlds, the environment, networks, training, evaluation. Decides on quantised costs only."""
