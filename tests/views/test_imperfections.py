"""Delay, noise, quantisation and missing values: each by itself, together, and step by step."""

from __future__ import annotations

import numpy as np

from ibdata.views.imperfections import Measurement, imperfections_of
from ibdata.views.options import Window, view_options

COLUMNS = ("obs_velocity", "obs_fatigue", "latent_mu_v")
CLEAN = np.random.default_rng(1).normal(50, 20, (400, 3)).astype(np.float32)
EVERYTHING = {
    "delay": {"obs_velocity": 3, "latent_mu_v": 1},
    "noise": {"obs_fatigue": 2.0, "obs_velocity": 0.5},
    "quantise": {"obs_velocity": 0.25},
    "missing": {"obs_velocity": 0.3, "obs_fatigue": 0.1},
    "mask": True,
    "seed": 5,
}


def measured(given, number=7, clean=CLEAN):
    return Measurement(imperfections_of(given), COLUMNS).episode(clean, number)


def test_a_delay_repeats_the_first_value_and_quantised_values_are_the_nearest_multiples():
    seen, lost = measured({"delay": {"obs_fatigue": 4}, "quantise": {"obs_velocity": 0.5}})
    assert (seen[4:, 1] == CLEAN[:-4, 1]).all()
    assert (seen[:4, 1] == CLEAN[0, 1]).all()
    assert (seen[:, 0] * 2 == np.rint(CLEAN[:, 0] * 2)).all()
    assert (seen[:, 2] == CLEAN[:, 2]).all()
    assert (lost.shape, lost.any()) == (CLEAN.shape, False)


def test_noise_is_normal_and_independent():
    """Of 20,000 draws the mean is within 4 standard errors; so are the deviation and the correlations."""
    given = {"noise": {"obs_velocity": 2.0, "obs_fatigue": 3.0}}
    clean = np.zeros((20_000, 3), dtype=np.float32)
    first, other = (measured(given, number, clean)[0] for number in (0, 1))
    error = 4 / np.sqrt(20_000)
    assert (abs(first.mean(axis=0)[:2]) < error * np.array([2.0, 3.0])).all()
    assert (abs(first.std(axis=0)[:2] / [2.0, 3.0] - 1) < error / np.sqrt(2)).all()
    assert abs(np.corrcoef(first[:, 0], first[:, 1])[0, 1]) < error
    assert abs(np.corrcoef(first[:, 0], other[:, 0])[0, 1]) < error
    assert (first[:, 2] == 0).all()
    noise = imperfections_of({"noise": {"obs_fatigue": 3.0}})
    alone, _ = Measurement(noise, COLUMNS[1:2]).episode(clean[:, :1], 0)
    assert (alone[:, 0] == first[:, 1]).all()  # it does not depend on the other columns
    assert not (measured({**given, "seed": 6}, 0, clean)[0][:, :2] == first[:, :2]).any()


def test_its_numbers_are_those_of_all_versions():
    """Also beside a variable that the table of variables does not have yet, whose numbers are its own."""
    columns = ("latent_theta_9", "latent_later", *COLUMNS[1:])
    given = {"noise": dict.fromkeys([*columns, "latent_latest"], 1.0), "seed": 5}
    seen, _ = Measurement(imperfections_of(given), columns).episode(np.zeros((2, 4), dtype=np.float32), 7)
    assert seen[:, [0, 2, 3]].tolist() == [
        [-0.21604406833648682, -2.24025297164917, 0.6631895303726196],
        [0.671513557434082, -1.9204275608062744, 0.4814491271972656],
    ]
    zeros = np.zeros((2, 1), dtype=np.float32)
    later, other = (
        Measurement(imperfections_of(given), (f"latent_{name}",)).episode(zeros, 7)[0]
        for name in ("later", "latest")
    )
    assert later.ravel().tolist() == seen[:, 1].tolist()
    assert not np.isin(later, [*seen[:, [0, 2, 3]].ravel(), *other.ravel()]).any()


def test_a_missing_value_is_the_last_that_arrived():
    seen, lost = measured({"missing": {"obs_fatigue": 0.4}})
    assert not lost[0].any()
    assert abs(lost[:, 1].mean() - 0.4) < 4 * np.sqrt(0.4 * 0.6 / len(CLEAN))
    last = CLEAN[0, 1]
    for value, missing, clean in zip(seen[:, 1], lost[:, 1], CLEAN[:, 1], strict=True):
        last = last if missing else clean
        assert value == last


def test_steps_and_lanes_see_what_whole_episodes_see():
    options = view_options(list(COLUMNS), True, imperfections=EVERYTHING)
    window, history = Window(options, False, 3, 2), 2
    actions = np.random.default_rng(2).uniform(-1, 1, (400, 3, 3)).astype(np.float32)
    clean = np.stack([CLEAN, CLEAN[::-1], CLEAN + 1], axis=1)  # (400, 3 lanes, 3 columns)
    window.begin(np.arange(3), clean[0], np.array([7, 0, 2]))
    window.push(np.array([1]), clean[1, [1]], actions[1, [1]])  # one lane is a step ahead
    window.begin(np.array([1]), clean[0, [1]], np.array([8]))  # and begins another episode
    expected = [measured(EVERYTHING, number, clean[:, i]) for i, number in enumerate((7, 8, 2))]
    for t in range(1, 60):
        order = np.array([2, 0, 1])
        window.push(order, clean[t, order], actions[t, order])
        for i, (seen, lost) in enumerate(expected):
            for age in range(history):
                now = np.concatenate([seen[t - age], lost[t - age, :2], actions[t - age, i] * (t > age)])
                assert window.frames[i, age].tolist() == now.astype(np.float32).tolist()
