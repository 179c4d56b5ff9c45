"""Learning to allocate: worlds, environment, networks, training, evaluation. Decides on quantised costs only."""
