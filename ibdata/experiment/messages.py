"""Rephrase the errors of pydantic for users: the value, what was expected, and a similar valid word."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import reduce
from operator import getitem
from typing import Any, NamedTuple, get_args

from pydantic import BaseModel, ValidationError

from ibdata._numerics.arguments import native
from ibdata._numerics.naming import NAME_PATTERN
from ibdata.errors import ConfigError, Loc, Problems, meant, suggestion
from ibdata.experiment.fields import LICENCE, LICENCE_PATTERN, SHARE_PATTERN
from ibdata.policies import POLICIES
from ibdata.policies.user_object import TARGET, TARGET_MEANT
from ibdata.policies.weights_file import SHA256, shipped_names

# type of an error → what was expected; the context of the error fills the braces
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
}
# pattern of a text → what was expected
PATTERNS = {
    NAME_PATTERN: "a name of a-z, 0-9, _ and -, at most 64 characters",
    SHA256: "64 hex digits",
    TARGET: TARGET_MEANT,
    LICENCE_PATTERN: f"an SPDX expression such as {LICENCE} or 'MIT OR Apache-2.0': "
    "2 to 200 letters, digits, spaces and . + - ( )",
    SHARE_PATTERN: "a whole number, {start, stop}, or a share such as first 90%",
}
# what is often written in place of something else, as its problem begins → how that is written
WRITTEN = {
    r"setpoints?\.\d+: .*drifting": "{drifting: [30, 70]}, where all setpoints move",
    r"start: found 'burn_in'|start\.burn_in: found \d|burn_in: ": "start: {burn_in: [fewest, most]}",
    r"splits\.[^.]+: found .*expected a mapping$": "{episodes: first 80%}",
    r"setpoints?: found '[\d., ]+'": "[50, 70]",
}


def shown(value: Any) -> str:
    """A value as an error message shows it, cut to 60 characters."""
    text = json.dumps(value, ensure_ascii=False, default=str) if not isinstance(value, str) else repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


class ConfigProblem(NamedTuple):
    """A problem in the data of a model."""

    loc: Loc
    message: str
    at_key: bool  # whether the key is wrong, not its value

    @property
    def text(self) -> str:
        """The problem after the path of the value, whose parts are joined by dots."""
        key = ".".join(map(str, self.loc))
        line = f"{key}: {self.message}" if key else self.message
        written = (f"; write {text}" for known, text in WRITTEN.items() if re.match(known, line))
        return line + next(written, "")


@contextmanager
def refusals(
    data: Mapping[str, Any],
    model: type[BaseModel],
    line: Callable[[ConfigProblem], str] = lambda problem: problem.text,
) -> Iterator[dict[str, Any]]:
    """Yield the data of a model as Python's; raise ConfigError with a line for each problem of pydantic's."""
    plain: dict[str, Any] = native(data)
    try:
        yield plain
    except ValidationError as error:
        lines = [line(problem) for problem in problems(error, model, plain)]
        raise ConfigError(list(dict.fromkeys(lines))) from None


def problems(error: ValidationError, model: type[BaseModel], data: Any) -> list[ConfigProblem]:
    """Return the problems that pydantic found in the data of a model, rephrased for users."""
    rephrased: list[ConfigProblem] = []
    for detail in error.errors():
        kind, cause = detail["type"], detail.get("ctx", {}).get("error")
        loc = _path(detail["loc"], data, keep_last=kind in ("extra_forbidden", "missing"))
        if isinstance(cause, Problems):
            rephrased += [
                ConfigProblem((*loc, *path), message, at_key=False) for path, message in cause.found
            ]
            continue
        if kind == "union_tag_invalid" and isinstance(reduce(getitem, loc, data), dict):
            loc = (*loc, "kind")  # which the bare name of a policy does not have
        message = _message(detail, _options_at(model, data, loc[:-1]))
        rephrased.append(ConfigProblem(loc, message, at_key=kind == "extra_forbidden"))
    return rephrased


def _path(loc: Loc, data: Any, keep_last: bool) -> Loc:
    """The path of a value, without the parts that pydantic adds for branches of unions."""
    path: Loc = ()
    for part in loc:
        try:
            data = data[part]
        except (LookupError, TypeError):
            continue
        path = (*path, part)
    return (*path, loc[-1]) if keep_last and path[-1:] != loc[-1:] else path


def _message(error: Mapping[str, Any], options: list[str]) -> str:
    """The message 'found …, expected …' for one error of pydantic."""
    kind, context, value = error["type"], error.get("ctx", {}), error["input"]
    if kind == "extra_forbidden":
        key = str(error["loc"][-1])
        hint = suggestion(key, options) or f"; expected one of {', '.join(options)}"
        return f"no such option{hint}"
    if kind == "missing":
        return "missing, expected a value"
    if kind in ("literal_error", "union_tag_invalid"):
        words = _words(context.get("expected") or context["expected_tags"])
        words = [word for word in words if word != "live"]  # which only Python makes
        word = value.get("kind") if kind == "union_tag_invalid" and isinstance(value, dict) else value
        networks = shipped_names() if "network" in words and str(word) not in POLICIES else []
        if word in networks:
            return f"found kind {word}, which is a network; write {{kind: network, file: {word}}}"
        if str(word) in POLICIES and len(words) > 1:
            return f"found {shown(word)}, expected a policy that draws nothing: one of {', '.join(words)}"
        return f"found {shown(word)}{suggestion(str(word), [*words, *networks]) or meant(str(word), words)}"
    if kind == "union_tag_not_found":
        return f"found {shown(value)}, expected a mapping with 'kind'"
    if kind in ("value_error", "assertion_error"):
        return str(context["error"])
    if meant_text := PATTERNS.get(context.get("pattern")):
        return f"found {shown(value)}, expected {meant_text}"
    if kind in EXPECTED:
        bound = context.get("min_length", context.get("max_length", next(iter(context.values()), None)))
        placeholders = {
            "number": "whole number" if isinstance(bound, int) else "number",
            "bound": f"{bound:g}" if isinstance(bound, float) else bound,
            "items": "item" if bound == 1 else "items",
        }
        return f"found {shown(value)}, expected {EXPECTED[kind].format(**placeholders, **context)}"
    return f"found {shown(value)}, expected: {error['msg']}"


def _options_at(model: type[BaseModel], data: Any, loc: Loc) -> list[str]:
    """The names of the options that are valid in the mapping at a path."""
    if isinstance(data, dict):
        model = POLICIES.get(str(data.get("kind")), model)
    if not loc:
        return list(model.model_fields)
    field, inner = model.model_fields.get(str(loc[0])), data[loc[0]]
    models = _models(field.annotation) if field else []
    keys = set(inner if isinstance(inner, dict) else ())  # of which most are fields of the right model
    fit = max(models, key=lambda each: len(keys & each.model_fields.keys()), default=model)
    return _options_at(fit, inner, loc[1:])


def _models(annotation: Any) -> list[type[BaseModel]]:
    """All models in the type of a field."""
    if arguments := get_args(annotation):  # first, because to Python 3.10 list[int] is a type
        return [model for argument in arguments for model in _models(argument)]
    return [annotation] if isinstance(annotation, type) and issubclass(annotation, BaseModel) else []


def _words(expected: str) -> list[str]:
    """The words of a text such as "False, True, 'full' or 'next'" of pydantic, as YAML writes them."""
    words = [word.strip("'") for word in re.split(r", | or ", expected)]
    return [{"True": "true", "False": "false"}.get(word, word) for word in words]
