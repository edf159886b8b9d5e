"""Numbers and names as text."""

from __future__ import annotations

# Names that some YAML parsers read as true, false or null.
YAML_WORDS = frozenset({"y", "n", "yes", "no", "on", "off", "true", "false", "null"})


def exact(number: float) -> str:
    """The shortest text from which exactly this number is read again.

    >>> exact(50.0), exact(12.5), exact(50.0000001), exact(1e-05)
    ('50', '12.5', '50.0000001', '1e-05')
    """
    return repr(float(number)).removesuffix(".0")


def counted(number: int, noun: str) -> str:
    """A number with the noun that it counts, which is in the singular after 1.

    >>> counted(1, "episode"), counted(10_000, "row")
    ('1 episode', '10,000 rows')
    """
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def yaml_name(name: str) -> str:
    """A name of a-z, 0-9, _ and - as YAML, quoted if some parser would not read it as text.

    YAML 1.1 and 1.2 disagree about numbers, dates and words. Of these names, only those that begin with a
    digit can be read as a number or a date.

    >>> yaml_name("train"), yaml_name("0x10"), yaml_name("no")
    ('train', '"0x10"', '"no"')
    """
    return f'"{name}"' if name[0].isdigit() or name in YAML_WORDS else name
