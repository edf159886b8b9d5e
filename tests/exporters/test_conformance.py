"""Rules for every format: exports hold every value, and refuse invalid arguments."""

import json
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from exporters.reading import holds, one_setpoint

import ibdata as library
from ibdata.cli import cli
from ibdata.dataset.models import SplitEntry
from ibdata.errors import DatasetError, IbdataError, UsageError
from ibdata.exporters._view import View

VIEWS = {
    "plain": (1, {}),
    "markov": (4, {"observe": "markov", "actions": True, "reward": {"consumption": 1, "fatigue": 1}}),
    "troubles": (
        3,
        {
            "imperfections": {"delay": {"obs_fatigue": 3}, "missing": {"obs_velocity": 0.2}, "mask": True},
            "reward": "delta",
            "reward_scale": 0.1,
        },
    ),
}


@pytest.mark.parametrize(("history", "view"), VIEWS.values(), ids=VIEWS)
def test_every_value_of_the_arrays_is_there_again(dataset, tmp_path, to, history, view):
    made = library.export(dataset, to, tmp_path / "made", split=one_setpoint(to), history=history, view=view)
    holds(made, dataset, one_setpoint(to), history, view=view)


def test_blocks_of_any_size_give_the_same_values(dataset, tmp_path, to, monkeypatch):
    """Of a split, too."""
    monkeypatch.setattr("ibdata.exporters._view.BLOCK_ROWS", 30)
    made = library.export(dataset, to, tmp_path / "made", split="target", history=3)
    assert made.rows == 160
    holds(made, dataset, "target", history=3)


def test_a_block_is_bounded_and_holds_whole_episodes(dataset, monkeypatch):
    """So memory does not grow with the dataset: at most the rows asked for and one episode more."""
    monkeypatch.setattr("ibdata.exporters._view.BLOCK_ROWS", 60)
    for history, limit in ((1, 60), (3, 20)):
        blocks = list(View(dataset, history=history).blocks())
        assert sum(len(block.rewards) for block in blocks) == 480
        assert all(len(block.rewards) <= limit + 40 for block in blocks)
        assert all(block.step[0] == 0 and block.truncated[-1] for block in blocks)
    assert [len(block.rewards) for block in View(dataset).episode_blocks()] == [40] * 12


def test_it_says_what_it_made_and_leaves_nothing_beside_it(dataset, tmp_path, to):
    out = tmp_path / "new" / "folder" / "made"
    made = library.export(dataset, to, out, split=one_setpoint(to), view={"reward_scale": 0.5})
    assert (made.format, made.reward_scale) == (to, 0.5)
    assert (made.rows, made.episodes) == ((160, 4) if to == "neorl" else (480, 12))
    assert made.history == (30 if to == "neorl" else 1)
    assert Path(made.path).exists()
    compile(made.snippet, to, "exec")
    assert [path.name for path in out.parent.iterdir()] == ["made"]
    assert not list(tmp_path.rglob(".*"))


@pytest.mark.parametrize("to", ["csv", "rllib"])
def test_the_command_prints_the_snippet_or_one_json_document(dataset, tmp_path, to):
    def run(*args):
        return CliRunner().invoke(cli, ["export", str(dataset.path), "--to", to, "--out", *map(str, args)])

    text, document = run(tmp_path / "a"), run(tmp_path / "b", "--json")
    assert (text.exit_code, text.stderr, document.exit_code, document.stderr) == (0, "", 0, "")
    made = json.loads(document.stdout)
    said = {"version", "format", "path", "episodes", "rows", "history", "reward_scale", "snippet"}
    assert set(made) == {*said, "frame", "left_out"}
    assert made["version"] == 1
    assert made["snippet"].replace(f"{tmp_path}/b", f"{tmp_path}/a") in text.stdout
    assert run(tmp_path / "b", "--overwrite").exit_code == 0


ADDED = '''
"""Rewards as text."""


def export(view, path, target):
    path.write_text("".join(f"{reward}\\n" for block in view.blocks() for reward in block.rewards))
    return f"rewards = __import__('pathlib').Path({str(target)!r}).read_text().split()"
'''


@pytest.fixture
def added(tmp_path, monkeypatch):
    """An installed package that adds the format `rewards`."""
    site = tmp_path / "site"
    (site / "mine-1.0.dist-info").mkdir(parents=True)
    (site / "mine-1.0.dist-info" / "METADATA").write_text("Metadata-Version: 2.1\nName: mine\nVersion: 1.0\n")
    points = "[ibdata.exporters]\nrewards = mine_rewards\n"
    (site / "mine-1.0.dist-info" / "entry_points.txt").write_text(points)
    (site / "mine_rewards.py").write_text(ADDED)
    monkeypatch.syspath_prepend(site)
    yield site
    sys.modules.pop("mine_rewards", None)


def test_a_format_of_another_package_is_imported_when_used(dataset, tmp_path, added):
    library.export(dataset, "npz", tmp_path / "made.npz")
    assert "mine_rewards" not in sys.modules
    names = {}
    exec(library.export(dataset, "rewards", tmp_path / "rewards.txt").snippet, names)
    assert len(names["rewards"]) == 480
    with pytest.raises(UsageError, match=r"expected one of csv, .*, rewards; did you mean 'rewards'"):
        library.export(dataset, "reward", tmp_path / "more.txt")
    assert "Added by mine_rewards." in CliRunner().invoke(cli, ["export", "--help"]).stdout


REFUSED = {
    "format": ({"to": "mnari"}, "format: found 'mnari', expected one of csv, .*did you mean 'minari'"),
    "history": ({"history": 0}, "history: found 0, expected a whole number of at least 1"),
    "scale": ({"view": {"reward_scale": 0.0}}, "reward_scale: found 0.0, expected a finite number above 0"),
    "view": ({"view": {"obsreve": 1}}, "view: found 'obsreve', expected one of .*did you mean 'observe'"),
    "word": ({"view": "markov"}, "view: found 'markov', expected a mapping such as {'observe': 'markov'"),
    "id": ({"id": "ib/x-v0"}, "id: found 'ib/x-v0', but the format npz has no ids; leave it out"),
    "memory": ({"history": 10**9}, "made: out of memory; use a smaller --history, or --split"),
}


@pytest.mark.parametrize(("options", "message"), REFUSED.values(), ids=REFUSED)
def test_options_that_cannot_be_meant(dataset, tmp_path, options, message):
    with pytest.raises(IbdataError, match=message):
        library.export(dataset, **{"to": "npz", "out": tmp_path / "made", **options})
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_exported_is_refused(dataset, tmp_path, monkeypatch):
    """A split without rows, and a damaged dataset."""
    splits = {**dataset.split_entries, "none": SplitEntry(episodes=0, rows=0, declared=False)}
    monkeypatch.setattr(dataset, "split_entries", splits)
    with pytest.raises(UsageError, match="split: 'none' has no rows"):
        library.export(dataset, "csv", tmp_path / "made", split="none")
    cut = dataset.table().slice(0, 90).to_batches()
    monkeypatch.setattr(dataset, "iter_batches", lambda *args: (b.select(args[0]) for b in cut))
    with pytest.raises(DatasetError, match="the last episode has no end, see ibdata validate"):
        library.export(dataset, "npz", tmp_path / "made")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("to", ["d4rl"])
def test_a_library_that_is_not_installed_is_named_with_its_extra(dataset, tmp_path, to, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    line = rf"exporting to {to} needs the package h5py: pip install h5py, or 'ibdata\[hdf5\]'"
    with pytest.raises(ImportError, match=line):
        library.export(dataset, to, tmp_path / "a" / "made")
    assert list(tmp_path.iterdir()) == []
