"""Parameters of custom code, limited to values that JSON and YAML store unchanged."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from typing import Annotated, Any

from pydantic import AfterValidator

from ibdata.errors import Loc, Problems

MAX_DEPTH = 16  # levels; a YAML file may have 20, of which the experiment itself uses some
MAX_DIGITS = 400  # of a whole number, as in YAML
# YAML's words for infinity and NaN, which an experiment reads as text.
NOT_FINITE = re.compile(r"[-+]?\.(inf|Inf|INF)|\.(nan|NaN|NAN)")


def _plain(params: dict[str, Any]) -> dict[str, Any]:
    """A copy with only the types of JSON."""
    found = list(_problems(params, ()))
    if found:
        raise Problems(found)
    plain: dict[str, Any] = json.loads(json.dumps(params))
    return plain


def _problems(value: Any, loc: Loc) -> Iterator[tuple[Loc, str]]:
    if len(loc) > MAX_DEPTH:
        yield loc, f"found more than {MAX_DEPTH} levels, expected at most {MAX_DEPTH}"
    elif isinstance(value, dict):
        for key, inner in value.items():
            if not isinstance(key, str):
                yield loc, f"found a key of type {type(key).__name__}, expected text"
            elif _is_lost(key):
                yield loc, f"found the key {key!a}, which YAML does not keep; expected other text"
            else:
                yield from _problems(inner, (*loc, key))
    elif isinstance(value, list | tuple):
        for i, inner in enumerate(value):
            yield from _problems(inner, (*loc, i))
    elif isinstance(value, str):
        if NOT_FINITE.fullmatch(value):
            yield loc, f"found {value}, expected a finite number"
        elif _is_lost(value):
            yield loc, f"found {ascii(value)[:60]}, which YAML does not keep; expected other text"
    elif isinstance(value, float):
        if not math.isfinite(value):
            yield loc, f"found {json.dumps(value)}, expected a finite number"
    elif isinstance(value, int):
        if abs(value) >= 10**MAX_DIGITS:
            yield loc, f"found a whole number of more than {MAX_DIGITS} digits, expected at most {MAX_DIGITS}"
    elif value is not None:
        kind = type(value).__name__
        yield loc, f"found an object of type {kind}, expected only what JSON holds"


def _is_lost(text: str) -> bool:
    """Whether YAML in UTF-8 would not keep a text: half of a surrogate pair, or the line break U+0085."""
    return "\x85" in text or any("\ud800" <= c <= "\udfff" for c in text)


Parameters = Annotated[dict[str, Any], AfterValidator(_plain)]
