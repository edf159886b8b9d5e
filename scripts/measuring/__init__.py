"""Modules that several scripts share: measurements, and the documents that hold their results."""
