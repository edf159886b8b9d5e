"""The arguments of public functions, checked by their annotations before the function is called."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache, wraps
from numbers import Real
from types import SimpleNamespace, UnionType
from typing import Annotated, Any, NamedTuple, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from ibdata.errors import UsageError, excerpt, nearest

P = ParamSpec("P")
R = TypeVar("R")

WORDS = {  # in messages, by the name of a type
    "Callable": "a function",
    "Mapping": "a mapping",
    "NoneType": "None",
    "PathLike": "a path",
    "bool": "True or False",
    "dict": "a mapping",
    "float": "a number",
    "int": "a whole number",
    "ndarray": "an array",
    "str": "a text",
}
WRONG = object()  # in place of a value of no expected type


class Parameters(NamedTuple):
    """What a function takes."""

    positional: list[str]
    types: dict[str, Any]  # by name
    takes_others: bool  # as **options


def public(function: Callable[P, R]) -> Callable[P, R]:
    """Check the arguments of each call: UsageError for an unknown name, or another type than the annotated.

    Numbers and arrays of numpy become numbers and lists of Python. True and False are no numbers. A type that
    is imported for type checkers only is not checked. The text in an `Annotated` type is what is expected.
    """
    return public_with(())(function)


def public_with(keys: Iterable[str]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """As `public`, for a function whose argument `overrides` takes these keys."""

    def decorated(function: Callable[P, R]) -> Callable[P, R]:
        @wraps(function)
        def checked(*args: P.args, **options: P.kwargs) -> R:
            known = _parameters(function)
            if not known.takes_others:
                for name in options.keys() - known.types:
                    raise UsageError(f"{name}: no such option{_meant(name, options[name], known, keys)}")
            types = known.types
            given = [_taken(name, x, types[name]) for name, x in zip(known.positional, args, strict=False)]
            named = {name: _taken(name, x, types.get(name, Any)) for name, x in options.items()}
            return function(*given, *args[len(given) :], **named)  # type: ignore[arg-type]

        return checked

    return decorated


@cache
def _parameters(function: Callable[..., Any]) -> Parameters:
    """The parameters of a function, whose annotations are texts."""
    parameters = inspect.signature(function).parameters.values()
    named = [each for each in parameters if each.kind not in (each.VAR_POSITIONAL, each.VAR_KEYWORD)]
    return Parameters(
        [each.name for each in named if each.kind != each.KEYWORD_ONLY],
        {each.name: _type(each.annotation, function.__globals__) for each in named},
        any(each.kind == each.VAR_KEYWORD for each in parameters),
    )


def _type(annotation: Any, names: dict[str, Any]) -> Any:
    if annotation is inspect.Parameter.empty:  # of `self`
        return Any
    try:
        return get_type_hints(
            SimpleNamespace(__annotations__={"type": annotation}), names, include_extras=True
        )["type"]
    except NameError:  # imported for type checkers only
        return Any


def _meant(name: str, value: Any, known: Parameters, keys: Iterable[str]) -> str:
    """What a user may have meant by an unknown name."""
    names = [each for each in known.types if each != "self"]
    overrides = {key.rpartition(".")[2]: key for key in keys}
    near = name if name in overrides else nearest(name, [*names, *overrides])
    if near in overrides:
        return f"; did you mean overrides={{{overrides[near]!r}: {excerpt(value)}}}?"
    return f"; did you mean {near!r}?" if near else f"; expected {', '.join(names) or 'none'}"


def _taken(name: str, value: Any, kind: Any) -> Any:
    """A value in a type, or in one of a union. Raises UsageError if it is of none."""
    kind, *words = get_args(kind) if get_origin(kind) is Annotated else (kind,)
    found = _as(name, value, kind)
    if found is WRONG:
        *others, last = words or dict.fromkeys(_words(each) for each in _kinds(kind))
        expected = f"{', '.join(others)} or {last}" if others else last
        raise UsageError(f"{name}: found {excerpt(_plain(value))}, expected {expected}")
    return found


def _words(kind: Any) -> str:
    name = (get_origin(kind) or kind).__name__
    if name in ("Sequence", "tuple"):
        inner = [_words(each).partition(" ")[2] for each in _kinds(get_args(kind)[0])]
        return f"a list of {' or '.join(f'{each}s' for each in inner if each)}"
    return WORDS.get(name) or f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"


def _kinds(kind: Any) -> tuple[Any, ...]:
    """The types of a union; else the one type."""
    return get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)


def _as(name: str, value: Any, kind: Any) -> Any:
    """A value in a type, or in one of a union; WRONG if it is of none."""
    kinds = [(get_origin(each) or each, get_args(each)) for each in _kinds(kind)]
    if not all(_says_what_it_has(each) for each, _ in kinds):
        return value
    if any(each in (bool, int, float, Sequence, tuple) for each, _ in kinds):
        value = _plain(value)
    return next((x for x in (_as_one(name, value, *each) for each in kinds) if x is not WRONG), WRONG)


def _plain(value: Any) -> Any:
    """Numbers and arrays of numpy, pandas and torch as those of Python."""
    as_list = getattr(value, "tolist", None)
    return as_list() if callable(as_list) and not isinstance(value, type) else value


def _says_what_it_has(kind: Any) -> bool:
    """Whether a type is a class that knows its values, which `Any` and array-likes are not."""
    return isinstance(kind, type) and kind is not Any and not getattr(kind, "_is_protocol", False)


def _as_one(name: str, value: Any, kind: Any, inner: tuple[Any, ...]) -> Any:
    """A value in a type, or WRONG."""
    if isinstance(value, bool):
        return value if kind is bool else WRONG
    if kind in (int, float):
        if not isinstance(value, Real) or (kind is int and value % 1 != 0):
            return WRONG
        return math.floor(value) if kind is int else value
    if kind in (Sequence, tuple):
        if not isinstance(value, Iterable) or isinstance(value, str | bytes | Mapping):
            return WRONG
        values = [_as(name, each, inner[0]) for each in value]
        return WRONG if any(each is WRONG for each in values) else values
    if not isinstance(value, kind):
        return WRONG
    if kind is Mapping:
        return {key: _taken(f"{name}: {key}", each, inner[1]) for key, each in value.items()}
    return value
