"""The exceptions that ibdata raises, with their messages and the exit codes of the command line."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

Loc = tuple[str | int, ...]  # the path of a value, by keys and indices

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


def hidden(text: str) -> str:
    """Return a text without the credentials of the URLs in it.

    >>> hidden("s3://KEY:SECRET@bucket/name?region=eu&session_token=abc: missing")
    's3://…@bucket/name?region=eu&session_token=…: missing'
    """
    return URL.sub(_without_credentials, text)


def _without_credentials(url: re.Match[str]) -> str:
    place, query = USER.sub(f"{HIDDEN}@", url["place"], count=1), url["query"] or ""
    return url["scheme"] + place + VALUE.sub(_without_value, query)


def _without_value(pair: re.Match[str]) -> str:
    return f"{pair[1]}={pair[2] if pair[1].lower() in OPEN_VALUES else HIDDEN}"


# An option as the command line spells it; commands, which are to be typed as they are, are passed over.
OPTION = re.compile(r"ibdata [a-z]+ [^;]*|(?<![\w=/-])--(?P<name>[a-z]+(?:-[a-z]+)*)(?P<colon>:?)")
SWITCHES = ("allow-code", "overwrite", "resume")


def in_python(message: str) -> str:
    """Name options as Python does.

    >>> in_python("data/x: exists already; choose another --out, or --overwrite to replace a dataset")
    'data/x: exists already; choose another out=…, or overwrite=True to replace a dataset'
    >>> in_python("--set steps=0: steps: found 0"), in_python("--shards: found 'a'")
    ('overrides: steps=0: steps: found 0', "shards: found 'a'")
    """
    return OPTION.sub(_keyword, message)


def _keyword(option: re.Match[str]) -> str:
    name = option["name"]
    if name is None:
        return option[0]
    if name == "set":
        return "overrides:"
    name = "names" if name == "name" else name  # of `split`
    value = ":" if option["colon"] else "=True" if name in SWITCHES else "=…"
    return name.replace("-", "_") + value


class IbdataError(ValueError):
    """Base class of ibdata's exceptions. Credentials in URLs are removed from the message.

    A message is written with the options of the command line, such as --overwrite, and the command line
    prints these. `str` gives the message with the arguments of Python, such as overwrite=True.
    """

    exit_code = 1

    def __init__(self, message: str = "") -> None:
        super().__init__(hidden(message))

    def __str__(self) -> str:
        return in_python(self.with_options)

    @property
    def with_options(self) -> str:
        """The message with the options of the command line."""
        return str(self.args[0])


class UsageError(IbdataError):
    """An argument (option, path or name) is invalid."""

    exit_code = 2


class MissingError(IbdataError, ImportError):
    """An optional library is not installed."""

    def __init__(self, what: str, library: str, extra: str) -> None:
        self.arguments = (what, library, extra)
        super().__init__(f"{what} needs the package {library}: pip install {library}, or 'ibdata[{extra}]'")

    def __reduce__(self) -> tuple[type[MissingError], tuple[str, str, str]]:
        return type(self), self.arguments


def printable(line: str) -> str:
    """Escape control characters, so that text from files cannot forge another line or a colour."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in line)


def excerpt(value: object, most: int = 60) -> str:
    """The beginning of a value's representation, in one line.

    >>> excerpt([[1, 2], [3, 4]], 8)
    '[[1, 2],'
    """
    return " ".join(repr(value).split())[:most]


def suggestion(word: str, known: Iterable[str]) -> str:
    """'; did you mean …?' if a known word is similar, else an empty text."""
    near = nearest(word, known)
    return "" if near in (None, word) else f"; did you mean {near!r}?"


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
        return type(self), (self.with_options.split("\n"),)  # pickled on the way back from a worker process


class DatasetError(IbdataError):
    """A folder holds no finished dataset, or a damaged one."""

    exit_code = 3


class BusyError(IbdataError):
    """Another process is writing to the output folder."""

    exit_code = 75


class Interrupted(IbdataError):
    """A signal stopped the command; the exit code is 128 plus the number of the signal."""

    def __init__(self, signal_number: int, left: str = "--resume continues from the complete shards") -> None:
        self.signal_number = signal_number
        self.left = left
        self.exit_code = 128 + signal_number
        super().__init__(f"stopped by signal {signal_number}; {left}")

    def __reduce__(self) -> tuple[type[Interrupted], tuple[int, str]]:
        return type(self), (self.signal_number, self.left)
