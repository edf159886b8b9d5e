"""The parts of docs/ that follow from the sources: options, columns, errors, the Python API."""
