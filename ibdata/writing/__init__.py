"""Writing a dataset's columns and metadata to files."""
