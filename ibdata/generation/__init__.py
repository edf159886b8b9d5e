"""Generating the dataset of an experiment in a folder."""
