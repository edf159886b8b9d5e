"""The package as a whole: its public names, the places of its files, and what none of them may do."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import ROOT

import ibdata
from ibdata import dynamics

PACKAGE = ROOT / "ibdata"
LONGEST = 310  # lines; most files have fewer than 200, and the reader of datasets is one of docstrings
AT_THE_ROOT = {"__init__", "__main__", "errors", "report", "testing", "variables", "version"}
NAMES = """
Dataset Experiment IbdataError __version__ baselines compile_all difference estimate evaluate export finalize
generate importance load merge noise_floor open quality repair reproduce save_network score_model split
state_at true_values validate
"""
DYNAMICS = "PAPER SIEMENS VARIANTS Noise State Variant initial_state step"
SCRIPTS = [path for path in (ROOT / "scripts").rglob("*") if path.is_file() and path.suffix in ("", ".py")]


def lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines()


def test_no_file_is_too_long_to_be_read_at_once():
    files = [*PACKAGE.rglob("*.py"), *SCRIPTS]
    assert {str(path): len(lines(path)) for path in files if len(lines(path)) > LONGEST} == {}


def test_modules_live_in_rooms():
    assert {path.stem for path in PACKAGE.glob("*.py")} <= AT_THE_ROOT


def test_the_tests_of_a_room_stand_in_a_folder_of_its_name():
    rooms = {path.name for path in PACKAGE.iterdir() if path.is_dir()}
    others = {"bridges", "corpus", "docs", "faults", "helpers", "life", "reference", "results", "same_bits"}
    folders = {path.name for path in (ROOT / "tests").iterdir() if any(path.glob("test_*.py"))}
    assert folders - others <= rooms


def test_the_names_of_ibdata():
    assert ibdata.__all__ == NAMES.split()
    assert all(hasattr(ibdata, name) for name in ibdata.__all__)
    assert ibdata.open is ibdata.Dataset


def test_the_names_of_the_dynamics():
    assert dynamics.__all__ == DYNAMICS.split()


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'ibdata' has no attribute 'nonsense'"):
        ibdata.nonsense  # noqa: B018 - the access is the test


def test_importing_ibdata_imports_nothing_heavy():
    code = (
        "import sys, ibdata; print([m for m in ('numpy', 'numba', 'pandas', 'pyarrow') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_no_module_names_pickle_or_evaluates_text():
    """Loading a pickle runs code."""
    pickles = (
        r"\b(pickle|cPickle|dill|cloudpickle|joblib|marshal|shelve)\b|allow_pickle=True|\beval\(|\bexec\("
    )
    texts = {path: path.read_text(encoding="utf-8") for path in PACKAGE.rglob("*.py")}
    assert len(texts) > 90
    found = {str(path.relative_to(PACKAGE)) for path, text in texts.items() if re.search(pickles, text)}
    assert found == {"policies/code.py"}  # runs the files of users, who allowed it
