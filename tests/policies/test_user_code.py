"""Errors in users' code name its file and line."""

from __future__ import annotations

import importlib.util
import sys

import numpy as np
import pytest
from helpers.asking import proposed

from ibdata.evaluation.policies import policy_of
from ibdata.policies.checked import AnswerError
from ibdata.policies.code import error_line

CODE = """
import json, sys


def index():
    return [][7]


def inside_the_standard_library():
    return json.loads("{")


def two_lines():
    raise RuntimeError("one\\n  two")


def silent():
    raise KeyError


def leave():
    sys.exit("enough")


def from_text():
    exec("1 / 0")
"""


@pytest.fixture
def code(tmp_path, monkeypatch):
    """The module of a file in the current folder."""
    (tmp_path / "code_of_mine.py").write_text(CODE)
    monkeypatch.chdir(tmp_path)
    spec = importlib.util.spec_from_file_location("code_of_mine", tmp_path / "code_of_mine.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def caught(call):
    with pytest.raises(BaseException) as error:  # noqa: PT011
        call()
    return error_line(error.value)


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("index", "6: IndexError: list index out of range"),
        ("inside_the_standard_library", "10: JSONDecodeError: Expecting property name enclosed in"),
        ("two_lines", "14: RuntimeError: one two"),
        ("silent", "18: KeyError"),
        ("leave", "22: SystemExit: enough"),
        ("from_text", "26: ZeroDivisionError: division by zero"),
    ],
)
def test_an_error_names_the_innermost_line_of_a_users_file(code, tmp_path, monkeypatch, name, line):
    found = caught(getattr(code, name))
    assert found.startswith(f"code_of_mine.py:{line}")
    assert "\n" not in found
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert caught(getattr(code, name)) == f"{tmp_path}/{found}"


def test_code_that_is_no_python_is_named_by_its_line(tmp_path, monkeypatch):
    (tmp_path / "broken_code.py").write_text("x = 1\nx = = 2\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    line = caught(lambda: importlib.import_module("broken_code"))
    assert line == "broken_code.py:2: SyntaxError: invalid syntax"
    assert "broken_code" not in sys.modules


def test_an_error_of_ibdata_itself_has_no_place():
    assert error_line(ValueError("boom")) == "ValueError: boom"


@pytest.mark.parametrize(
    ("raised", "caught"),
    [
        (BaseException, AnswerError("BaseException: x; it was given")),
        (GeneratorExit, AnswerError("GeneratorExit: x; it was given")),
        (KeyboardInterrupt, KeyboardInterrupt("x")),
    ],
)
def test_all_that_code_raises_is_its_error_but_ctrl_c(raised, caught):
    def fails(observations):
        raise raised("x")

    with pytest.raises(type(caught), match=str(caught)):
        proposed(policy_of(fails), np.zeros((2, 1, 6), dtype=np.float32))
