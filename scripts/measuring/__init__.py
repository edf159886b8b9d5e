"""Modules that scripts/ and studies/ share: measurements, and the documents that hold their results."""
