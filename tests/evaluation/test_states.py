"""The exact states behind the rows of datasets."""

from __future__ import annotations

import numpy as np
import pyarrow.parquet as pq
import pytest
from helpers import by_hand

import ibdata
from ibdata import state_at
from ibdata.errors import DatasetError, UsageError


def equal(found, expected):
    """Equal states, bit for bit."""
    np.testing.assert_array_equal(found.values, expected.values)


def test_a_step_leads_from_each_state_to_the_next(either):
    """With the action in the row and the noise at its address; so what the rows do not show is right too."""
    frame = either.to_pandas()
    frame = frame[frame["step"] < 39]
    episodes, steps = frame["episode"].to_numpy(), frame["step"].to_numpy()
    before, after = state_at(either, (episodes, steps)), state_at(either, (episodes, steps + 1))
    experiment = by_hand.experiment_of(either)
    for i in range(0, len(frame), 41):
        row = frame.iloc[i]
        cell, index = divmod(int(row["episode"]), experiment.episodes)
        noise = by_hand.noise(
            experiment.seed, experiment.cells[cell].digest, index, int(row["step"]) + 1, experiment.drifting
        )
        action = row[["act_velocity", "act_gain", "act_shift"]].to_numpy(dtype=np.float32)
        made = by_hand.moved(by_hand.lane(before, i), action, noise, experiment.scenario.variant)
        equal(made, by_hand.lane(after, i))


def test_one_row_is_one_lane_and_rows_may_come_in_any_order(dataset):
    one = state_at(dataset, (7, 31))
    assert one.fatigue.shape == (1,)
    several = state_at(dataset, (np.array([7, 2, 7, 11]), [31, 0, 5, 31]))
    equal(by_hand.lane(several, 0), one)
    equal(by_hand.lane(several, 1), state_at(dataset, (2, 0)))
    equal(by_hand.lane(several, 3), state_at(dataset, (11, 31)))
    equal(state_at(str(dataset.path), (7, 31)), one)
    equal(state_at(dataset, ([7, 7], 31)), one.take(np.array([0, 0])))


def test_a_merged_dataset_has_the_states_of_its_parts(dataset, describe, tmp_path):
    """Another seed and shorter episodes come after those of `dataset`."""
    changes = {"seed": 5, "steps": 20, "output": {"latent": "next", "shard_rows": 50}}
    other = ibdata.generate(describe(**changes), tmp_path / "other", workers=1)
    both = ibdata.merge([dataset.path, other.path], tmp_path / "merged")
    frame = both.to_pandas(columns=["obs_fatigue", "obs_consumption", "episode", "step"])
    states = state_at(both, (frame["episode"], frame["step"]))
    np.testing.assert_array_equal(states.fatigue.astype(np.float32), frame["obs_fatigue"])
    pair = by_hand.side_by_side(state_at(dataset, (3, 39)), state_at(other, (4, 19)))
    equal(state_at(both, ([3, 12 + 4], [39, 19])), pair)


WAYS = "(episode, step), or an array of pairs of them (n, 2), or of numbers of rows"


def test_rows_that_might_be_meant_in_two_ways_are_refused(dataset):
    for rows in ([3, 10], (3, 10, 17), ((3, 10), (4, 17))):
        with pytest.raises(UsageError) as caught:
            state_at(dataset, rows)
        assert str(caught.value) == f"rows: found {rows}, expected {WAYS}"


@pytest.mark.parametrize(
    ("episode", "step", "message"),
    [
        (12, 0, "episode: found 12, expected one of 0 to 11"),
        ([3, 4], [5, 40], "step: found 40, expected one of 0 to 39, the steps of episode 4"),
        (1.5, 0, "episode: found 1.5, expected whole numbers"),
        (0, "last", "step: found 'last', expected whole numbers"),
        ([1, 2, 3], [1, 2], "episode and step: found 3 and 2 numbers, expected equally many"),
    ],
)
def test_rows_that_are_not_there_are_one_line(dataset, episode, step, message):
    with pytest.raises(UsageError) as caught:
        state_at(dataset, (episode, step))
    assert str(caught.value) == message


def damage(folder, column, row, value):
    """Change a value of the first shard."""
    path = next((folder / "data").glob("part-00000-*"))
    table = pq.read_table(path)
    values = table[column].to_numpy().copy()
    values[row] = value
    field = table.schema.field(column)
    pq.write_table(table.set_column(table.schema.get_field_index(column), field, [values]), path)


@pytest.mark.parametrize(
    ("column", "value", "message"),
    [
        ("obs_fatigue", 12.5, "episode 1: step 10: obs_fatigue: found 12.5, expected "),
        ("latent_mu_g", 0.5, "episode 1: step 10: latent_mu_g: found 0.5, expected "),
        ("act_gain", 0.25, "episode 1: step 10: reward: found -"),
        ("reward", np.nan, "episode 1: step 10: reward: found nan, expected -"),
    ],
)
def test_rows_that_the_simulation_does_not_give_are_one_line(copied, column, value, message):
    damage(copied, column, 40 + 10, value)
    ds = ibdata.open(copied)
    with pytest.raises(DatasetError) as caught:
        state_at(ds, (1, 10))
    assert str(caught.value).startswith(f"{copied}: {message}")
    assert str(caught.value).endswith("see ibdata validate")
    equal(state_at(ds, (1, 9)), state_at(ds, ([1], [9])))  # rows after the given one do not matter
