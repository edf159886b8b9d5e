"""Stored rows are read in the parts in which they were simulated, however large a file is."""

from __future__ import annotations

import ibdata
from ibdata.experiment.rollout import Columns, rollout
from ibdata.maintenance import reproduce
from ibdata.validation import rows
from ibdata.writing import stored

PART = 400  # rows


def test_few_rows_are_held_at_a_time(describe, tmp_path, monkeypatch):
    monkeypatch.setattr("ibdata.experiment.rollout.LANES", 10)
    monkeypatch.setattr("ibdata.experiment.rollout.PART_ROWS", PART)
    made = ibdata.generate(describe(episodes=50), tmp_path / "made", workers=1)
    assert len(made.manifest["shards"]) == 1
    held: list[int] = []

    def seen(real):
        def columns(*args):
            found = real(*args)
            held.append(found.table.shape[1])
            return found

        return columns

    monkeypatch.setattr(rows, "PART_ROWS", PART)
    monkeypatch.setattr(stored, "Columns", seen(Columns))
    monkeypatch.setattr("ibdata.writing.summary.rollout", seen(rollout))
    uses = {
        "validate": lambda: ibdata.validate(made.path),
        "materialize": lambda: ibdata.split(made.path, by="policy", materialize=tmp_path / "copy"),
        "repair": lambda: (
            (made.path / "meta/statistics.json").unlink() or ibdata.repair(made.path, workers=1)
        ),
        "reproduce": lambda: reproduce.reproduce(made.path),
    }
    for name, use in uses.items():
        held.clear()
        use()
        assert sum(held) == len(made), name
        assert max(held) <= PART, name
