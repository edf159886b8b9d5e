"""A dataset that a caller has opened already, or names by its place."""

from __future__ import annotations

import os

from ibdata.dataset.reader import Dataset

Place = Dataset | str | os.PathLike[str]


def opened(place: Place) -> Dataset:
    """Return a dataset as it is, or open the one in a folder or at a URL."""
    return place if isinstance(place, Dataset) else Dataset(place)
