"""Episodes of an experiment, simulated into columns."""
