"""A dataset's columns and metadata, written to files."""
