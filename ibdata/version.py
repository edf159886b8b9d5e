"""The version of ibdata."""

__version__ = "0.9.0"
DATE = "2026-11-26"  # of this version
