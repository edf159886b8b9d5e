"""Splits that many tests make."""


def by_policy(*labels):
    """A split for each policy."""
    return {label: {"policy": label} for label in labels}


BY_POLICY = by_policy("random", "safe")
HALVES = {"train": {"episodes": "first 50%"}, "test": {"episodes": "last 50%"}}
