"""Write a dataset's card and report with `ibdata.report.card`."""

from ibdata.maintenance.card import card

__all__ = ["card"]
