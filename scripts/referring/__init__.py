"""Pages of docs/ that follow from the sources: commands, columns, errors, the Python API."""

NOTE = "<!-- scripts/reference writes this page -->\n"
