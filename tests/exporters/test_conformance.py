"""Rules for every format: exports are complete or absent, can be verified, and refuse invalid arguments."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import ibdata
from ibdata.dataset.models import SplitEntry
from ibdata.errors import DatasetError, IbdataError, MissingError, UsageError
from ibdata.exporters import FORMATS
from ibdata.exporters._view import View

RUN = """
import os, resource, signal, sys
from ibdata.exporters._view import View
{before}
from ibdata.cli import main
main(sys.argv[1:])
"""
KILL = """
import ibdata.exporters._view as view
view.BLOCK_ROWS = 60
whole = View.tables
def tables(self, columns, what):
    for i, table in enumerate(whole(self, columns, what)):
        if i == 1 and what == {what!r}:
            os.kill(os.getpid(), signal.{name})
        yield table
View.tables = tables
"""
FULL = "resource.setrlimit(resource.RLIMIT_FSIZE, (2048, 2048))"


def one_setpoint(to: str) -> str | None:
    return "target" if to == "neorl" else None


def run(before: str, *args: str) -> subprocess.CompletedProcess[str]:
    code = RUN.format(before=before)
    return subprocess.run([sys.executable, "-c", code, *args], capture_output=True, text=True, timeout=100)


def command(dataset, to, out) -> list[str]:
    split = one_setpoint(to)
    return [
        "export",
        str(dataset.path),
        "--to",
        to,
        "--out",
        str(out),
        *(["--split", split] if split else []),
        "--verify",
    ]


def test_the_formats_are_the_files():
    assert {"csv", "d3rlpy", "d4rl", "minari", "neorl", "npz", "rllib"} <= set(FORMATS)


ADDED = '''
"""Rewards as text."""


def export(view, path, target):
    path.write_text("".join(f"{reward}\\n" for block in view.blocks("write") for reward in block.rewards))
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


def test_a_format_of_another_package_is_found_and_imported_only_when_it_is_asked_for(
    dataset, tmp_path, added
):
    ibdata.export(dataset, "npz", tmp_path / "made.npz")
    assert "mine_rewards" not in sys.modules
    names = {}
    exec(ibdata.export(dataset, "rewards", tmp_path / "rewards.txt").snippet, names)
    assert len(names["rewards"]) == 480
    with pytest.raises(UsageError, match="the format rewards has no function to verify an export"):
        ibdata.export(dataset, "rewards", tmp_path / "more.txt", verify=True)
    with pytest.raises(IbdataError, match="format broken: mine_missing cannot be imported: No module"):
        ibdata.export(dataset, "broken", tmp_path / "more.txt")
    with pytest.raises(UsageError, match=r"expected one of csv, .*, broken, rewards; did you mean 'rewards'"):
        ibdata.export(dataset, "reward", tmp_path / "more.txt")


@pytest.mark.slow
def test_the_help_names_the_formats_of_other_packages_without_importing_them(added):
    code = "import sys\nfrom ibdata.cli import main\nmain(['export', '--help'])"
    variables = {"PYTHONPATH": f"{added}:{os.environ.get('PYTHONPATH', '')}"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=os.environ | variables, capture_output=True, text=True, check=True
    )
    assert "Added by mine_rewards." in done.stdout


def test_without_verify_nothing_is_read_back(dataset, tmp_path, to, monkeypatch):
    monkeypatch.setattr(f"ibdata.exporters.{to}.verify", None)
    ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to))


def test_it_says_what_it_made_and_leaves_nothing_beside_it(dataset, tmp_path, to):
    out = tmp_path / "new" / "folder" / "made"
    made = ibdata.export(dataset, to, out, split=one_setpoint(to), reward_scale=0.5, verify=True)
    assert (made.format, made.reward_scale) == (to, 0.5)
    assert (made.rows, made.episodes) == ((160, 4) if to == "neorl" else (480, 12))
    assert made.history == (30 if to == "neorl" else 1)
    assert Path(made.path).exists()
    compile(made.snippet, to, "exec")
    assert [path.name for path in out.parent.iterdir()] == ["made"]
    assert not list(tmp_path.rglob(".tmp-*"))


def test_an_existing_target_is_refused_and_left_as_it_is(dataset, tmp_path, to):
    made = Path(ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to), verify=True).path)
    before = {path: path.read_bytes() for path in [made, *made.rglob("*")] if path.is_file()}
    with pytest.raises(UsageError, match="exists already"):
        ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to), verify=True)
    assert {path: path.read_bytes() for path in before} == before
    assert (
        len(list(tmp_path.rglob("*")))
        == len([made, *made.rglob("*"), *made.parents]) - len(tmp_path.parents) - 1
    )


@pytest.mark.slow
@pytest.mark.parametrize(("name", "code", "what"), [("SIGINT", 130, "write"), ("SIGTERM", 143, "check")])
def test_a_signal_in_the_middle_leaves_nothing(dataset, tmp_path, to, name, code, what):
    done = run(KILL.format(name=name, what=what), *command(dataset, to, tmp_path / "a" / "b"))
    assert (done.returncode, done.stdout) == (code, "")
    assert "nothing of the export is left behind" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_leaves_nothing(dataset, tmp_path, to):
    done = run(FULL, *command(dataset, to, tmp_path / "a" / "b"))
    assert done.returncode == 1
    assert "cannot be written" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_other_values_read_back_than_written_fail(dataset, tmp_path, to, monkeypatch):
    """As if the disk had changed one reward of the last episode."""
    honest = View.tables

    def tables(self, columns, what):
        for table in honest(self, columns, what):
            if what == "check":
                place = table.column_names.index("reward")
                rewards = table["reward"].to_numpy().copy()
                rewards[-1] = np.nextafter(np.float32(rewards[-1]), np.float32(0))
                table = table.set_column(place, table.schema.field(place), [rewards])
            yield table

    monkeypatch.setattr(View, "tables", tables)
    with pytest.raises(IbdataError, match="read back other values than were written"):
        ibdata.export(dataset, to, tmp_path / "a" / "made", split=one_setpoint(to), verify=True)
    assert list(tmp_path.iterdir()) == []


def test_blocks_of_any_size_give_the_same_values(dataset, tmp_path, to, monkeypatch):
    """The check of each export compares with blocks of another size than were written."""
    honest = View.tables

    def tables(self, columns, what):
        monkeypatch.setattr("ibdata.exporters._view.BLOCK_ROWS", 30 if what == "write" else 10_000)
        return honest(self, columns, what)

    monkeypatch.setattr(View, "tables", tables)
    made = ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to), history=3, verify=True)
    assert made.history == 3


def test_a_split_may_be_named_or_not_known(dataset, tmp_path, to):
    assert ibdata.export(dataset, to, tmp_path / "a", split="target", verify=True).rows == 160
    with pytest.raises(UsageError, match="expected one of source, target"):
        ibdata.export(dataset, to, tmp_path / "b", split="nonsense", verify=True)


@pytest.mark.slow
@pytest.mark.parametrize("to", ["csv", "rllib"])
def test_the_command_prints_the_snippet_or_one_json_document(dataset, tmp_path, ibdata, to):
    text = ibdata(*command(dataset, to, tmp_path / "a"))
    document = ibdata(*command(dataset, to, tmp_path / "b"), "--json")
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
    again = ibdata(*command(dataset, to, tmp_path / "b"), "--json")
    assert (again.returncode, json.loads(again.stdout)["error"]["code"]) == (2, 2)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"to": "mnari"}, "format: found 'mnari', expected one of csv, .*did you mean 'minari'"),
        ({"history": 0}, "history: found 0, expected a whole number of at least 1"),
        ({"history": 10**9}, "^history: this number takes .* GB of memory, but this machine has"),
        ({"history": 10**30}, "^history: this number takes .* GB of memory, but this machine has"),
        ({"reward_scale": 0.0}, "reward scale: found 0.0, expected a finite number above 0"),
        ({"reward_scale": float("nan")}, "reward scale: found nan"),
        ({"reward_scale": 1e300}, "reward: found weights or a scale .1e.300. that make rewards infinite"),
        ({"id": "ib/x-v0"}, "id: found 'ib/x-v0', but the format npz has no ids; leave it out"),
    ],
)
def test_options_that_cannot_be_meant(dataset, tmp_path, options, message):
    with pytest.raises(UsageError, match=message):
        ibdata.export(dataset, **{"to": "npz", "out": tmp_path / "made", **options}, verify=True)
    assert list(tmp_path.iterdir()) == []


def test_a_block_is_bounded_and_holds_whole_episodes(dataset, monkeypatch):
    """So memory does not grow with the dataset: at most the rows asked for and one episode more."""
    monkeypatch.setattr("ibdata.exporters._view.BLOCK_ROWS", 60)
    for history, limit in ((1, 60), (3, 20)):
        blocks = list(View(dataset, history=history).blocks("write"))
        assert sum(len(block.rewards) for block in blocks) == 480
        assert all(len(block.rewards) <= limit + 40 for block in blocks)
        assert all(block.step[0] == 0 and block.truncated[-1] for block in blocks)
        assert all(len(one.rewards) == 40 for block in blocks for one in block.split())


def test_a_split_without_rows_is_refused(dataset, tmp_path, monkeypatch):
    splits = {**dataset.split_entries, "none": SplitEntry(episodes=0, rows=0, declared=False)}
    monkeypatch.setattr(dataset, "split_entries", splits)
    with pytest.raises(UsageError, match="split: 'none' has no rows"):
        ibdata.export(dataset, "csv", tmp_path / "made", split="none", verify=True)


def test_an_episode_that_does_not_end_is_a_damaged_dataset(dataset, tmp_path, monkeypatch):
    cut = dataset.table().slice(0, 90).to_batches()
    monkeypatch.setattr(dataset, "iter_batches", lambda *args: (b.select(args[0]) for b in cut))
    with pytest.raises(DatasetError, match="the last episode has no end, see ibdata validate"):
        ibdata.export(dataset, "npz", tmp_path / "made", verify=True)
    assert list(tmp_path.iterdir()) == []


def test_a_target_within_the_dataset_is_refused(dataset):
    with pytest.raises(UsageError, match="lies within the dataset"):
        ibdata.export(dataset, "csv", dataset.path / "data" / "x.csv", verify=True)
    assert not (dataset.path / "data" / "x.csv").exists()


def test_a_target_with_nul_is_refused(dataset):
    with pytest.raises(UsageError, match=r"'a\\x00b', expected a path without NUL$"):
        ibdata.export(dataset, "npz", "a\0b")


def test_no_dataset_is_a_dataset_error(tmp_path):
    with pytest.raises(DatasetError, match="no finished dataset here"):
        ibdata.export(tmp_path, "csv", tmp_path / "made", verify=True)


@pytest.mark.parametrize("to", ["d4rl", "d3rlpy"])
def test_a_library_that_is_not_installed_is_named_with_its_extra(dataset, tmp_path, to, monkeypatch):
    monkeypatch.setitem(sys.modules, "h5py", None)
    with pytest.raises(
        MissingError,
        match=rf"exporting to {to} needs the package h5py: pip install h5py, or 'ibdata\[hdf5\]'",
    ):
        ibdata.export(dataset, to, tmp_path / "a" / "made", verify=True)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_folder_that_may_not_be_written_is_one_line(dataset, tmp_path, ibdata):
    (tmp_path / "file").write_text("")
    done = ibdata("export", str(dataset.path), "--to", "csv", "--out", str(tmp_path / "file" / "x.csv"))
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert os.listdir(tmp_path) == ["file"]


@pytest.mark.slow
def test_the_help_has_what_each_format_works_around(ibdata):
    text = " ".join(ibdata("export", "--help").stdout.split())
    for words in (
        "sequence_dataset expects rows in every HDF5 dataset",
        "Parquet corrupt episodes of 32,768 steps or more",
        "would lose the last transition",
        "one vector per row",
        "the loader puts a 0 in front of it",
    ):
        assert words in text


def test_nothing_heavy_is_imported_for_the_help():
    heavy = ("numpy", "pyarrow", "h5py", "minari")
    code = (
        f"import sys\nfrom ibdata.cli.export import command\nprint([m for m in {heavy} if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
