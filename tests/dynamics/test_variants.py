"""The two variants as data: every value, every check, and a variant of a user."""

from __future__ import annotations

import dataclasses
import math
import re

import pytest
from helpers.examples import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.dynamics import PAPER, SIEMENS, VARIANTS, Variant
from ibdata.dynamics.fatigue import effective_velocity
from ibdata.dynamics.variants import Parameters, resolve

examples = tries(300)
percent = st.floats(0.0, 100.0)

# field: (paper, siemens), in the order of the fields
TABLE = {
    "eta_mean": (0.05, 0.1),
    "eta_squash": ((1.0, 0.0), (2.0, 0.5)),
    "effective_velocity_ends": (((0.0, 100.0), (100.0, 0.0)), ((100.0, 0.0), (0.0, 100.0))),
    "bernoulli_bounds": ((0.0, 1.0), (0.001, 0.999)),
    "alpha_threshold": (1.2, 5.0),
    "convolution_weights": (
        (1 / 9, 2 / 9, 3 / 9, 2 / 9, 1 / 9),
        (0.11111, 0.22222, 0.33333, 0.22222, 0.11111),
    ),
    "consumption_offset": (0.0, 1.0),
    "consumption_noise": (0.02, 0.005),
    "drift_rate": ((0.0, 1.0), (-1.0, 1.0)),
    "drift_length": (100, 99),
    "drift_flip": ((0.5, 0.0), (0.0, 0.5)),
}


def test_the_table_names_every_field():
    assert [field.name for field in dataclasses.fields(Variant)] == list(TABLE)


@pytest.mark.parametrize("name", TABLE)
def test_each_field_has_the_value_of_its_source(name):
    assert (getattr(PAPER, name), getattr(SIEMENS, name)) == TABLE[name]


def test_the_variants_differ_in_every_field():
    assert [name for name in TABLE if getattr(PAPER, name) == getattr(SIEMENS, name)] == []


def test_the_kernel_gets_the_numbers_of_the_fields_in_order():
    w = (0.11111, 0.22222, 0.33333, 0.22222, 0.11111)
    expected = (
        0.1,
        2.0,
        0.5,
        100.0,
        0.0,
        0.0,
        100.0,
        0.001,
        0.999,
        5.0,
        w,
        1.0,
        0.005,
        -1.0,
        1.0,
        99.0,
        0.0,
        0.5,
    )
    assert SIEMENS.parameters == Parameters(*expected)


@pytest.mark.parametrize("variant", [PAPER, SIEMENS])
def test_the_kernel_gets_floats_only_so_that_it_is_compiled_once(variant):
    whole = dataclasses.replace(variant, alpha_threshold=5, consumption_offset=1, bernoulli_bounds=(0, 1))
    flat = [*whole.parameters._replace(weights=0.0), *whole.parameters.weights]
    assert {type(x) for x in flat} == {float}


ENDS = "effective_velocity_ends must be (0, 100) and (100, 0) in one order or the other"
WEIGHTS = "convolution_weights must be in [0, 1] and sum to 1 within 1e-4"
SQUASH = "eta_squash must keep scale · (σ - shift) in [0, 1] for σ in [½, 1]"
LENGTH = "drift_length must be a whole number in [1, 1e6]"
FLIP = "drift_flip must be two probabilities, one of them 0"
BROKEN = [
    ("eta_mean", 0.0, "eta_mean must be in (0, 10]"),
    ("eta_mean", 10.5, "eta_mean must be in (0, 10]"),
    ("eta_mean", math.nan, "eta_mean must be in (0, 10]"),
    ("eta_squash", (3.0, 0.5), SQUASH),  # up to 3 · ½
    ("eta_squash", (1.0, 0.6), SQUASH),  # from 0.5 - 0.6
    ("eta_squash", (-1.0, 1.0), SQUASH),
    ("eta_squash", (math.inf, 0.5), SQUASH),
    ("eta_squash", (1.0, math.nan), SQUASH),
    ("effective_velocity_ends", ((0.0, 100.0), (0.0, 100.0)), ENDS),
    ("effective_velocity_ends", ((0.0, 0.0), (100.0, 100.0)), ENDS),
    ("effective_velocity_ends", ((0.0, 100.0), (100.0, math.nan)), ENDS),
    ("bernoulli_bounds", (0.9, 0.1), "bernoulli_bounds must be ordered in [0, 1]"),
    ("bernoulli_bounds", (-0.1, 1.0), "bernoulli_bounds must be ordered in [0, 1]"),
    ("bernoulli_bounds", (0.0, 1.1), "bernoulli_bounds must be ordered in [0, 1]"),
    ("bernoulli_bounds", (math.nan, 1.0), "bernoulli_bounds must be ordered in [0, 1]"),
    ("alpha_threshold", -0.1, "alpha_threshold must be in [0, 5]"),
    ("alpha_threshold", 5.1, "alpha_threshold must be in [0, 5]"),
    ("alpha_threshold", math.nan, "alpha_threshold must be in [0, 5]"),
    ("convolution_weights", (0.2, 0.2, 0.2, 0.2, 0.1998), WEIGHTS),
    ("convolution_weights", (1.0, 2.0, 3.0, 2.0, 1.0), WEIGHTS),
    ("convolution_weights", (-0.1, 0.3, 0.6, 0.3, -0.1), WEIGHTS),
    ("convolution_weights", (0.2, 0.2, math.nan, 0.2, 0.2), WEIGHTS),
    ("consumption_offset", 100.5, "consumption_offset must be in [-100, 100]"),
    ("consumption_offset", math.nan, "consumption_offset must be in [-100, 100]"),
    ("consumption_noise", -0.001, "consumption_noise must be in [0, 0.04]"),
    ("consumption_noise", 0.041, "consumption_noise must be in [0, 0.04]"),
    ("consumption_noise", math.nan, "consumption_noise must be in [0, 0.04]"),
    ("drift_rate", (1.0, -1.0), "drift_rate must be ordered in [-100, 100]"),
    ("drift_rate", (-101.0, 1.0), "drift_rate must be ordered in [-100, 100]"),
    ("drift_rate", (0.0, 100.5), "drift_rate must be ordered in [-100, 100]"),
    ("drift_rate", (0.0, math.nan), "drift_rate must be ordered in [-100, 100]"),
    ("drift_length", 0, LENGTH),
    ("drift_length", 2.5, LENGTH),
    ("drift_length", 1_000_001, LENGTH),
    ("drift_length", math.inf, LENGTH),
    ("drift_length", math.nan, LENGTH),
    ("drift_flip", (0.0, 1.5), FLIP),
    ("drift_flip", (-0.5, 0.0), FLIP),
    ("drift_flip", (0.5, 0.5), FLIP),
    ("drift_flip", (0.0, math.nan), FLIP),
]


def test_every_field_has_a_value_that_is_refused():
    assert {field for field, _, _ in BROKEN} == set(TABLE)


@pytest.mark.parametrize(("field", "value", "rule"), BROKEN)
def test_a_field_that_cannot_be_meant_is_refused_with_its_rule_and_what_was_found(field, value, rule):
    with pytest.raises(ValueError, match=re.escape(rule)) as error:
        dataclasses.replace(SIEMENS, **{field: value})
    assert str(error.value).startswith(f"variant: {rule}; found Variant(")
    assert f"{field}={value}" in str(error.value)


def test_all_broken_rules_are_named_at_once():
    with pytest.raises(
        ValueError, match=r"eta_mean must be in .*; consumption_noise must be in \[0, 0.04\]; found"
    ):
        dataclasses.replace(PAPER, eta_mean=-1.0, consumption_noise=-1.0)


def test_resolve_knows_both_names_and_passes_a_variant_through():
    mine = dataclasses.replace(PAPER, eta_mean=0.2)
    assert resolve("siemens") is SIEMENS
    assert resolve("paper") is PAPER
    assert resolve(mine) is mine
    assert list(VARIANTS) == ["siemens", "paper"]


def test_resolve_lists_the_names_when_it_knows_none_like_it():
    with pytest.raises(
        ValueError, match="variant: found 'simens', expected one of siemens, paper or a Variant"
    ):
        resolve("simens")


def test_a_users_variant_is_a_replaced_field_of_a_shipped_one():
    mine = dataclasses.replace(PAPER, eta_mean=0.1)
    differing = [
        f.name for f in dataclasses.fields(Variant) if getattr(mine, f.name) != getattr(PAPER, f.name)
    ]
    assert differing == ["eta_mean"]
    assert mine.parameters == PAPER.parameters._replace(eta_mean=0.1)
    assert PAPER.eta_mean == 0.05


def test_a_variant_cannot_be_changed_in_place():
    with pytest.raises(dataclasses.FrozenInstanceError):
        SIEMENS.eta_mean = 0.2


@examples
@given(v=percent, g=percent, p=percent)
def test_the_effective_velocities_of_the_two_variants_sum_to_one(v, g, p):
    ends = [variant.parameters[3:7] for variant in (PAPER, SIEMENS)]
    assert sum(effective_velocity(v, g, p, *end) for end in ends) == pytest.approx(1.0, abs=1e-14)
