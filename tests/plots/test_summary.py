"""Every row is counted in each histogram of a dataset's pictures; they need matplotlib, and this does not."""

import numpy as np

from ibdata.plots.summary import DRAWN_COSTS, PAIRS, STEERING_EDGES, STEERINGS, Summary


def test_every_row_is_counted_in_its_bin(dataset):
    counts, rows = Summary(dataset).counts, dataset.to_pandas()
    assert counts.rows.tolist() == [[120, 120], [120, 120]]  # setpoints by policies
    assert (counts.rewards.sum(axis=2) == counts.rows).all()
    assert (counts.actions.sum(axis=2) == 240).all()
    for number, (a, b) in enumerate(PAIRS):
        expected, *_ = np.histogram2d(rows[STEERINGS[a]], rows[STEERINGS[b]], [STEERING_EDGES] * 2)
        assert (counts.coverage[:, number].sum(axis=0) == expected).all()
    expected, *_ = np.histogram2d(*(rows[name].astype(float) for name in DRAWN_COSTS), counts.cost_edges)
    assert (counts.costs == expected).all()
    assert expected.sum() > 400
    means = rows.groupby(["obs_setpoint", "policy"], observed=True)[list(DRAWN_COSTS)].mean()
    np.testing.assert_allclose(
        np.sort(counts.mean_costs.reshape(4, 2), axis=0), np.sort(means, axis=0), rtol=1e-5
    )
