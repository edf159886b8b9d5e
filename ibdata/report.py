"""A dataset's card and report: `ibdata.report.card`."""

from ibdata.maintenance.card import card

__all__ = ["card"]
