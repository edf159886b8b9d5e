"""How many examples hypothesis tries, the same ones every time."""

from hypothesis import settings

from helpers.levels import EXAMPLES


def tries(full: int) -> settings:
    """So many at full size, and fewer where the tests are small."""
    return settings(derandomize=True, deadline=None, max_examples=full // EXAMPLES)
