"""hippomat-bench: what the parts of hippomat achieve, measured against the targets that they were given."""
