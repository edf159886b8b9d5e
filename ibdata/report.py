"""The report of a dataset under its earlier name; `ibdata.maintenance.card` makes it."""

from ibdata.maintenance.card import card

__all__ = ["card"]
