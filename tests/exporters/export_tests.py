"""What holds for every export: a class of tests that whoever reads a format subclasses."""

from __future__ import annotations

import json
import resource
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
from exporters.reading import files, holds

import ibdata
from ibdata.errors import IbdataError, UsageError
from ibdata.exporters import Exported

VIEWS = {
    "hidden": (1, {"observe": "markov", "imperfections": {"missing": {"latent_mu_v": 0.2}}}),
    "markov": (4, {"observe": "markov", "actions": True, "reward": {"consumption": 1, "fatigue": 1}}),
    "troubles": (
        3,
        {
            "imperfections": {"delay": {"obs_fatigue": 3}, "missing": {"obs_velocity": 0.2}, "mask": True},
            "reward": "delta",
            "reward_scale": 0.1,
        },
    ),
    "one number": (1, {"observe": ["obs_fatigue"], "reward_scale": 0.1}),
}
COSTS = ("csv", "d4rl", "lerobot", "minari", "npz")  # formats that have a place for them


def one_setpoint(to: str) -> str | None:
    """The split to export: NeoRL's format holds one setpoint."""
    return "target" if to == "neorl" else None


def said(folder: Path) -> Any:
    """What an export in a folder says of itself, which is JSON among its bytes; None if it says nothing."""
    texts = (data.decode("latin-1").replace('\\"', '"') for data in files(folder).values())
    for text in texts:
        if (start := text.find('{"content_root"')) >= 0:
            return json.JSONDecoder().raw_decode(text[start:])[0]
    return None


class ExportTests:
    """An export holds every value of the arrays, says what it shows, and is complete or absent.

    Subclasses give the format and `read`, which runs the snippet if its library is there.
    """

    format: str

    def read(self, made: Exported) -> dict[str, Any]:
        """The arrays of an export, those that it has, by the names of `Dataset.arrays`."""
        raise NotImplementedError

    @pytest.fixture
    def to(self):
        return self.format

    @pytest.fixture
    def dataset(self, doubles):
        return doubles

    @pytest.mark.parametrize(("history", "view"), VIEWS.values(), ids=VIEWS)
    def test_every_value_of_the_arrays_is_there_again(
        self, dataset, tmp_path, to, history, view, small_blocks
    ):
        """And the export says what it shows; blocks of any size give the same values."""
        small_blocks(exported_rows=30 if history == 3 else 10**6)
        made = ibdata.export(dataset, to, tmp_path / "made", split="target", history=history, view=view)
        assert (made.format, made.rows, made.episodes) == (to, 160, 4)
        assert made.frame == dataset.windows(view=view).frame
        holds(made, dataset, "target", history, view, self.read)
        found = said(tmp_path)
        if to == "csv":  # which has no place for it
            assert found is None
            return
        assert tuple(found["frame"]) == made.frame
        assert (found["history"], found["split"], found["content_root"]) == (
            history,
            "target",
            dataset.content_root,
        )
        assert found["reward"] == view.get("reward", "classic")
        assert ("episodes" in found) == bool(found["imperfections"])
        assert found["imperfections"].get("delay") == view.get("imperfections", {}).get("delay")

    def test_costs_have_a_place_or_are_refused(self, dataset, tmp_path, to):
        view, split = {"cost": {"fatigue": 20}}, one_setpoint(to)
        if to not in COSTS:
            with pytest.raises(
                UsageError, match=f"^cost: found one, but the format {to} has no place for costs"
            ):
                ibdata.export(dataset, to, tmp_path / "made", split=split, view=view)
            return
        made = ibdata.export(dataset, to, tmp_path / "made", view=view)
        found = holds(made, dataset, view=view, read=self.read)
        assert 0 < found["costs"].sum() < made.rows

    def test_it_says_what_it_made_and_leaves_nothing_beside_it(self, dataset, tmp_path, to):
        out, view = tmp_path / "new" / "folder" / "made", {"reward_scale": 0.5}
        made = ibdata.export(dataset, to, out, split=one_setpoint(to), view=view)
        holds(made, dataset, one_setpoint(to), made.history, view, self.read)
        assert made.reward_scale == 0.5
        assert (made.rows, made.episodes) == ((160, 4) if to == "neorl" else (480, 12))
        assert made.history == (30 if to == "neorl" else 1)
        assert Path(made.path).exists()
        compile(made.snippet, to, "exec")
        assert [path.name for path in out.parent.iterdir()] == ["made"]
        assert not list(tmp_path.rglob(".*"))

    def test_rows_without_a_next_frame_are_left_out_and_counted(self, tmp_path, to):
        given = {"name": "x", "setpoints": 20, "policies": ["random"], "episodes": 4, "steps": 9}
        dataset, view = ibdata.generate(given, tmp_path / "data", workers=1), {"observe": "markov"}
        made = ibdata.export(dataset, to, tmp_path / "made", history=2, view=view)
        assert (made.rows, made.episodes, made.left_out) == (32, 4, 4)
        holds(made, dataset, history=2, view=view, read=self.read)

    def test_it_is_replaced_only_when_that_is_said(self, dataset, tmp_path, to, monkeypatch):
        """And stays if the one that is to replace it fails."""
        options = {"split": "target", "history": 2}
        ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to), view={"observe": "markov"})
        before = files(tmp_path)
        with pytest.raises(UsageError, match=r"exists already; .* or overwrite=True to replace an export"):
            ibdata.export(dataset, to, tmp_path / "made", **options)
        with monkeypatch.context() as full:
            full.setattr("ibdata.exporters._target.files.sync_all", Mock(side_effect=OSError(28, "no room")))
            with pytest.raises(IbdataError, match="cannot be written: no room"):
                ibdata.export(dataset, to, tmp_path / "made", **options, overwrite=True)
        assert files(tmp_path) == before
        made = ibdata.export(dataset, to, tmp_path / "made", **options, overwrite=True)
        holds(made, dataset, **options, read=self.read)
        assert set(files(tmp_path)) == set(before)

    @pytest.mark.parametrize("share", [0.0, 0.05, 0.5, 0.9])
    def test_a_write_that_fails_is_one_line(self, dataset, tmp_path, to, share):
        """HDF5 would end the process with a segmentation fault, or close the file without a word."""
        ibdata.export(dataset, to, tmp_path / "whole", split=one_setpoint(to))
        before, limits = files(tmp_path), resource.getrlimit(resource.RLIMIT_FSIZE)
        largest = max(map(len, before.values()))
        resource.setrlimit(resource.RLIMIT_FSIZE, (int(share * largest), limits[1]))
        try:
            with pytest.raises(IbdataError, match=r"cannot be written: .*File too large"):
                ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert files(tmp_path) == before
