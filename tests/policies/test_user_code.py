"""Errors in users' code name its file and line."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest
from helpers.policies import proposed, ready

from ibdata.evaluation.policies import as_policy
from ibdata.policies.checked import AnswerError
from ibdata.policies.code import error_line

CODE = """
import json, sys

def index(): return [][7]
def in_the_standard_library(): return json.loads("{")
def two_lines(): raise RuntimeError("one\\n  two")
def silent(): raise KeyError
def leave(): sys.exit("enough")
def from_text(): exec("1 / 0")
def no_python(): import broken_code
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
        ("index", "code_of_mine.py:4: IndexError: list index out of range"),
        ("in_the_standard_library", "code_of_mine.py:5: JSONDecodeError: Expecting property name enclosed"),
        ("two_lines", "code_of_mine.py:6: RuntimeError: one two"),
        ("silent", "code_of_mine.py:7: KeyError"),
        ("leave", "code_of_mine.py:8: SystemExit: enough"),
        ("from_text", "code_of_mine.py:9: ZeroDivisionError: division by zero"),
        ("no_python", "broken_code.py:2: SyntaxError: invalid syntax"),
    ],
)
def test_an_error_names_the_innermost_line_of_a_users_file(code, tmp_path, monkeypatch, name, line):
    (tmp_path / "broken_code.py").write_text("x = 1\nx = = 2\n")
    monkeypatch.syspath_prepend(tmp_path)
    found = caught(getattr(code, name))
    assert found.startswith(line)
    assert "\n" not in found
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert caught(getattr(code, name)) == f"{tmp_path}/{found}"


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
        proposed(ready(as_policy(fails)), np.zeros((2, 1, 6), dtype=np.float32))
