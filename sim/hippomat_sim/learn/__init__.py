"""Learning to allocate: worlds, environment, networks, training, evaluation. Knows quantised costs only."""
