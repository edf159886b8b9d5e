"""Measures of the quality of data from the literature, each a function."""
