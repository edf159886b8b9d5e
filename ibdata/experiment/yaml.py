"""Strict YAML: plain data only, with the line and column of every key and value.

Anchors, aliases, merge keys, tags, repeated keys, a second document and too deep or too large files are
errors. A plain scalar is `true`, `false`, `null`, a decimal number as in JSON, or else text.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import (
    AliasEvent,
    CollectionEndEvent,
    CollectionStartEvent,
    DocumentStartEvent,
    NodeEvent,
    ScalarEvent,
)
from ruamel.yaml.nodes import MappingNode, Node, ScalarNode, SequenceNode
from ruamel.yaml.reader import ReaderError

from ibdata.errors import Loc

MAX_BYTES = 2**20
MAX_DEPTH = 20
MAX_NODES = 100_000
MAX_DIGITS = 400

INT = re.compile(r"[-+]?[0-9]+")
FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
WORDS = {"true": True, "false": False, "null": None, "~": None, "": None}


class StrictYamlError(ValueError):
    """The text is not strict YAML. Its line and column count from 1."""

    def __init__(self, line: int, column: int, message: str) -> None:
        self.line, self.column, self.message = line, column, message
        super().__init__(f"{line}:{column}: {message}")


class Document:
    """Plain data with the places (line, column) of its keys and values by path; both count from 1."""

    def __init__(self, text: str | bytes) -> None:
        self.keys: dict[Loc, tuple[int, int]] = {}
        self.values: dict[Loc, tuple[int, int]] = {}
        self.data: Any = None
        decoded = _decoded(text)
        try:
            for _ in _checked_events(decoded):
                pass
            root = YAML(typ="safe", pure=True).compose(decoded)
        except MarkedYAMLError as error:
            mark = error.problem_mark or error.context_mark
            place = _place(mark) if mark else (1, 1)
            raise StrictYamlError(*place, f"not valid YAML: {error.problem or error.context}") from None
        except ReaderError as error:
            line = decoded.count("\n", 0, error.position) + 1
            raise StrictYamlError(line, 1, f"not valid YAML: {str(error).splitlines()[0]}") from None
        except (YAMLError, ValueError, RecursionError) as error:
            if isinstance(error, StrictYamlError):
                raise
            raise StrictYamlError(1, 1, f"not valid YAML: {str(error).splitlines()[0]}") from None
        if root is not None:
            self.data = self._plain(root, ())

    def place(self, loc: Loc, key: bool = False) -> tuple[int, int]:
        """Return line and column of the value (or key) at a path, or of its nearest parent that exists."""
        if key and loc in self.keys:
            return self.keys[loc]
        while loc and loc not in self.values:
            loc = loc[:-1]
        return self.values.get(loc, (1, 1))

    def _plain(self, node: Node, loc: Loc) -> Any:
        place = _place(node.start_mark)
        if isinstance(node, ScalarNode):
            if node.style is None and node.value == "":
                place = self.keys.get(loc, place)  # for an omitted value, the parser gives the next place
            self.values[loc] = place
            _encodable(node.value, place)
            return scalar(node.value) if node.style is None else node.value
        self.values[loc] = place
        if isinstance(node, SequenceNode):
            return [self._plain(child, (*loc, i)) for i, child in enumerate(node.value)]
        assert isinstance(node, MappingNode)
        out: dict[str, Any] = {}
        for key_node, child in node.value:
            place = _place(key_node.start_mark)
            if not isinstance(key_node, ScalarNode):
                raise StrictYamlError(*place, "found a list or mapping as a key, expected text")
            key = key_node.value
            _encodable(key, place)
            if key in out:
                raise StrictYamlError(*place, f"{key}: found twice, expected once")
            self.keys[(*loc, key)] = place
            out[key] = self._plain(child, (*loc, key))
        return out


def _encodable(text: str, place: tuple[int, int]) -> None:
    try:
        text.encode()
    except UnicodeEncodeError:
        raise StrictYamlError(*place, "found half of a character, expected Unicode text") from None


def scalar(text: str) -> bool | int | float | str | None:
    """The value of a plain scalar.

    >>> scalar("1e3"), scalar("010"), scalar("on"), scalar("12:30"), scalar("true")
    (1000.0, 10, 'on', '12:30', True)
    """
    if text in WORDS:
        return WORDS[text]
    if len(text) <= MAX_DIGITS and INT.fullmatch(text):
        return int(text)
    if len(text) <= MAX_DIGITS and FLOAT.fullmatch(text):
        return float(text)
    return text


def _place(mark: Any) -> tuple[int, int]:
    return mark.line + 1, mark.column + 1


def _decoded(text: str | bytes) -> str:
    if len(text) > MAX_BYTES:
        raise StrictYamlError(1, 1, f"found more than {MAX_BYTES} bytes, expected at most so many")
    if isinstance(text, str):
        return text
    try:
        return text.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = text[: error.start].count(b"\n") + 1
        raise StrictYamlError(line, 1, "found bytes that are not UTF-8, expected UTF-8 text") from None


def _checked_events(text: str) -> Iterator[None]:
    depth = nodes = documents = 0
    for event in YAML(typ="safe", pure=True).parse(text):
        place = _place(event.start_mark)
        nodes += isinstance(event, NodeEvent)
        depth += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
        documents += isinstance(event, DocumentStartEvent)
        if isinstance(event, AliasEvent) or getattr(event, "anchor", None):
            raise StrictYamlError(*place, "found an anchor or alias, expected plain data")
        if getattr(event, "tag", None):
            raise StrictYamlError(*place, f"found the tag {event.tag}, expected plain data")
        if isinstance(event, ScalarEvent) and event.value == "<<" and event.style is None:
            raise StrictYamlError(*place, "found a merge key, expected plain data")
        if depth > MAX_DEPTH:
            raise StrictYamlError(*place, f"found more than {MAX_DEPTH} levels, expected at most {MAX_DEPTH}")
        if nodes > MAX_NODES:
            raise StrictYamlError(*place, f"found more than {MAX_NODES} values, expected at most {MAX_NODES}")
        if documents > 1:
            raise StrictYamlError(
                *place, "found a second document, expected a single document; remove what follows ---"
            )
        yield
