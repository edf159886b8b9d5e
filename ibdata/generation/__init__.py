"""From an experiment to a folder that holds its dataset."""
