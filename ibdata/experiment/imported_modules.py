"""Find the imports of a module by reading source files, without running code."""

from __future__ import annotations

import ast
import importlib.util
import sys
from collections.abc import Iterator
from contextlib import suppress
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from typing import NamedTuple

from ibdata.policies.user_code import is_installed

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
            folders = name.split(".") if inside else name.split(".")[:-1]
            sources["/".join([*folders, path.name])] = Source(name, path)
            waiting += _named(path, ".".join(folders))
    return sources, others - set(sys.stdlib_module_names)


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
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            with suppress(ImportError):  # more dots than there are packages
                base = importlib.util.resolve_name("." * node.level + base, package)
                yield base
                yield from (f"{base}.{alias.name}" for alias in node.names)
