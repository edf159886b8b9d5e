"""What a dataset of an experiment will be: its columns, its shards, its rows, and the code that may run."""
