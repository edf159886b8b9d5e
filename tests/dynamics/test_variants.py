"""The two variants as data: every value, every check, and a variant of a user."""

from __future__ import annotations

import dataclasses
import math
import re

import pytest

from ibdata.dynamics import PAPER, SIEMENS, VARIANTS, Variant
from ibdata.dynamics.variants import resolve

NAN = math.nan
# field: (paper, siemens, the rule, what the rule refuses), in the order of the fields
TABLE = {
    "eta_mean": (0.05, 0.1, "in (0, 10]", (0.0, 10.5, NAN)),
    "eta_squash": (
        (1.0, 0.0),
        (2.0, 0.5),
        "keep scale · (σ - shift) in [0, 1] for σ in [½, 1]",
        ((3.0, 0.5), (1.0, 0.6), (1.0, NAN)),  # up to 3 · ½; from 0.5 - 0.6
    ),
    "effective_velocity_ends": (
        ((0.0, 100.0), (100.0, 0.0)),
        ((100.0, 0.0), (0.0, 100.0)),
        "be (0, 100) and (100, 0) in one order or the other",
        (((0.0, 100.0), (0.0, 100.0)), ((0.0, 0.0), (100.0, 100.0)), ((0.0, 100.0), (100.0, NAN))),
    ),
    "bernoulli_bounds": (
        (0.0, 1.0),
        (0.001, 0.999),
        "ordered in [0, 1]",
        ((0.9, 0.1), (-0.1, 1.0), (0.0, 1.1), (NAN, 1.0)),
    ),
    "alpha_threshold": (1.2, 5.0, "in [0, 5]", (-0.1, 5.1, NAN)),
    "convolution_weights": (
        (1 / 9, 2 / 9, 3 / 9, 2 / 9, 1 / 9),
        (0.11111, 0.22222, 0.33333, 0.22222, 0.11111),
        "in [0, 1] and sum to 1 within 1e-4",
        ((0.2, 0.2, 0.2, 0.2, 0.1998), (1.0, 2.0, 3.0, 2.0, 1.0), (-0.1, 0.3, 0.6, 0.3, -0.1), (NAN,) * 5),
    ),
    "consumption_offset": (0.0, 1.0, "in [-100, 100]", (100.5, NAN)),
    "consumption_noise": (0.02, 0.005, "in [0, 0.04]", (-0.001, 0.041, NAN)),
    "drift_rate": (
        (0.0, 1.0),
        (-1.0, 1.0),
        "ordered in [-100, 100]",
        ((1.0, -1.0), (-101.0, 1.0), (0.0, 100.5), (0.0, NAN)),
    ),
    "drift_length": (100, 99, "a whole number in [1, 1e6]", (0, 2.5, 1_000_001, math.inf, NAN)),
    "drift_flip": (
        (0.5, 0.0),
        (0.0, 0.5),
        "two probabilities, one of them 0",
        ((0.0, 1.5), (-0.5, 0.0), (0.5, 0.5), (0.0, NAN)),
    ),
}


def test_each_field_has_the_values_of_the_two_sources():
    found = {name: (getattr(PAPER, name), getattr(SIEMENS, name)) for name in TABLE}
    assert found == {name: (paper, siemens) for name, (paper, siemens, _, _) in TABLE.items()}
    assert [field.name for field in dataclasses.fields(Variant)] == list(TABLE)
    assert all(paper != siemens for paper, siemens in found.values())


@pytest.mark.parametrize("field", TABLE)
def test_a_field_that_breaks_its_rule_is_refused(field):
    rule, values = TABLE[field][2:]
    for value in values:
        found = rf"found Variant\(.*{field}={re.escape(str(value))}"
        with pytest.raises(ValueError, match=f"^variant: {field} must (be )?{re.escape(rule)}; {found}"):
            dataclasses.replace(SIEMENS, **{field: value})


def test_a_variant_is_found_by_its_name_or_is_one():
    mine = dataclasses.replace(PAPER, eta_mean=0.2)
    assert [resolve(x) for x in (*VARIANTS, mine)] == [SIEMENS, PAPER, mine]
    message = "variant: found 'simens', expected one of siemens, paper or a Variant"
    with pytest.raises(ValueError, match=message):
        resolve("simens")
    with pytest.raises(dataclasses.FrozenInstanceError):
        SIEMENS.eta_mean = 0.2
