"""Modules that the scripts beside this folder share: measurements, and documents that hold their results."""
