"""Checks of a finished dataset: its files, its metadata, its rows."""
