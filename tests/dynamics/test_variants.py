"""The two variants as data: every value, every check, and a variant of a user."""

from __future__ import annotations

import dataclasses
import re

import pytest
from helpers.variants import FIELDS

from ibdata.dynamics import PAPER, SIEMENS, VARIANTS
from ibdata.dynamics.variants import resolve


def test_each_field_has_the_values_of_the_two_sources():
    found = {name: (getattr(PAPER, name), getattr(SIEMENS, name)) for name in FIELDS}
    assert found == {name: (field.paper, field.siemens) for name, field in FIELDS.items()}


@pytest.mark.parametrize("field", FIELDS)
def test_a_field_that_breaks_its_rule_is_refused(field):
    rule = FIELDS[field].rule
    for value in FIELDS[field].refused:
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


def test_a_value_of_another_form_is_refused():
    with pytest.raises(
        ValueError, match=r"^variant: eta_squash: found \(1.0, 0.0, 0.0\), expected the form of"
    ):
        dataclasses.replace(SIEMENS, eta_squash=(1.0, 0.0, 0.0))
