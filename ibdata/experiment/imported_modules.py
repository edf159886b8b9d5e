"""Find the imports of a module by reading source files, without running code."""

from __future__ import annotations

import ast
import importlib.util
import sys
from collections.abc import Container, Iterator
from contextlib import suppress
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from ibdata.policies.user_code import is_installed, is_of_python

PACKAGE = __name__.partition(".")[0]


class Source(NamedTuple):
    """A module and its file."""

    module: str
    path: Path


def imported(module: str) -> tuple[dict[str, Source], set[str]]:
    """Return the sources of a module and of its imports, and the names of the installed packages among them.

    The key of a source is its path relative to the folder in which Python finds it, so it is the same on
    every host. The module itself comes first. Imports inside functions are included, but not modules whose
    names are made at run time. The imports of an installed package are not followed, unless it contains the
    module itself.
    """
    sources: dict[str, Source] = {}
    others: set[str] = set()
    seen: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        top = name.partition(".")[0]
        if name in seen or top in others:
            continue
        seen.add(name)
        if not _is_own(top, module):
            others.add(top)
            continue
        spec = _spec(name)
        if spec is None:  # an attribute of a module
            continue
        waiting.append(name.rpartition(".")[0] or name)
        if spec.origin is not None:  # a folder without __init__.py has none
            path = Path(spec.origin)
            inside = spec.submodule_search_locations is not None
            sources[_key(name, path, inside)] = Source(name, path)
            waiting += _named(path, name if inside else name.rpartition(".")[0])
    return sources, others - set(sys.stdlib_module_names)


def _key(name: str, path: Path, is_package: bool) -> str:
    """The path of a module's file, relative to the folder in which Python finds its outermost package."""
    folders = name.split(".") if is_package else name.split(".")[:-1]
    return "/".join([*folders, path.name])


def loaded(others: Container[str], owners: Container[str] | None = None) -> dict[str, Source]:
    """Return the sources of the modules in `sys.modules` that are not installed, by keys as in `imported`.

    Args:
        others: Names of modules that do not count.
        owners: The names of modules that belong to a distribution; other installed ones count too.
    """
    sources = {}
    for name, module in list(sys.modules.items()):
        loose = owners is not None and name.partition(".")[0] not in owners
        if name not in others and is_users(name, module, loose) and (path := _path(module)):
            sources[_key(name, path, hasattr(module, "__path__"))] = Source(name, path)
    return sources


def is_users(name: str, module: ModuleType, loose: bool = False) -> bool:
    """Whether a module has a file that is no part of Python, of ibdata or, unless loose, of a package."""
    path = _path(module)
    if path is None or name.partition(".")[0] in (PACKAGE, "__main__", "__mp_main__"):
        return False
    return not (is_of_python(path) if loose else is_installed(path))


def _path(module: ModuleType) -> Path | None:
    spec = getattr(module, "__spec__", None)
    return Path(spec.origin) if spec is not None and spec.has_location and spec.origin else None


def _is_own(top: str, module: str) -> bool:
    """Whether a module is not in the standard library nor installed, or is in the package of the target."""
    spec = _spec(top)
    if spec is None or top == PACKAGE:
        return False
    if top == module.partition(".")[0]:
        return True
    places = [spec.origin] if spec.origin else list(spec.submodule_search_locations or ())
    paths = [Path(place) for place in places if place not in ("built-in", "frozen")]
    return bool(paths) and not any(map(is_installed, paths))


def _spec(name: str) -> ModuleSpec | None:
    """Find a module's spec without importing its parents, unlike `importlib.util.find_spec`."""
    parent, _, tail = name.rpartition(".")
    if not parent:
        finders = [finder for finder in sys.meta_path if hasattr(finder, "find_spec")]
        return next((spec for finder in finders if (spec := finder.find_spec(name, None))), None)
    outer = _spec(parent)
    if outer is None or outer.submodule_search_locations is None:
        return None
    return PathFinder.find_spec(tail, list(outer.submodule_search_locations))


def _named(path: Path, package: str) -> Iterator[str]:
    """The names that a source file imports; some may not be modules."""
    try:
        tree = ast.parse(path.read_bytes()) if path.suffix == ".py" else ast.Module([], [])
    except (OSError, SyntaxError, ValueError):  # it cannot be imported either
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.Call):
            yield from _name_imported_by(node)
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            with suppress(ImportError):  # more dots than there are packages
                base = importlib.util.resolve_name("." * node.level + base, package)
                yield base
                yield from (f"{base}.{alias.name}" for alias in node.names)


def _name_imported_by(call: ast.Call) -> Iterator[str]:
    """The name in `importlib.import_module("name")` or `__import__("name")`, as far as it is written out."""
    function = getattr(call.func, "attr", getattr(call.func, "id", None))
    name = getattr(call.args[0], "value", None) if call.args else None
    if function in ("import_module", "__import__") and isinstance(name, str) and not name.startswith("."):
        yield name
