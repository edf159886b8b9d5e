"""Strict YAML: plain data only, with the line and column of every key and value.

Anchors, aliases, merge keys, tags, repeated keys and a second document are errors. A plain scalar is `true`,
`false`, `null`, a decimal number as in JSON, or else text.
"""

from __future__ import annotations

import re
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    DocumentStartEvent,
    Event,
    ScalarEvent,
    SequenceStartEvent,
)
from ruamel.yaml.reader import ReaderError

from ibdata.errors import Loc

MAX_DEPTH = 20  # far below the depth at which the recursion of Python ends

INT = re.compile(r"[-+]?[0-9]+")
FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
WORDS = {"true": True, "false": False, "null": None, "~": None, "": None}

Position = tuple[int, int]  # line and column, which count from 1


class StrictYamlError(ValueError):
    """The text is not strict YAML. Its line and column count from 1."""

    def __init__(self, line: int, column: int, message: str) -> None:
        self.line, self.column, self.message = line, column, message
        super().__init__(f"{line}:{column}: {message}")


class Document:
    """Plain data with the positions (line, column) of its keys and values, by path. Both count from 1."""

    def __init__(self, text: str | bytes) -> None:
        self.keys: dict[Loc, Position] = {}
        self.values: dict[Loc, Position] = {}
        self.data: Any = None
        decoded = _decoded(text)
        self._events = YAML(typ="safe", pure=True).parse(decoded)
        try:
            self._read()
        except MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            position = _position(mark) if mark else (1, 1)
            raise StrictYamlError(*position, f"not valid YAML: {error.problem or error.context}") from None
        except ReaderError as error:
            line = decoded.count("\n", 0, error.position) + 1
            raise StrictYamlError(line, 1, f"not valid YAML: {str(error).splitlines()[0]}") from None
        except StrictYamlError:
            raise
        except (YAMLError, ValueError, RecursionError) as error:
            raise StrictYamlError(1, 1, f"not valid YAML: {str(error).splitlines()[0]}") from None

    def position(self, loc: Loc, key: bool) -> Position:
        """Return line and column of the value (or key) at a path, or of its nearest parent that exists."""
        if key and loc in self.keys:
            return self.keys[loc]
        while loc and loc not in self.values:
            loc = loc[:-1]
        return self.values.get(loc, (1, 1))

    def _read(self) -> None:
        documents = 0
        for event in self._events:
            if isinstance(event, DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise StrictYamlError(
                        *_position(event.start_mark),
                        "found a second document, expected a single document; remove what follows ---",
                    )
                self.data = self._value(next(self._events), ())

    def _value(self, event: Event, loc: Loc) -> Any:
        """The value that begins with an event, at a path."""
        position = _position(event.start_mark)
        _refuse_more_than_data(event, position)
        if len(loc) >= MAX_DEPTH and not isinstance(event, ScalarEvent):
            raise StrictYamlError(
                *position, f"found more than {MAX_DEPTH} levels, expected at most {MAX_DEPTH}"
            )
        if isinstance(event, ScalarEvent):
            if event.style is None and event.value == "":
                # For an omitted value, the parser gives the position of the next token.
                position = self.keys.get(loc, position)
            self.values[loc] = position
            return scalar(event.value) if event.style is None else event.value
        self.values[loc] = position
        if not isinstance(event, SequenceStartEvent):
            return self._mapping(loc)
        items: list[Any] = []
        while not isinstance(event := next(self._events), CollectionEndEvent):
            items.append(self._value(event, (*loc, len(items))))
        return items

    def _mapping(self, loc: Loc) -> dict[str, Any]:
        mapping: dict[str, Any] = {}
        while not isinstance(event := next(self._events), CollectionEndEvent):
            position = _position(event.start_mark)
            _refuse_more_than_data(event, position)
            if not isinstance(event, ScalarEvent):
                raise StrictYamlError(*position, "found a list or mapping as a key, expected text")
            if event.value in mapping:
                raise StrictYamlError(*position, f"{event.value}: found twice, expected once")
            self.keys[(*loc, event.value)] = position
            mapping[event.value] = self._value(next(self._events), (*loc, event.value))
        return mapping


def _refuse_more_than_data(event: Event, position: Position) -> None:
    """Raise StrictYamlError if an event is more than plain data."""
    if isinstance(event, AliasEvent) or getattr(event, "anchor", None):
        raise StrictYamlError(*position, "found an anchor or alias, expected plain data")
    if tag := getattr(event, "tag", None):
        raise StrictYamlError(*position, f"found the tag {tag}, expected plain data")
    if isinstance(event, ScalarEvent) and event.value == "<<" and event.style is None:
        raise StrictYamlError(*position, "found a merge key, expected plain data")


def scalar(text: str) -> bool | int | float | str | None:
    """The value of a plain scalar.

    >>> scalar("1e3"), scalar("010"), scalar("on"), scalar("12:30"), scalar("true")
    (1000.0, 10, 'on', '12:30', True)
    """
    if text in WORDS:
        return WORDS[text]
    if INT.fullmatch(text):
        return int(text)
    if FLOAT.fullmatch(text):
        return float(text)
    return text


def _position(mark: Any) -> Position:
    """Line and column of a mark of the parser."""
    return mark.line + 1, mark.column + 1


def _decoded(text: str | bytes) -> str:
    """The text, decoded from UTF-8."""
    if isinstance(text, str):
        return text
    try:
        return text.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = text[: error.start].count(b"\n") + 1
        raise StrictYamlError(line, 1, "found bytes that are not UTF-8, expected UTF-8 text") from None
