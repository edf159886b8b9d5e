"""A field of a variant, or a draw, changes the outputs that are listed for it, and no bit of any other."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helpers import tape

from ibdata.dynamics import PAPER, SIEMENS, Noise, Variant
from ibdata.dynamics.state import FIELDS

STEPS, LANES = 300, 32
COST = {"consumption", "reward"}
SEEN_COST = {"expected_consumption"} | COST
FATIGUE = {"alpha", "fatigue", "reward"}
LATENT_FATIGUE = {"mu_v", "mu_g"} | FATIGUE
# A setpoint moves all but the steerings and what follows from them alone.
SETPOINT = set(FIELDS) - {"velocity", "gain", "shift", "basic_fatigue"}
RATE = SETPOINT - {"drift_left"}

FIELD_MOVES = {
    "eta_mean": LATENT_FATIGUE,
    "eta_squash": LATENT_FATIGUE,
    "effective_velocity_ends": {"effective_velocity", "mu_v"} | FATIGUE,
    "bernoulli_bounds": LATENT_FATIGUE,
    "alpha_threshold": FATIGUE,
    "convolution_weights": {"convolved_cost"} | SEEN_COST,
    "consumption_offset": SEEN_COST,
    "consumption_noise": COST,
    "drift_rate": RATE,
    "drift_length": SETPOINT,
    "drift_flip": RATE,
}
DRAW_MOVES = {
    **{f"{name}_v": {"mu_v"} | FATIGUE for name in ("exp", "bernoulli", "uniform")},
    **{f"{name}_g": {"mu_g"} | FATIGUE for name in ("exp", "bernoulli", "uniform")},
    "normal_alpha": FATIGUE,
    "normal_consumption": COST,
    "uniform_drift_length": SETPOINT,
    **{f"uniform_drift_{name}": RATE for name in ("rate", "zero", "flip")},
}
variants = pytest.mark.parametrize("variant", [SIEMENS, PAPER], ids=["siemens", "paper"])
moving = pytest.mark.parametrize("drifting", ["all", "none"])


@pytest.fixture(scope="module")
def drawn():
    return tape.draw(2017, STEPS, LANES)


@pytest.fixture(scope="module")
def unchanged(drawn):
    """The states of both variants as they are shipped, with moving and with constant setpoints."""
    return {(base, drifting): states(drawn, base, drifting)
            for base in (SIEMENS, PAPER) for drifting in ("all", "none")}  # fmt: skip


def states(drawn, variant, drifting):
    return tape.stack(tape.play(tape.start(LANES, drifting), drawn, variant))


@moving
@variants
@pytest.mark.parametrize("field", FIELD_MOVES)
def test_a_field_of_the_other_variant_moves_the_listed_only(drawn, unchanged, field, variant, drifting):
    """Those of the moving setpoint move nothing where it is constant."""
    other = PAPER if variant is SIEMENS else SIEMENS
    changed = dataclasses.replace(variant, **{field: getattr(other, field)})
    expected = set() if drifting == "none" and field.startswith("drift") else FIELD_MOVES[field]
    assert tape.changed(unchanged[variant, drifting], states(drawn, changed, drifting)) == expected


@moving
@variants
@pytest.mark.parametrize("name", DRAW_MOVES)
def test_a_draw_moves_the_listed_only(drawn, unchanged, name, variant, drifting):
    """Over a tape in which that one draw is made anew at every step."""
    other = tape.noise(np.random.default_rng(24), STEPS, LANES)
    changed = tape.Tape(drawn.actions, drawn.noise._replace(**{name: getattr(other, name)}))
    expected = set() if drifting == "none" and "drift" in name else DRAW_MOVES[name]
    assert tape.changed(unchanged[variant, drifting], states(changed, variant, drifting)) == expected


def test_the_tables_name_every_field_and_every_draw():
    assert list(FIELD_MOVES) == [field.name for field in dataclasses.fields(Variant)]
    assert set(DRAW_MOVES) == set(Noise._fields)
