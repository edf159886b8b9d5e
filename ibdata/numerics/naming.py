"""Numbers and names as text for people and for other programs."""

from __future__ import annotations

# Possible names that some YAML parsers read as true, false or null.
YAML_WORDS = frozenset({"y", "n", "yes", "no", "on", "off", "true", "false", "null"})


def exact(number: float) -> str:
    """The shortest text from which exactly this number is read again.

    >>> exact(50.0), exact(12.5), exact(50.0000001), exact(1e-05)
    ('50', '12.5', '50.0000001', '1e-05')
    """
    return repr(float(number)).removesuffix(".0")


def yaml_name(name: str) -> str:
    """A name of a-z, 0-9, _ and - as YAML that every parser reads as that text; quoted only if necessary.

    YAML 1.1 and 1.2 disagree about numbers, dates and words. Among these names, all that could be read as a
    number or a date begin with a digit.

    >>> yaml_name("train"), yaml_name("0x10"), yaml_name("no")
    ('train', '"0x10"', '"no"')
    """
    return f'"{name}"' if name[0].isdigit() or name in YAML_WORDS else name
