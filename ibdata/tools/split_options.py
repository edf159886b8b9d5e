"""The ways to split a dataset and the options of each. The command line reads them without the library.

A way is one of `ibdata.experiment.split_schemes.SCHEMES`, whose arguments are its options.
"""

from __future__ import annotations

from collections.abc import Iterable

from ibdata.errors import UsageError

SCHEMES = {
    "transfer": ("source", "target", "shots", "transitions"),
    "leave-one-out": (),
    "interpolation": (),
    "extrapolation": (),
    "distance": ("source", "within"),
}
DEFAULT_SCHEME = "transfer"
OPTIONS = {
    "setpoint": ("scheme", *dict.fromkeys(option for options in SCHEMES.values() for option in options)),
    "episode": ("fractions",),
    "policy": (),
}


def refuse_unused(options: Iterable[str], by: str, scheme: str) -> None:
    """Raise UsageError for a given option that the way to split does not use."""
    way, used = f"a split by {by}", OPTIONS[by]
    if by == "setpoint":
        way, used = f"the scheme {scheme}", ("scheme", *SCHEMES[scheme])
    for option in options:
        if option not in used:
            known = [f"--{name}" for name in used if name != "scheme"]
            raise UsageError(f"split: found --{option}, but {way} uses {_only(known)}")


def _only(options: list[str]) -> str:
    return f"only {', '.join(options)}" if options else "no other option"
