"""A small dataset at a URL."""

from __future__ import annotations

import ibdata
from helpers.tiny import FOUR_SHARDS


def made(url, **options):
    return ibdata.generate(FOUR_SHARDS, url, workers=1, **options)
