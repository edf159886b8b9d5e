"""The version of ibdata."""

__version__ = "0.9.0"
