"""The noise floor of a dataset agrees with many next steps from its states, and with its own next rows."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helpers import FULL
from helpers.refusals import refused
from helpers.variants import VARIANTS_MOVED

import ibdata
from ibdata import noise_floor, state_at
from ibdata.dynamics import PAPER, Noise, initial_state, step
from ibdata.evaluation.world_models import _law

DRAWS = 40_000 if FULL else 10_000


def noise_of(rng, draws):
    laws = {"exp": rng.exponential, "normal": rng.standard_normal}
    return Noise(*(laws.get(name.split("_")[0], rng.random)(size=draws) for name in Noise._fields))


def next_steps(ds, row, dynamics, seed=0):
    """Fatigue and consumption (2, draws) after many steps from the state of a row with its action."""
    rng = np.random.default_rng(seed)
    one = state_at(ds, (int(row["episode"]), int(row["step"])))
    state = one.take(np.zeros(DRAWS, dtype=int))
    action = row[["act_velocity", "act_gain", "act_shift"]].to_numpy(dtype=np.float64)
    after = step(state, np.tile(action, (DRAWS, 1)), noise_of(rng, DRAWS), dynamics)
    return np.stack([after.fatigue, after.consumption])


@pytest.mark.parametrize("dynamics", ["siemens", "paper"])
def test_it_is_that_of_many_next_steps_from_the_same_state(describe, tmp_path, dynamics):
    experiment = describe(dynamics=dynamics, steps=150, episodes=1, output={"latent": False})
    ds = ibdata.generate(experiment, tmp_path / "made", workers=1)
    found, frame = noise_floor(ds), ds.to_pandas()
    for i in (0, 3, 140, 290, 460, 599):
        drawn = next_steps(ds, frame.iloc[i], dynamics)
        mean, spread = drawn.mean(axis=1), drawn.std(axis=1)
        absolute = np.abs(drawn - np.median(drawn, axis=1)[:, None])
        squares = (drawn - mean[:, None]) ** 2
        assert np.all(np.abs(found.mean[i] - mean) <= 4 * spread / np.sqrt(DRAWS) + 1e-9)
        error = squares.std(axis=1) / np.sqrt(DRAWS)
        assert np.all(np.abs(found.deviation[i] ** 2 - squares.mean(axis=1)) <= 4 * error + 1e-9)
        error = absolute.std(axis=1) / np.sqrt(DRAWS)
        assert np.all(np.abs(found.absolute[i] - absolute.mean(axis=1)) <= 4 * error + 0.005 * spread)


@pytest.mark.parametrize("variant", VARIANTS_MOVED.values(), ids=VARIANTS_MOVED)
def test_the_law_is_that_of_many_steps_where_any_field_of_the_dynamics_is_another(variant):
    """At 5 standard errors, which all 1,500 comparisons pass in 99.9 % of the cases."""
    rng, states, draws = np.random.default_rng(5), 8, 4000
    starts = initial_state(*rng.uniform(0, 100, (4, states))).replace(
        mu_v=rng.uniform(0, 1.4, states),
        mu_g=rng.uniform(0, 1.4, states),
        operational_cost=rng.uniform(1, 900, (states, 10)),
    )
    actions, lanes = rng.uniform(-1, 1, (states, 3)), np.repeat(np.arange(states), draws)
    after = step(starts.take(lanes), actions[lanes], noise_of(rng, len(lanes)), variant)
    drawn = np.stack([after.fatigue, after.consumption]).reshape(2, states, draws)
    mean, deviation, absolute = np.transpose(_law(starts, actions, variant), (1, 2, 0))
    squares = (drawn - mean[..., None]) ** 2
    from_median = np.abs(drawn - np.median(drawn, axis=2, keepdims=True))
    for found, expected, least in (
        (drawn, mean, 1e-3 * deviation),
        (squares, deviation**2, 1e-2 * deviation**2),
        (from_median, absolute, 1e-2 * deviation),
    ):
        error = found.std(axis=2) / np.sqrt(draws)
        assert (np.abs(found.mean(axis=2) - expected) <= 5 * error + least).all()


def test_an_almost_certain_fatigue_has_a_floor():
    """Where α is almost certain, its variance is a difference that rounding makes negative."""
    sharp = dataclasses.replace(PAPER, eta_mean=0.003, bernoulli_bounds=(1.0, 1.0))
    starts = initial_state(np.linspace(60, 90, 500), 0.0, 99.0)
    assert np.isfinite(_law(starts, np.zeros((500, 3)), sharp)).all()


def test_the_errors_are_means_over_the_rows_asked_for(dataset):
    whole, part = noise_floor(dataset), noise_floor(dataset.select("target", policy="calm"))
    frame = dataset.to_pandas()
    own = dataset.select("target", policy="calm").to_pandas()
    inside = frame["episode"].isin(own["episode"]).to_numpy()
    np.testing.assert_array_equal(part.mean, whole.mean[inside])
    fatigue, consumption = part.results
    assert (fatigue.quantity, consumption.quantity) == ("fatigue", "consumption")
    deviation = whole.deviation[inside]
    assert fatigue.root_mean_square_error == pytest.approx(np.sqrt((deviation[:, 0] ** 2).mean()))
    assert consumption.mean_absolute_error == pytest.approx(np.sqrt(2 / np.pi) * deviation[:, 1].mean())
    assert part.plain() == {"rows": len(own), "results": [r._asdict() for r in part.results]}
    assert f"over {len(own)} rows" in repr(part)


def test_unknown_laws_and_empty_selections_are_refused(describe, tmp_path, dataset):
    custom = describe(dynamics={"base": "siemens", "eta_squash": [1.0, 0.5]}, steps=2, episodes=1)
    made = ibdata.generate(custom, tmp_path / "made", workers=1)
    refused("found eta_squash", noise_floor, made)
    refused("no episode that meets all", noise_floor, dataset.select("source", setpoint=70))
