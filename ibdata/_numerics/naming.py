"""Numbers and names as text."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from decimal import Decimal
from typing import Any

DIGITS = 6  # of the largest number of a column
FEWEST = 3  # of the smallest number of a column, but it alone makes no more than MOST decimals
MOST = 4
BY_HAND = 9  # digits up to which a number counts as written by hand, such as a setpoint, and is shown in full
PLAIN = (1e-6, 1e15)  # the largest number of a column that is written without an exponent
NAME_PATTERN = r"^[a-z0-9][a-z0-9_-]{0,63}$"  # of experiments, datasets, policies and splits
# Names that some YAML parsers read as true, false or null.
YAML_WORDS = frozenset({"y", "n", "yes", "no", "on", "off", "true", "false", "null"})


def exact(number: Any) -> str:
    """The shortest text from which exactly this number is read again; of a float32 of NumPy, as a float32.

    >>> exact(50.0), exact(12.5), exact(50.0000001), exact(1e-05)
    ('50', '12.5', '50.0000001', '1e-05')
    """
    return str(number if hasattr(number, "dtype") else float(number)).removesuffix(".0")


def decimal(number: Any) -> float:
    """The shortest decimal that is this number in its type: for the float32 nearest to 20.1, it is 20.1."""
    return float(exact(number))


def column_format(numbers: Sequence[float]) -> str:
    """A format for all numbers of a column, so that their decimals are equally many.

    >>> column_format([92 / 3, -2 / 3]), column_format([1e6 / 3, -2e4 / 3]), column_format([1e30])
    (',.4f', ',.0f', '.6g')
    >>> column_format([50.0, 12.5]), column_format([50.0, 50.0000001])
    (',.1f', ',.7f')
    """
    sizes = [abs(x) for x in numbers if x and math.isfinite(x)]
    if not sizes:
        return ",.0f"
    low, high = min(sizes), max(sizes)
    if not PLAIN[0] <= high < PLAIN[1]:
        return f".{DIGITS}g"
    written = [Decimal(f"{x:.12g}").normalize().as_tuple() for x in sizes]
    decimals = max(-int(number.exponent) for number in written)
    if max(decimals, *(len(number.digits) for number in written)) > BY_HAND:
        decimals = max(DIGITS - _magnitude(high), min(MOST, FEWEST - _magnitude(low)))
    return f",.{max(0, decimals)}f"


def _magnitude(size: float) -> int:
    return math.floor(math.log10(size)) + 1


def counted(number: int, noun: str) -> str:
    """A number with the noun that it counts, which is in the singular after 1.

    >>> counted(1, "episode"), counted(10_000, "row")
    ('1 episode', '10,000 rows')
    """
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def rows_in_episodes(rows: int, episodes: int) -> str:
    """Rows and episodes.

    >>> rows_in_episodes(10_000, 1)
    '10,000 rows in 1 episode'
    """
    return f"{counted(rows, 'row')} in {counted(episodes, 'episode')}"


def size(count: float) -> str:
    """A number of bytes.

    >>> size(791701)
    '0.8 MB'
    """
    for unit, scale in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if count >= scale / 10:
            return f"{count / scale:.1f} {unit}"
    return f"{count:.0f} bytes"


def yaml_name(name: str) -> str:
    """A name of a-z, 0-9, _ and - as YAML, quoted if some parser would not read it as text.

    YAML 1.1 and 1.2 disagree about numbers, dates and words. Of these names, only those that begin with a
    digit can be read as a number or a date.

    >>> yaml_name("train"), yaml_name("0x10"), yaml_name("no")
    ('train', '"0x10"', '"no"')
    """
    return f'"{name}"' if name[0].isdigit() or name in YAML_WORDS else name


def unequal(names: Iterable[str]) -> list[str]:
    """The same names, of which later equal ones get -2, -3, …

    >>> unequal(["a", "b", "a", "a"])
    ['a', 'b', 'a-2', 'a-3']
    """
    out: dict[str, None] = {}
    for name in names:
        label, count = name, 1
        while label in out:
            count += 1
            label = f"{name}-{count}"
        out[label] = None
    return list(out)
