"""Finished datasets on disk: reading, naming and comparing them."""
