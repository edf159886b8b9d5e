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
import json


def index(values):
    return values[7]


def inside_the_standard_library():
    return json.loads("{")


def two_lines():
    raise RuntimeError("one\\n  two")


def silent():
    raise KeyError


def leave():
    import sys
    sys.exit("enough")


def from_text():
    exec("1 / 0")
"""


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """The module `mine` in the current folder."""
    (tmp_path / "mine.py").write_text(CODE)
    monkeypatch.chdir(tmp_path)
    spec = importlib.util.spec_from_file_location("mine", tmp_path / "mine.py")
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
        ("inside_the_standard_library", "mine.py:10: JSONDecodeError: Expecting property name enclosed in"),
        ("two_lines", "mine.py:14: RuntimeError: one two"),
        ("silent", "mine.py:18: KeyError"),
        ("leave", "mine.py:23: SystemExit: enough"),
        ("from_text", "mine.py:27: ZeroDivisionError: division by zero"),
    ],
)
def test_an_error_names_the_innermost_line_of_the_users_files(mine, name, line):
    assert caught(getattr(mine, name)).startswith(line)
    assert "\n" not in caught(getattr(mine, name))


def test_a_file_elsewhere_is_named_by_its_whole_path(mine, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert caught(lambda: mine.index([])) == f"{tmp_path}/mine.py:6: IndexError: list index out of range"


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
def test_whatever_code_raises_is_its_error_but_a_key_that_stops_passes(raised, caught):
    def fails(observations):
        raise raised("x")

    with pytest.raises(type(caught), match=str(caught)):
        proposed(policy_of(fails), np.zeros((2, 1, 6), dtype=np.float32))
