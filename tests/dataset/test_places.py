"""Rows are found by their places: the head of a dataset, and the numbers of what a view shows."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.errors import UsageError


@pytest.mark.parametrize("at", [(0, 0), (3, 11), (11, 31)])
def test_head_reads_on_from_a_row_to_the_end(dataset, at):
    frame = dataset.to_pandas()
    first = int(np.flatnonzero((frame["episode"] == at[0]) & (frame["step"] == at[1]))[0])
    found = dataset.head(40, at=at).to_pandas(ignore_metadata=True)
    assert found.equals(frame.iloc[first : first + 40].reset_index(drop=True))
    assert dataset.head(2, ["reward"]).num_rows == 2


@pytest.mark.parametrize(
    "given", [{"at": (99, 0)}, {"at": (0, 40)}, {"at": 3}, {"at": (0, 0), "split": "target"}], ids=str
)
def test_head_refuses_what_is_no_row(dataset, given):
    with pytest.raises(UsageError, match="at: found"):
        dataset.head(**given)


def test_a_view_has_the_numbers_of_its_rows(dataset):
    view = {"observe": "markov", "reward": "delta"}
    seen = dataset.to_pandas(view=view, split="target")
    arrays = dataset.arrays(split="target", view=view)
    rows = dataset.to_pandas().loc[seen.index]
    assert (seen["reward"] == arrays["rewards"]).all()
    places = ["episode", "step"]
    assert rows[places].equals(seen[places])
    assert dataset.table(view=view).num_rows == len(dataset.arrays(view=view)["rewards"])
