"""The arguments of public functions, checked by their annotations before the function is called."""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, MappingView, Sequence, Set
from contextlib import contextmanager
from functools import cache, wraps
from numbers import Real
from types import SimpleNamespace, UnionType
from typing import Annotated, Any, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from ibdata._numerics.naming import decimal
from ibdata._system.signals import whole_imports
from ibdata.errors import ArgumentError, IbdataError, excerpt, nearest

P = ParamSpec("P")
R = TypeVar("R")

WORDS = {  # for types by name; lists of numbers or texts have the words of one
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
OTHERS = "**"  # the name that stands for further options
METHODS = ("decide", "act", "predict")
WRONG = object()  # in place of a value of another type


def public(
    function: Callable[P, R], keys: Iterable[str] = (), unknown: str = "no such option"
) -> Callable[P, R]:
    """Check the arguments of each call: ArgumentError for an unknown or a missing one, or another type.

    Ctrl-C then waits for imports.

    Numbers and arrays of numpy become numbers and lists of Python. True and False are no numbers. What is no
    class, or is imported for type checkers only, is not checked. The text in an `Annotated` type is what is
    expected.

    The argument `overrides` of the function, if it has one, takes the keys. `unknown` is what is said of an
    unknown name, which may stand in it as {}.
    """
    signature = inspect.signature(function)
    parameters = [parameter for parameter in signature.parameters.values() if parameter.name != "self"]
    form = ", ".join(f"{x.name}=…" if x.kind == x.KEYWORD_ONLY else x.name for x in parameters)

    @wraps(function)
    def checked(*args: P.args, **options: P.kwargs) -> R:
        types = _types(function)
        for name, value in options.items():
            if name not in types and OTHERS not in types:
                raise ArgumentError(f"{name}: {unknown.format(name)}{_meant(name, value, types, keys)}")
        given = [_taken(name, value, types[name]) for name, value in zip(types, args, strict=False)]
        named = {name: _taken(name, value, types.get(name, Any)) for name, value in options.items()}
        try:
            signature.bind(*args, **options)
        except TypeError as error:
            raise ArgumentError(
                f"{function.__name__}: {error}; expected {function.__name__}({form})"
            ) from None
        with whole_imports():
            return function(*given, *args[len(given) :], **named)  # type: ignore[arg-type]  # checked above

    return checked


@cache
def _types(function: Callable[..., Any]) -> dict[str, Any]:
    """The types of the parameters of a function, in their order."""
    types = {}
    for parameter in inspect.signature(function).parameters.values():
        is_self = parameter.annotation is parameter.empty
        annotation = Any if is_self else parameter.annotation
        hint = SimpleNamespace(__annotations__={"type": annotation})
        name = OTHERS if parameter.kind == parameter.VAR_KEYWORD else parameter.name
        try:
            types[name] = get_type_hints(hint, function.__globals__, include_extras=True)["type"]
        except NameError:  # imported for type checkers only
            types[name] = Any
    return types


def _meant(name: str, value: Any, known: Iterable[str], keys: Iterable[str]) -> str:
    """What a user may have meant by an unknown name."""
    overrides = {key.rpartition(".")[2]: key for key in keys if key not in known}
    names = [option for option in known if option != "self"]
    near = name if name in overrides else nearest(name, [*names, *overrides])
    if near in overrides:
        return f"; did you mean overrides={{{overrides[near]!r}: {excerpt(value)}}}?"
    return f"; did you mean {near!r}?" if near else f"; expected {', '.join(names) or 'none'}"


def _taken(name: str, value: Any, kind: Any) -> Any:
    """A value in a type, or in one of a union. Raises ArgumentError if it is of none."""
    taken = _as(name, value, kind)
    if taken is WRONG:
        words = get_args(kind)[1:] if get_origin(kind) is Annotated else ()
        *others, last = words or dict.fromkeys(_words(*member) for member in _kinds(kind))
        expected = f"{', '.join(others)} or {last}" if others else last
        raise ArgumentError(f"{name}: found {excerpt(_native(value))}, expected {expected}")
    return taken


def _words(kind: Any, inner: tuple[Any, ...]) -> str:
    name = kind.__name__
    if name in ("Sequence", "tuple"):
        parts = [_words(*member).partition(" ")[2] for member in _kinds(inner[0])]
        return f"a list of {' or '.join(f'{part}s' for part in parts if part)}"
    return WORDS.get(name) or f"{'an' if name[0] in 'AEIOU' else 'a'} {name}"


@cache
def _kinds(kind: Any) -> tuple[tuple[Any, tuple[Any, ...]], ...]:
    """The types of a union, or the one type, each with its arguments; none if any value will do."""
    members = tuple((get_origin(member) or member, get_args(member)) for member in _members(kind))
    is_checked = all(
        isinstance(each, type) and each is not Any and not getattr(each, "_is_protocol", False)
        for each, _ in members
    )
    return members if is_checked else ()  # not for array-likes


def _members(kind: Any) -> list[Any]:
    """The types of a union, or the one type, with what an alias stands for in its place."""
    origin = get_origin(kind)
    if origin is Annotated:
        return _members(get_args(kind)[0])
    if origin in (Union, UnionType):
        return [member for each in get_args(kind) for member in _members(each)]
    alias = origin or kind  # of a `type` statement, as numpy has them from 2.5 on
    return _members(alias.__value__) if hasattr(alias, "__value__") else [kind]


def native(value: Any) -> Any:
    """A copy of data of any library, in which mappings, collections, numbers and paths are Python's.

    Any other value stays as it is, and so does what can act. Raises ArgumentError for what cannot be read.

    >>> import numpy as np
    >>> native({"setpoints": np.arange(10, 40, 10), "start": {"burn_in": {2, 1}}})
    {'setpoints': [10, 20, 30], 'start': {'burn_in': [1, 2]}}
    """
    if can_act(value):
        return value
    with _reading(value):
        if isinstance(value, Mapping):
            return {key: native(item) for key, item in value.items()}
        value = os.fspath(value) if isinstance(value, os.PathLike) else _native(value)
        return [native(item) for item in items] if (items := _items_of(value)) is not None else value


@contextmanager
def _reading(value: Any) -> Iterator[None]:
    """Raise ArgumentError for what another library raises, as for an interpolation that leads nowhere."""
    try:
        yield
    except IbdataError:
        raise
    except Exception as error:
        why = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        raise ArgumentError(f"found a {type(value).__name__} that cannot be read: {why}") from error


def _items_of(value: Any) -> list[Any] | None:
    """The items of a collection of any library, which of a set are sorted; None if it is none."""
    if not isinstance(value, Collection) or isinstance(value, str | bytes | bytearray | Mapping):
        return None
    is_set = isinstance(value, Set) and not isinstance(value, MappingView)
    return sorted(value) if is_set else list(value)


def can_act(value: Any) -> bool:
    """Whether a value is an object that can act as a policy: whatever else it is, it is no data."""
    return not isinstance(value, type) and (has_method(value) or callable(value))


def has_method(value: Any) -> bool:
    """Whether an object has one of the methods by which it can act."""
    return any(callable(getattr(value, name, None)) for name in METHODS)


def _native(value: Any) -> Any:
    """A number or an array of numpy, pandas or torch as that of Python; 20.1 in float32 is 20.1 again."""
    as_list = getattr(value, "tolist", None)
    if not callable(as_list) or isinstance(value, type):
        return value
    if str(getattr(value, "dtype", "")).endswith("float32"):
        import numpy as np  # it is loaded, and commands that show help do without

        return _decimals(np.asarray(value))
    return as_list()


def _decimals(numbers: Any) -> Any:
    return list(map(_decimals, numbers)) if numbers.ndim else decimal(numbers[()])


def _as(name: str, value: Any, kind: Any) -> Any:
    """A value in a type, or in one of a union; WRONG if it is of none."""
    kinds = _kinds(kind)
    if (type(value), ()) in kinds:  # as most are
        return value
    if any(member in (bool, int, float, Sequence, tuple) for member, _ in kinds):
        value = _native(value)
    for member, inner in kinds:
        if (taken := _as_one(name, value, member, inner)) is not WRONG:
            return taken
    return WRONG if kinds else value


def _as_one(name: str, value: Any, kind: Any, inner: tuple[Any, ...]) -> Any:
    if isinstance(value, bool):
        return value if kind is bool else WRONG
    if kind in (int, float):
        if not isinstance(value, Real) or (kind is int and value % 1 != 0):
            return WRONG
        return math.floor(value) if kind is int else value
    if kind in (Sequence, tuple):
        with _reading(value):
            items = list(value) if isinstance(value, Iterator) else _items_of(value)
        return WRONG if items is None else _items(name, items, inner[0])
    if not isinstance(value, kind):
        return WRONG
    if kind is Mapping:
        with _reading(value):
            return {key: _taken(f"{name}: {key}", item, inner[1]) for key, item in value.items()}
    return value


def _items(name: str, values: list[Any], kind: Any) -> Any:
    """The items of a list in a type; WRONG if one is not. Millions of numbers take no call for each."""
    types, known = set(map(type, values)), {member for member, inner in _kinds(kind) if not inner}
    if types <= known or (float in known and types <= {int, float}):
        return values
    if int in known and types == {float}:
        return list(map(math.floor, values)) if all(map(float.is_integer, values)) else WRONG
    taken = [_as(name, item, kind) for item in values]
    return WRONG if any(item is WRONG for item in taken) else taken
