"""Rules for every format: exports hold every value, are complete or absent, and refuse invalid arguments."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from exporters.reading import holds, one_setpoint

import ibdata
from ibdata.dataset.models import SplitEntry
from ibdata.errors import DatasetError, IbdataError, UsageError
from ibdata.exporters._view import View

ADDED = '''
"""Rewards as text."""


def export(view, path, target):
    path.write_text("".join(f"{reward}\\n" for block in view.blocks() for reward in block.rewards))
    return f"rewards = __import__('pathlib').Path({str(target)!r}).read_text().split()"
'''


@pytest.fixture
def added(tmp_path, monkeypatch):
    """An installed package that adds the formats `rewards` and `broken`."""
    site = tmp_path / "site"
    (site / "mine-1.0.dist-info").mkdir(parents=True)
    (site / "mine-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    points = "[ibdata.exporters]\nrewards = mine_rewards\nbroken = mine_missing\n"
    (site / "mine-1.0.dist-info" / "entry_points.txt").write_text(points)
    (site / "mine_rewards.py").write_text(ADDED)
    monkeypatch.syspath_prepend(site)
    yield site
    sys.modules.pop("mine_rewards", None)


def test_a_format_of_another_package_is_imported_when_used(dataset, tmp_path, added):
    ibdata.export(dataset, "npz", tmp_path / "made.npz")
    assert "mine_rewards" not in sys.modules
    names = {}
    exec(ibdata.export(dataset, "rewards", tmp_path / "rewards.txt").snippet, names)
    assert len(names["rewards"]) == 480
    with pytest.raises(IbdataError, match="format broken: mine_missing cannot be imported: No module"):
        ibdata.export(dataset, "broken", tmp_path / "more.txt")
    with pytest.raises(UsageError, match=r"expected one of csv, .*, broken, rewards; did you mean 'rewards'"):
        ibdata.export(dataset, "reward", tmp_path / "more.txt")


@pytest.mark.slow
def test_help_names_added_formats_without_importing_them(added):
    code = "import sys\nfrom ibdata.cli import main\nmain(['export', '--help'])"
    variables = {"PYTHONPATH": f"{added}:{os.environ.get('PYTHONPATH', '')}"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | variables, capture_output=True, text=True, check=True
    )
    assert "Added by mine_rewards." in done.stdout


VIEWS = [
    {},
    {"reward_scale": 0.01},
    {"observe": "markov", "actions": True, "reward": {"consumption": 1, "fatigue": 1}},
    {
        "imperfections": {"delay": {"obs_fatigue": 3}, "missing": {"obs_velocity": 0.2}, "mask": True},
        "reward": "delta",
        "reward_scale": 0.1,
    },
]


@pytest.mark.parametrize("view", VIEWS, ids=["classic", "scaled", "markov", "troubles"])
@pytest.mark.parametrize("history", [1, 4])
def test_every_value_of_the_arrays_is_there_again(dataset, tmp_path, to, history, view):
    made = ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to), history=history, view=view)
    holds(made, dataset, one_setpoint(to), history, view=view)


def test_blocks_of_any_size_give_the_same_values(dataset, tmp_path, to, monkeypatch):
    monkeypatch.setattr("ibdata.exporters._view.BLOCK_ROWS", 30)
    made = ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to), history=3)
    holds(made, dataset, one_setpoint(to), history=3)


def test_a_split_may_be_named_or_not_known(dataset, tmp_path, to):
    made = ibdata.export(dataset, to, tmp_path / "a", split="target", history=1)
    assert made.rows == 160
    holds(made, dataset, "target")
    with pytest.raises(UsageError, match="expected one of source, target"):
        ibdata.export(dataset, to, tmp_path / "b", split="nonsense")


def test_it_says_what_it_made_and_leaves_nothing_beside_it(dataset, tmp_path, to):
    out = tmp_path / "new" / "folder" / "made"
    made = ibdata.export(dataset, to, out, split=one_setpoint(to), view={"reward_scale": 0.5})
    assert (made.format, made.reward_scale) == (to, 0.5)
    assert (made.rows, made.episodes) == ((160, 4) if to == "neorl" else (480, 12))
    assert made.history == (30 if to == "neorl" else 1)
    assert Path(made.path).exists()
    compile(made.snippet, to, "exec")
    assert [path.name for path in out.parent.iterdir()] == ["made"]
    assert not list(tmp_path.rglob(".*"))


@pytest.mark.slow
@pytest.mark.parametrize("to", ["csv", "rllib"])
def test_the_command_prints_the_snippet_or_one_json_document(dataset, tmp_path, ibdata, to):
    command = ("export", str(dataset.path), "--to", to, "--out")
    text = ibdata(*command, str(tmp_path / "a"))
    document = ibdata(*command, str(tmp_path / "b"), "--json")
    assert (text.returncode, document.returncode) == (0, 0)
    assert text.stderr == document.stderr == ""
    made = json.loads(document.stdout)
    assert made["version"] == 1
    assert set(made) == {
        "version",
        "format",
        "path",
        "episodes",
        "rows",
        "history",
        "reward_scale",
        "snippet",
        "frame",
        "left_out",
    }
    assert made["snippet"].replace(f"{tmp_path}/b", f"{tmp_path}/a") in text.stdout
    again = ibdata(*command, str(tmp_path / "b"), "--json")
    assert (again.returncode, json.loads(again.stdout)["error"]["code"]) == (2, 2)
    assert ibdata(*command, str(tmp_path / "b"), "--overwrite").returncode == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"to": "mnari"}, "format: found 'mnari', expected one of csv, .*did you mean 'minari'"),
        ({"history": 0}, "history: found 0, expected a whole number of at least 1"),
        ({"view": {"reward_scale": 0.0}}, "reward_scale: found 0.0, expected a finite number above 0"),
        ({"view": {"reward_scale": float("nan")}}, "reward_scale: found nan"),
        (
            {"view": {"reward_scale": 1e300}},
            "reward: found weights or a scale .1e.300. that make rewards infinite",
        ),
        ({"view": {"obsreve": 1}}, "view: found 'obsreve', expected one of .*did you mean 'observe'"),
        ({"view": "markov"}, "view: found 'markov', expected a mapping such as {'observe': 'markov'"),
        ({"id": "ib/x-v0"}, "id: found 'ib/x-v0', but the format npz has no ids; leave it out"),
    ],
)
def test_options_that_cannot_be_meant(dataset, tmp_path, options, message):
    with pytest.raises(UsageError, match=message):
        ibdata.export(dataset, **{"to": "npz", "out": tmp_path / "made", **options})
    assert list(tmp_path.iterdir()) == []


def test_a_history_that_memory_cannot_hold_is_one_line(dataset, tmp_path):
    with pytest.raises(IbdataError, match="made: out of memory; use a smaller --history, or --split"):
        ibdata.export(dataset, "npz", tmp_path / "made", history=10**9)
    assert list(tmp_path.iterdir()) == []


def test_a_block_is_bounded_and_holds_whole_episodes(dataset, monkeypatch):
    """So memory does not grow with the dataset: at most the rows asked for and one episode more."""
    monkeypatch.setattr("ibdata.exporters._view.BLOCK_ROWS", 60)
    for history, limit in ((1, 60), (3, 20)):
        blocks = list(View(dataset, history=history).blocks())
        assert sum(len(block.rewards) for block in blocks) == 480
        assert all(len(block.rewards) <= limit + 40 for block in blocks)
        assert all(block.step[0] == 0 and block.truncated[-1] for block in blocks)
    assert [len(block.rewards) for block in View(dataset).episode_blocks()] == [40] * 12


def test_a_split_without_rows_is_refused(dataset, tmp_path, monkeypatch):
    splits = {**dataset.split_entries, "none": SplitEntry(episodes=0, rows=0, declared=False)}
    monkeypatch.setattr(dataset, "split_entries", splits)
    with pytest.raises(UsageError, match="split: 'none' has no rows"):
        ibdata.export(dataset, "csv", tmp_path / "made", split="none")


def test_an_episode_that_does_not_end_is_a_damaged_dataset(dataset, tmp_path, monkeypatch):
    cut = dataset.table().slice(0, 90).to_batches()
    monkeypatch.setattr(dataset, "iter_batches", lambda *args: (b.select(args[0]) for b in cut))
    with pytest.raises(DatasetError, match="the last episode has no end, see ibdata validate"):
        ibdata.export(dataset, "npz", tmp_path / "made")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("to", ["d4rl", "d3rlpy"])
def test_a_library_that_is_not_installed_is_named_with_its_extra(dataset, tmp_path, to, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(
        ImportError,
        match=rf"exporting to {to} needs the package h5py: pip install h5py, or 'ibdata\[hdf5\]'",
    ):
        ibdata.export(dataset, to, tmp_path / "a" / "made")
    assert list(tmp_path.iterdir()) == []
