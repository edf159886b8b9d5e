"""The version of ibdata."""

__version__ = "0.1.0"
