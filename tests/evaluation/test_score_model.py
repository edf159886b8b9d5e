"""World models are scored over the noise floor."""

from __future__ import annotations

import numpy as np
import pytest

import ibdata
from ibdata.errors import PolicyError, UsageError


def repeated(observations, actions):
    return observations[:, 4:6]


def test_the_errors_of_persistence_are_differences_of_rows(dataset):
    frame = dataset.to_pandas()
    seen = frame[["obs_fatigue", "obs_consumption"]].to_numpy(dtype=np.float64)
    after = frame[["next_obs_fatigue", "next_obs_consumption"]].to_numpy(dtype=np.float64)
    floor = ibdata.noise_floor(dataset)
    found = ibdata.score_model(dataset, repeated, steps=(1, 4), history=3)
    for k, scores in ((1, found.results[:2]), (4, found.results[2:])):
        rows = np.flatnonzero(frame["step"] >= 2)
        rows = rows[
            [i + k <= len(frame) and frame["episode"][i] == frame["episode"][i + k - 1] for i in rows]
        ]
        errors, last = seen[rows] - after[rows + k - 1], rows + k - 1
        for i, score in enumerate(scores):
            assert (score.steps, score.quantity) == (k, ("fatigue", "consumption")[i])
            assert score.root_mean_square_error == pytest.approx(np.sqrt((errors[:, i] ** 2).mean()))
            assert score.mean_absolute_error == pytest.approx(np.abs(errors[:, i]).mean())
            expected = np.sqrt((floor.deviation[last, i] ** 2).mean())
            assert score.floor_root_mean_square_error == pytest.approx(expected)
            assert score.log_likelihood is None


def test_predictions_take_the_places_of_what_is_observed(dataset):
    """A model that adds to its newest value: after three steps, three times; the rest is recorded."""
    known = []

    def rising(observations, actions):
        known.append(observations)
        return observations[:, 4:6] + 1.0

    ibdata.score_model(dataset, rising, steps=3, history=2)
    first, second, third = known
    np.testing.assert_allclose(third[:, 4:6], first[:, 4:6] + 2.0, rtol=1e-6)
    np.testing.assert_array_equal(third[:, 6:], second[:, :6])


def test_the_law_itself_has_the_likelihood_of_the_floor(dataset):
    floor = ibdata.noise_floor(dataset)

    def law(observations, actions):
        return floor.mean, np.maximum(floor.deviation, 1e-9)

    _, consumption = ibdata.score_model(dataset, law, steps=1).results
    error = 4.0 * np.sqrt(0.5 / len(dataset))  # of the mean of half a squared normal number
    assert consumption.log_likelihood == pytest.approx(consumption.floor_log_likelihood, abs=error)
    _, worse = ibdata.score_model(dataset, lambda *_: (floor.mean, floor.deviation * 3 + 1), steps=1).results
    assert worse.log_likelihood < consumption.floor_log_likelihood - 0.3


@pytest.mark.parametrize(
    ("model", "steps", "error", "message"),
    [
        (lambda seen, actions: seen, 1, PolicyError, r"model: step 1: found predictions of shape \(\d+, 6\)"),
        (lambda seen, actions: (seen, seen, seen), 1, PolicyError, "model: step 1: found 3 arrays"),
        (lambda seen, actions: seen[:, 4:6] * np.nan, 1, PolicyError, r"NaN or infinity in (\d+) of \1 "),
        (lambda seen, actions: (seen[:, 4:6], 0 * seen[:, 4:6]), 1, PolicyError, "standard deviation of 0"),
        (repeated, 0, UsageError, "steps: found 0, expected"),
        (repeated, 10**6, UsageError, "steps: found no row"),
    ],
)
def test_what_cannot_be_scored_is_refused(dataset, model, steps, error, message):
    with pytest.raises(error, match=message):
        ibdata.score_model(dataset, model, steps=steps)
