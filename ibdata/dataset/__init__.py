"""Datasets on disk: writing, naming and reading them."""
