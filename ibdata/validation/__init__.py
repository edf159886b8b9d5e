"""Checks of the files, metadata and rows of a finished dataset."""
