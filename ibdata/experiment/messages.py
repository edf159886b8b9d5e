"""Rephrase pydantic's errors for users: what was found, what was expected, and a similar valid word."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from pydantic import BaseModel, ValidationError

from ibdata.errors import Loc, Problems, suggestion
from ibdata.policies import POLICIES
from ibdata.policies.custom import TARGET, TARGET_MEANT

# error type → what was expected, with the error's context filled in
EXPECTED = {
    "int_type": "a whole number",
    "int_from_float": "a whole number",
    "float_type": "a number",
    "finite_number": "a finite number",
    "bool_type": "true or false",
    "string_type": "text",
    "list_type": "a list",
    "tuple_type": "a list",
    "dict_type": "a mapping",
    "model_type": "a mapping",
    "model_attributes_type": "the name of a policy, or a mapping with 'kind'",
    "greater_than": "a {number} above {bound}",
    "greater_than_equal": "a {number} of at least {bound}",
    "less_than": "a {number} below {bound}",
    "less_than_equal": "a {number} of at most {bound}",
    "too_short": "at least {min_length} {items}",
    "too_long": "at most {max_length} {items}",
    "string_pattern_mismatch": "a name of a-z, 0-9, _ and -, at most 64 characters",
}


def shown(value: Any) -> str:
    """A value as an error message shows it, cut to 60 characters."""
    text = json.dumps(value, ensure_ascii=False, default=str) if not isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


class Problem(NamedTuple):
    """A problem in the data of a model."""

    loc: Loc
    message: str
    at_key: bool  # whether the key is wrong, not its value

    @property
    def key(self) -> str:
        """The path of the value, with its parts joined by dots."""
        return ".".join(map(str, self.loc))


def problems(error: ValidationError, model: type[BaseModel], data: Any) -> list[Problem]:
    """Return the problems that pydantic found in the data of a model, in the words of a user."""
    return [problem for each in error.errors() for problem in _problems(each, model, data)]


def _problems(error: Mapping[str, Any], model: type[BaseModel], data: Any) -> list[Problem]:
    """The problems of one error: several if it is about more than one key."""
    kind = error["type"]
    loc = _resolved(error["loc"], data, keep_last=kind in ("extra_forbidden", "missing"))
    inner = error.get("ctx", {}).get("error")
    if isinstance(inner, Problems):
        return [Problem((*loc, *path), message, at_key=False) for path, message in inner.found]
    if kind == "union_tag_invalid" and isinstance(_at(data, loc), dict):  # not the bare name of a policy
        loc = (*loc, "kind")
    message = _rephrased(error, _keys_at(model, data, loc[:-1]))
    return [Problem(loc, message, at_key=kind == "extra_forbidden")]


def _resolved(loc: Loc, data: Any, keep_last: bool) -> Loc:
    """The path without the parts that pydantic adds for branches of unions."""
    out: list[str | int] = []
    in_policy = False  # the next part is the kind of a policy, which may be a key as well
    for i, part in enumerate(loc):
        here = (isinstance(data, dict) and part in data) or (
            isinstance(data, list) and isinstance(part, int) and part < len(data)
        )
        here = here and not in_policy
        in_policy = loc[0] == "policies" and (i == 1 or (part == "base" and here))
        if here:
            data = data[part]
        if here or (keep_last and i == len(loc) - 1):
            out.append(part)
    return tuple(out)


def _at(data: Any, loc: Loc) -> Any:
    """The value at a path."""
    for part in loc:
        data = data[part]
    return data


def _rephrased(error: Mapping[str, Any], known_keys: Iterable[str]) -> str:
    """Rephrase one error of pydantic as 'found …, expected …'."""
    kind, context, value = error["type"], error.get("ctx", {}), error["input"]
    if kind == "extra_forbidden":
        key = str(error["loc"][-1])
        return f"no such option{suggestion(key, known_keys) or f'; expected one of {_join(known_keys)}'}"
    if kind == "missing":
        return "missing, expected a value"
    if kind in ("literal_error", "union_tag_invalid"):
        words = [_yaml_word(w) for w in _words(context.get("expected") or context["expected_tags"])]
        found = value.get("kind") if kind == "union_tag_invalid" and isinstance(value, dict) else value
        near = suggestion(str(found), words)
        return f"found {shown(found)}, expected {'one of ' if len(words) > 1 else ''}{_join(words)}{near}"
    if kind == "union_tag_not_found":
        return f"found {shown(value)}, expected a mapping with 'kind'"
    if kind in ("value_error", "assertion_error"):
        return str(context["error"])
    if context.get("pattern") == TARGET:
        return f"found {shown(value)}, expected {TARGET_MEANT}"
    if kind in EXPECTED:
        bound = context.get("min_length", context.get("max_length", next(iter(context.values()), None)))
        filled = {
            "number": "whole number" if isinstance(bound, int) else "number",
            "bound": f"{bound:g}" if isinstance(bound, float) else bound,
            "items": "item" if bound == 1 else "items",
        }
        return f"found {shown(value)}, expected {EXPECTED[kind].format(**filled, **context)}"
    return f"found {shown(value)}, expected: {error['msg']}"


def _keys_at(model: type[BaseModel], data: Any, loc: Loc) -> list[str]:
    """The names of the options that the mapping at `loc` may have."""
    if loc and loc[0] == "policies" and len(loc) > 1:
        block = _at(data, loc)
        policy = POLICIES.get(str(block.get("kind"))) if isinstance(block, dict) else None
        return list(policy.model_fields) if policy else []
    for part in loc:
        field = model.model_fields.get(str(part))
        found = [m for m in _models(field.annotation if field else None)]
        if not found:
            continue
        model = next((m for m in found if _fits(m, data, loc)), found[0])
    return list(model.model_fields)


def _models(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [m for arg in getattr(annotation, "__args__", ()) for m in _models(arg)]


def _fits(model: type[BaseModel], data: Any, loc: Loc) -> bool:
    for part in loc:
        data = data.get(part, {}) if isinstance(data, dict) else {}
    return isinstance(data, dict) and bool(set(data) & set(model.model_fields))


def _words(expected: str) -> list[str]:
    """The words of pydantic's "False, True, 'full' or 'next'"."""
    return [word.strip("'") for word in re.split(r", | or ", expected)]


def _yaml_word(word: str) -> str:
    return {"True": "true", "False": "false"}.get(word, word)


def _join(words: Iterable[str]) -> str:
    return ", ".join(words)
