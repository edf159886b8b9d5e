"""Names and numbers that other programs read correctly: setpoints, splits, the front matter of the card."""

from __future__ import annotations

import itertools
import re
import string

import pytest
from helpers import tries
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import TypeAdapter
from ruamel.yaml import YAML

from ibdata._numerics.naming import exact, yaml_name
from ibdata.experiment import Experiment
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fields import SplitName
from ibdata.experiment.split_schemes import leave_one_out

SETPOINTS = st.just(0.0) | st.floats(1e-30, 100.0)
WORDS = [
    *("y", "n", "yes", "no", "on", "off", "true", "false", "null", "inf", "nan", "train", "a-1", "e3"),
    *("0", "10", "017", "0x10", "0x_1", "0o17", "0b11", "12_3", "1_000", "1e3", "1st"),
    *("2020-01-01", "2020-1-1", "1-2"),
]
SHORT = ["".join(letters) for n in (1, 2)
         for letters in itertools.product(string.ascii_lowercase + string.digits + "_-", repeat=n)
         if letters[0] not in "_-"]  # fmt: skip


def described(**changes):
    plain = {"name": "x", "setpoints": 50.0, "policies": [{"kind": "random"}], "steps": 2}
    return Experiment.model_validate({**plain, **changes})


def readers():
    """What reads YAML 1.2, and what reads YAML 1.1 as PyYAML and with it Hugging Face does."""
    newer, older = YAML(typ="safe", pure=True), YAML(typ="safe", pure=True)
    older.version = (1, 1)
    return newer, older


@given(SETPOINTS)
@tries(100)
def test_a_setpoint_is_written_as_what_it_is(p):
    assert float(exact(p)) == p
    if float(f"{p:g}") == p:
        assert exact(p) == f"{p:g}"


@pytest.mark.parametrize("reader", readers(), ids=["1.2", "1.1"])
def test_every_reader_of_yaml_finds_the_names_as_text(reader):
    """Those that are text to all stay as they are."""
    names = [*SHORT, *WORDS]
    found = reader.load("".join(f"- {yaml_name(name)}\n" for name in names))
    assert found == names
    for name in ("train", "test", "target-rest", "test-50", "e3", "nan", "a1"):
        assert yaml_name(name) == name


@given(st.lists(SETPOINTS, min_size=2, max_size=9, unique=True))
@tries(60)
@example([50.0, 50.0000001, 50.0000002, 60.0, 12.5])
def test_no_two_folds_have_one_name_and_each_may_name_a_split(setpoints):
    folds = leave_one_out(DatasetSpec.of(described(setpoints=setpoints)))
    assert len(folds) == 2 * len(setpoints)
    for name in folds:
        assert TypeAdapter(SplitName).validate_python(name) == name
        assert re.fullmatch("(train|test)-[0-9][0-9_e-]*", name)
