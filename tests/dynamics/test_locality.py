"""A field of a variant changes the outputs that are listed for it, and no bit of any other."""

from __future__ import annotations

import dataclasses

import pytest
from helpers import tape

from ibdata.dynamics import PAPER, SIEMENS, Variant
from ibdata.dynamics.state import FIELDS

STEPS, LANES = 300, 32

COST = {"consumption", "reward"}
SEEN_COST = {"expected_consumption"} | COST
FATIGUE = {"alpha", "fatigue", "reward"}
LATENT_FATIGUE = {"mu_v", "mu_g"} | FATIGUE
# A setpoint moves all but the steerings, what follows from them alone, and the length of its segments.
STEERED = {"velocity", "gain", "shift", "basic_fatigue", "drift_left"}
SETPOINT = set(FIELDS) - STEERED

MOVES = {
    "eta_mean": LATENT_FATIGUE,
    "eta_squash": LATENT_FATIGUE,
    "effective_velocity_ends": {"effective_velocity", "mu_v"} | FATIGUE,
    "bernoulli_bounds": LATENT_FATIGUE,
    "alpha_threshold": FATIGUE,
    "convolution_weights": {"convolved_cost"} | SEEN_COST,
    "consumption_offset": SEEN_COST,
    "consumption_noise": COST,
    "drift_rate": SETPOINT,
    "drift_length": SETPOINT | {"drift_left"},
    "drift_flip": SETPOINT,
}
# For constant setpoints the fields of the moving one do nothing.
MOVES_AT_REST = MOVES | {"drift_rate": set(), "drift_length": set(), "drift_flip": set()}


@pytest.fixture(scope="module")
def drawn():
    return tape.draw(2017, STEPS, LANES)


@pytest.fixture(scope="module")
def unchanged(drawn):
    """The states of both variants as they are shipped, with moving and with constant setpoints."""
    return {
        (base, drifting): tape.stack(tape.play(tape.start(LANES, drifting), drawn, base))
        for base in (SIEMENS, PAPER)
        for drifting in ("all", "none")
    }


@pytest.mark.parametrize("drifting", ["all", "none"])
@pytest.mark.parametrize(("base", "donor"), [(SIEMENS, PAPER), (PAPER, SIEMENS)], ids=["siemens", "paper"])
@pytest.mark.parametrize("field", [field.name for field in dataclasses.fields(Variant)])
def test_one_field_of_the_other_variant_changes_the_listed_outputs_only(
    drawn, unchanged, field, base, donor, drifting
):
    variant = dataclasses.replace(base, **{field: getattr(donor, field)})
    states = tape.stack(tape.play(tape.start(LANES, drifting), drawn, variant))
    expected = MOVES if drifting == "all" else MOVES_AT_REST
    assert tape.changed(unchanged[base, drifting], states) == expected[field]


def test_all_fields_of_the_other_variant_are_the_other_variant(drawn, unchanged):
    fields = {field.name: getattr(PAPER, field.name) for field in dataclasses.fields(Variant)}
    states = tape.stack(tape.play(tape.start(LANES, "all"), drawn, dataclasses.replace(SIEMENS, **fields)))
    assert tape.changed(unchanged[PAPER, "all"], states) == set()


def test_the_table_of_outputs_names_every_field_of_a_variant():
    assert list(MOVES) == [field.name for field in dataclasses.fields(Variant)]
