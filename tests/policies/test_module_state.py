"""Modules of policies, experiments and evaluation keep nothing from one call to the next."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import ibdata

PACKAGES = ("policies", "experiment", "evaluation")
FOLDERS = [Path(ibdata.__file__).parent / package for package in PACKAGES]
FILES = [file for folder in FOLDERS for file in sorted(folder.glob("*.py"))]
# Of pure functions: what they return depends on their arguments and on files of the package only.
CACHES = {
    "policies/expert.py: numbers",
    "policies/signals.py: sequence",
    "policies/signals.py: waves",
    "evaluation/policies.py: _any_policy",
}
CACHED = ("cache", "lru_cache")
CHANGES = "add append clear extend insert pop popitem remove set setdefault update"  # methods


def name_of(node):
    """The first name in an expression such as f(…).name[…]."""
    while not isinstance(node, ast.Name):
        node = getattr(node, "value", None) or getattr(node, "func", None)
        if node is None:
            return None
    return node.id


def last_of(node):
    """The last name in an expression such as name.name(…)."""
    node = getattr(node, "func", node)
    return getattr(node, "attr", None) or getattr(node, "id", None)


def of_module(tree):
    """The names that a module assigns."""
    targets = [t for node in tree.body for t in getattr(node, "targets", [getattr(node, "target", None)])]
    return {target.id for target in targets if isinstance(target, ast.Name)}


def kept(source):
    """The functions of a module that are cached, and the names of the module that functions change."""
    tree, caches, changed = ast.parse(source), set(), set()
    names = of_module(tree)
    for function in (node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.Lambda)):
        if any(last_of(decorator) in CACHED for decorator in getattr(function, "decorator_list", [])):
            caches.add(function.name)
        for node in ast.walk(function):
            if isinstance(node, ast.Global):
                changed |= set(node.names)
            called = node.func if isinstance(node, ast.Call) else None
            if isinstance(called, ast.Attribute) and called.attr in CHANGES.split():
                changed.add(name_of(called))
            if isinstance(node, ast.Subscript | ast.Attribute) and isinstance(node.ctx, ast.Store | ast.Del):
                changed.add(name_of(node))
    return caches, changed & names


@pytest.mark.parametrize("file", FILES, ids=lambda file: f"{file.parent.name}/{file.name}")
def test_no_module_keeps_what_its_functions_change(file):
    place = f"{file.parent.name}/{file.name}"
    caches, changed = kept(file.read_text())
    assert {f"{place}: {name}" for name in caches} == {cache for cache in CACHES if cache.startswith(place)}
    assert changed == set()


@pytest.mark.parametrize(
    "line", ["known[x] = 1", "known.update({x: 1})", "del known[x]", "global known", "known.x = 1"]
)
def test_what_is_kept_would_be_found(line):
    assert kept(f"known: dict = {{}}\ndef f(x):\n    {line}") == (set(), {"known"})
    assert kept("@lru_cache(9)\ndef f(x): pass\n@functools.cache\ndef g(x): pass")[0] == {"f", "g"}
