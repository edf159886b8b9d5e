"""How numbers and names are written where somebody, or another program, reads them."""

from __future__ import annotations

# What some reader of YAML takes for true, false or nothing, of the names that are possible here.
YAML_WORDS = frozenset({"y", "n", "yes", "no", "on", "off", "true", "false", "null"})


def exact(number: float) -> str:
    """The shortest text that is this number and no other.

    >>> exact(50.0), exact(12.5), exact(50.0000001), exact(1e-05)
    ('50', '12.5', '50.0000001', '1e-05')
    """
    return repr(float(number)).removesuffix(".0")


def yaml_name(name: str) -> str:
    """A name of a-z, 0-9, _ and - as YAML in which every reader finds that text; quoted only if need be.

    YAML 1.1 and 1.2 disagree about numbers, dates and words, but each number and each date that such a name
    could be begins with a digit.

    >>> yaml_name("train"), yaml_name("0x10"), yaml_name("no")
    ('train', '"0x10"', '"no"')
    """
    return f'"{name}"' if name[0].isdigit() or name in YAML_WORDS else name
