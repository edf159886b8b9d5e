"""The page of Python has what public functions return, and every field of it."""

from __future__ import annotations

import ast
import inspect
import re

import pytest
from helpers import ROOT, script

from ibdata.evaluation.algorithms import Algorithm, Difference, differences_printed, printed
from measuring.documents import filled

reference = script("reference")
SHOWN = re.findall(
    r"^::: ibdata\.(.+)\.(\w+)$", (ROOT / "docs/api.md").read_text(encoding="utf-8"), re.MULTILINE
)
RESULTS = reference.results()


TREES = {
    ".".join(file.relative_to(ROOT / "ibdata").with_suffix("").parts).removesuffix(".__init__"): ast.parse(
        file.read_text(encoding="utf-8")
    )
    for file in (ROOT / "ibdata").rglob("*.py")
}
CLASSES = {node.name: node for tree in TREES.values() for node in tree.body if isinstance(node, ast.ClassDef)}


def named(*annotations: ast.AST | None) -> set[str]:
    """The names of classes of ibdata in annotations."""
    nodes = [node for annotation in annotations if annotation for node in ast.walk(annotation)]
    return {node.id for node in nodes if isinstance(node, ast.Name)} & set(CLASSES)


def answers(node: ast.ClassDef | ast.FunctionDef) -> set[str]:
    """The classes that a function returns, or that the fields and methods of a class and its bases give."""
    if isinstance(node, ast.FunctionDef):
        return named(node.returns)
    fields = [x.annotation for x in node.body if isinstance(x, ast.AnnAssign)]
    methods = [x for x in node.body if isinstance(x, ast.FunctionDef) and x.name[0] != "_"]
    promised = [x.returns for x in methods if x.name not in reference.INTERNAL]
    return named(*fields, *promised).union(*(answers(CLASSES[base]) for base in named(*node.bases)))


def test_every_class_that_is_returned_or_is_a_part_of_a_result_is_on_the_page():
    """Found in the text of the annotations, where scripts/reference asks the running classes."""
    shown = [x for module, name in SHOWN for x in TREES[module].body if getattr(x, "name", "") == name]
    results = {"Dataset", *(cls.__name__ for cls in RESULTS)}
    read = [x for x in shown if isinstance(x, ast.FunctionDef) or x.name in results]
    asked = set().union(*map(answers, read))
    assert {"Result", "Difference", "Estimated", "Windows", "State"} <= asked
    assert asked - {cls.__name__ for cls in reference.OPAQUE} <= {name for _, name in SHOWN}


@pytest.mark.parametrize("result", RESULTS, ids=lambda cls: f"{cls.__module__}.{cls.__name__}")
def test_every_field_of_a_result_is_explained(result):
    described = (inspect.getdoc(result) or "").partition("Attributes:")[2]
    assert re.findall(r"^    (\w+): ", described, re.MULTILINE) == list(inspect.get_annotations(result))


def test_every_printed_column_is_a_field_or_named_beside_one():
    line = Algorithm("a", "yours", None, 3, *[1.0] * 11)
    difference = Difference("a", "b", None, 1.0, 1.0, (0.0, 2.0))
    for table, cls in (
        (printed([line], wide=True), Algorithm),
        (differences_printed([difference]), Difference),
    ):
        for name in table.names:
            assert name in cls._fields or f'"{name}"' in cls.__doc__, name


def test_a_number_in_a_sentence_has_the_value_of_its_name():
    page = "from −1.0<!--low--> to 2<!--high--> steps, +0.50<!--gain--> in 1,234<!--rows--> rows of 70"
    numbers = {"low": -56.04, "high": 7.6, "gain": 1.0, "rows": 12345}
    expected = "from −56.0<!--low--> to 8<!--high--> steps, +1.00<!--gain--> in 12,345<!--rows--> rows of 70"
    assert filled(page, numbers) == expected
    with pytest.raises(ValueError, match="no place for the numbers other"):
        filled(page, {**numbers, "other": 1.0})
    with pytest.raises(KeyError, match="rows"):
        filled(page, {"low": 0.0, "high": 0.0, "gain": 0.0})


def test_the_environments_on_the_page_exist():
    """Their modules need libraries, so scripts/reference has their names as texts."""
    for module, names in reference.ENVIRONMENTS.items():
        for name in names:
            place, _, cls = f"{module}.{name}".removeprefix("ibdata.").rpartition(".")
            assert cls in {getattr(node, "name", "") for node in TREES[place].body}
