"""The exceptions that ibdata raises, with their messages and the exit codes of the command line."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Sequence
from signal import SIGINT

Loc = tuple[str | int, ...]  # the path of a value, by keys and indices

# Around what a message says in Python and at the command line. Unicode keeps these two from being text.
PARAMETER = re.compile("\ufdd0([^\ufdd0]*)\ufdd1([^\ufdd0]*)\ufdd0")
at_command_line = False  # whether messages are in the words of the command line


def parameter(name: str, value: str = "") -> str:
    """A parameter in a message: its name, with a value in Python, and at the command line the option.

    >>> str(UsageError(f"data/x: exists already; {OVERWRITE} to replace it"))
    'data/x: exists already; overwrite=True to replace it'
    """
    return f"\ufdd0{name}{value}\ufdd1--{name.replace('_', '-')}\ufdd0"


OUT, SHARDS, SPLIT, WORKERS = map(parameter, ("out", "shards", "split", "workers"))
OVERWRITE, ALLOW_CODE = parameter("overwrite", "=True"), parameter("allow_code", "=True")


def _worded(message: str) -> str:
    """A message in the words of Python, or of the command line."""
    return PARAMETER.sub(r"\2" if at_command_line else r"\1", message)


URL = re.compile(
    r"(?P<scheme>[a-z][a-z0-9+.-]{1,30}:/{1,2})"  # a single slash if the URL was treated as a path
    r"(?P<place>[^\s?#'\"]*)"
    r"(?P<query>\?[^\s'\"]*[^\s'\":,;])?",
    re.IGNORECASE,
)
USER = re.compile(r"^(?:[^/]*@|[^/]*:(?![0-9]*(?:/|$)).*@)")  # a secret may contain an unescaped /
VALUE = re.compile(r"([^?&;=]+)=([^&;]*)")
HIDDEN = "…"
# Parameters of a query whose values are shown; any other value may be a secret.
OPEN_VALUES = ("region", "scheme", "endpoint_override")


def public_url(text: str) -> str:
    """Return a text without the credentials of the URLs in it.

    >>> public_url("s3://KEY:SECRET@bucket/name?region=eu&session_token=abc: missing")
    's3://…@bucket/name?region=eu&session_token=…: missing'
    """
    return URL.sub(_public_url, text)


def _public_url(url: re.Match[str]) -> str:
    place, query = USER.sub(f"{HIDDEN}@", url["place"], count=1), url["query"] or ""
    return url["scheme"] + place + VALUE.sub(_without_value, query)


def _without_value(pair: re.Match[str]) -> str:
    return f"{pair[1]}={pair[2] if pair[1].lower() in OPEN_VALUES else HIDDEN}"


class IbdataError(ValueError):
    """Base class of ibdata's exceptions. Credentials in URLs are removed from the message.

    A message names a parameter as Python does, and at the command line the option.
    """

    exit_code = 1

    def __init__(self, message: str = "") -> None:
        self._message = public_url(message)  # which may be made in a process and shown by another
        super().__init__(_worded(self._message))

    def __str__(self) -> str:
        return _worded(self._message)


class UsageError(IbdataError):
    """An argument (option, path or name) is invalid."""

    exit_code = 2


class ArgumentError(UsageError, TypeError):
    """An argument has an unknown name or another type; as a `TypeError`, it is what Python raises then."""


class PolicyError(IbdataError):
    """A policy cannot be loaded, raised an exception, or returned no valid action or log density."""


class _MissingError(IbdataError, ImportError):
    """An optional library is not installed; as an `ImportError`, it is what a failed import raises."""


def missing(what: str, library: str, extra: str) -> IbdataError:
    """The error, also an ImportError, for an optional library that is not installed."""
    return _MissingError(f"{what} needs the package {library}: pip install {library}, or 'ibdata[{extra}]'")


def printable(line: str) -> str:
    """Escape control characters, so that text from files cannot forge another line or a colour."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)


def notice(line: str, prefix: str = "ibdata: ") -> None:
    """Print a line on stderr, without control characters and the credentials of URLs."""
    print(f"{prefix}{printable(public_url(_worded(line)))}", file=sys.stderr, flush=True)


def reason(error: BaseException) -> str:
    """What an error says, in one line without credentials."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    line = public_url((text.splitlines() or [""])[0])  # hides credentials before the line is cut
    return (printable(line) or type(error).__name__)[:300]


def excerpt(value: object, most: int = 60) -> str:
    """The beginning of a value's representation, in one line.

    >>> excerpt([[1, 2], [3, 4]], 8)
    '[[1, 2],'
    """
    shape = getattr(value, "shape", ())
    return f"{f'shape {shape}: ' if shape else ''}{' '.join(repr(value).split())}"[:most]


def suggestion(word: str, known: Iterable[str]) -> str:
    """'; did you mean …?' if a known word is similar, else an empty text."""
    near = nearest(word, known)
    return "" if near in (None, word) else f"; did you mean {near!r}?"


def meant(word: str, known: Iterable[str]) -> str:
    """'; did you mean …?' if a known word is similar, else ', expected …' with the known words."""
    known = list(known)
    one_of = "one of " if len(known) > 1 else ""
    return suggestion(word, known) or f", expected {one_of}{', '.join(known)}"


def nearest(word: str, known: Iterable[str]) -> str | None:
    """The known word that is most similar to a word; None if none is similar."""
    import difflib

    return next(iter(difflib.get_close_matches(word, list(known), n=1)), None)


def is_thread_limit(error: BaseException) -> bool:
    """Whether an error says, in Python's words, that the system starts no more threads."""
    return isinstance(error, RuntimeError) and str(error) == "can't start new thread"


class Problems(ValueError):
    """Several problems in one model, each with the path of its key relative to that model."""

    def __init__(self, found: list[tuple[Loc, str]]) -> None:
        self.found = found
        super().__init__("; ".join(f"{'.'.join(map(str, loc))}: {message}" for loc, message in found))


class ConfigError(UsageError):
    """An experiment is invalid; `problems` holds one line per problem."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(map(printable, problems)))

    @property
    def problems(self) -> tuple[str, ...]:
        """The lines of the message."""
        return tuple(str(self).split("\n"))

    def __reduce__(self) -> tuple[type[ConfigError], tuple[list[str]]]:
        return type(self), (str(self).split("\n"),)  # pickled on the way back from a worker process


class DatasetError(IbdataError):
    """A folder holds no finished dataset, or a damaged one."""

    exit_code = 3


class BusyError(IbdataError):
    """Another process is writing to the output folder."""

    exit_code = 75


class Interrupted(KeyboardInterrupt):
    """A signal asked to stop. It is no Exception, so that a loop over experiments stops too.

    Attributes:
        exit_code: 128 plus the number of the signal.
        left: What is left behind, in words.
    """

    def __init__(self, signal_number: int, left: str = "nothing unfinished is left behind") -> None:
        self.signal_number, self.left = signal_number, left
        self.exit_code = 128 + signal_number
        super().__init__(signal_number, left)

    def __str__(self) -> str:
        by = "Ctrl-C" if self.signal_number == SIGINT else f"signal {self.signal_number}"
        return f"stopped by {by}; {self.left}"
