"""Splitting, merging, repairing, reproducing and documenting finished datasets."""
