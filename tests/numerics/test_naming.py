"""Means, intervals, and names and numbers that other programs read correctly."""

from __future__ import annotations

import itertools
import re
import string

import numpy as np
import pytest
from helpers import tries
from hypothesis import example, given
from hypothesis import strategies as st
from pydantic import TypeAdapter
from ruamel.yaml import YAML

from ibdata._numerics.confidence import mean_estimate, t_quantile
from ibdata._numerics.naming import exact, yaml_name
from ibdata.experiment import Experiment
from ibdata.experiment.fields import SplitName
from ibdata.plan.dataset_spec import DatasetSpec
from ibdata.tools.split_schemes import folds

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
    made = folds(DatasetSpec.of(described(setpoints=setpoints)).setpoints)
    assert len(made) == 2 * len(setpoints)
    for name in made:
        assert TypeAdapter(SplitName).validate_python(name) == name
        assert re.fullmatch("(train|test)-[0-9][0-9_e-]*", name)


# Two-sided 95 % points of Student's t, from printed tables.
TABLE = {1: 12.706, 2: 4.303, 3: 3.182, 4: 2.776, 5: 2.571, 10: 2.228, 30: 2.042, 60: 2.000, 120: 1.980}


@pytest.mark.parametrize(("freedom", "printed"), TABLE.items())
def test_the_quantile_is_that_of_the_printed_tables(freedom, printed):
    assert round(t_quantile(freedom), 3) == printed


def test_groups_count_the_same_whatever_their_size():
    # Means 1 and 4: 2.5. Variances of the means 1/3 (of 0, 1, 2: variance 1) and 0.5 (of 3 and 5: 2 / 2).
    found = mean_estimate([np.array([0.0, 1.0, 2.0]), np.array([3.0, 5.0])])
    assert found.mean == 2.5
    assert found.standard_error == pytest.approx(np.sqrt(1 / 3 + 1.0) / 2)


def test_degrees_of_freedom_are_welch_and_satterthwaites():
    """Of groups alike they are those of all together, of one that varies alone they are its own."""
    alike = np.array([1.0, 2.0, 4.0])
    found = mean_estimate([alike, alike, alike])
    assert found.interval[1] - found.mean == pytest.approx(t_quantile(6) * found.standard_error)
    found = mean_estimate([alike, np.ones(3)])
    assert found.interval[1] - found.mean == pytest.approx(t_quantile(2) * found.standard_error)


def test_equal_values_have_no_error_one_value_an_unknown_one():
    assert mean_estimate([np.full(5, 0.1)]) == (0.1, 0.0, (0.1, 0.1))
    assert mean_estimate([np.array([3.0])]) == (3.0, None, None)
    assert mean_estimate([np.array([3.0]), np.array([1.0, 2.0])])[1:] == (None, None)
