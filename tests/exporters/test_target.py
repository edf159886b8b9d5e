"""For every format: an export is complete or absent, and replaces another one only when that is said."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from exporters.reading import holds, one_setpoint

import ibdata
from ibdata.errors import BusyError, IbdataError, UsageError
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
def tables(self, columns):
    for i, table in enumerate(whole(self, columns)):
        if i == 1:
            os.kill(os.getpid(), signal.{name})
        yield table
View.tables = tables
"""
FULL = "resource.setrlimit(resource.RLIMIT_FSIZE, (2048, 2048))"


def files(made: str | Path) -> dict[Path, bytes]:
    made = Path(made)
    return {path: path.read_bytes() for path in [made, *made.rglob("*")] if path.is_file()}


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
    ]


def test_an_existing_target_is_refused_and_left_as_it_is(dataset, tmp_path, to):
    made = ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to)).path
    before = files(tmp_path)
    with pytest.raises(UsageError, match=r"exists already; .* or --overwrite to replace an export"):
        ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to))
    assert files(made)
    assert files(tmp_path) == before


@pytest.mark.parametrize("exchange", [True, False], ids=["exchange", "no exchange"])
def test_an_export_is_replaced_when_that_is_said(dataset, tmp_path, to, exchange, monkeypatch):
    if not exchange:
        monkeypatch.setattr("ibdata.system.part.exchanged", lambda a, b: False)
    ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to))
    before = files(tmp_path)
    options = {"split": "target", "history": 2}
    made = ibdata.export(dataset, to, tmp_path / "made", **options, overwrite=True)
    holds(made, dataset, **options)
    assert set(files(tmp_path)) == set(before)


def test_an_export_stays_if_the_one_to_replace_it_fails(dataset, tmp_path, to, monkeypatch):
    ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to))
    before = files(tmp_path)
    monkeypatch.setattr("ibdata.exporters._target._sync", failing)
    with pytest.raises(IbdataError, match="cannot be written: no room"):
        ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to), overwrite=True)
    assert files(tmp_path) == before


def failing(path):
    raise OSError(28, "no room")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143)])
def test_a_signal_in_the_middle_leaves_nothing(dataset, tmp_path, to, name, code):
    done = run(KILL.format(name=name), *command(dataset, to, tmp_path / "a" / "b"))
    assert (done.returncode, done.stdout) == (code, "")
    assert "nothing unfinished is left behind" in done.stderr
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_what_a_killed_export_left_is_discarded_by_the_next(dataset, tmp_path, to):
    done = run(KILL.format(name="SIGKILL"), *command(dataset, to, tmp_path / "made"))
    assert done.returncode == -9
    assert list(tmp_path.rglob(".*.part"))
    made = ibdata.export(dataset, to, tmp_path / "made", split=one_setpoint(to))
    assert not list(tmp_path.rglob(".*"))
    holds(made, dataset, one_setpoint(to), made.history)


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_leaves_nothing(dataset, tmp_path, to):
    done = run(FULL, *command(dataset, to, tmp_path / "a" / "b"))
    assert done.returncode == 1
    assert "cannot be written" in done.stderr
    assert len(done.stderr.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_two_exports_to_one_target_at_once(dataset, tmp_path, monkeypatch):
    out, honest = tmp_path / "made", View.tables

    def tables(self, columns):
        monkeypatch.setattr(View, "tables", honest)
        with pytest.raises(BusyError, match="made: another process is writing here") as busy:
            ibdata.export(dataset, "csv", out)
        assert busy.value.exit_code == 75
        return honest(self, columns)

    monkeypatch.setattr(View, "tables", tables)
    holds(ibdata.export(dataset, "npz", out), dataset)
    assert os.listdir(tmp_path) == ["made"]


def test_only_an_export_is_replaced(dataset, tmp_path):
    ibdata.generate("random.yaml", tmp_path / "data" / "x", overrides=["steps=5"], workers=1)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "arrays.parquet").write_text("")
    (tmp_path / "mine" / "thesis.txt").write_text("")
    before = files(tmp_path)
    for name, message in (
        ("data/x", "is a dataset, which no export replaces"),
        ("data", "found x, which is not of such an export"),
        ("mine", "found thesis.txt, which is not of such an export"),
    ):
        for to in ("npz", "rllib"):
            with pytest.raises(UsageError, match=message if to == "rllib" else message[:6]):
                ibdata.export(dataset, to, tmp_path / name, overwrite=True)
    assert files(tmp_path) == before


def test_a_file_or_what_a_link_points_to_is_replaced(dataset, tmp_path):
    (tmp_path / "scratch").mkdir()
    (tmp_path / "scratch" / "x").write_text("old")
    (tmp_path / "link").symlink_to("scratch/x")
    made = ibdata.export(dataset, "npz", tmp_path / "link", overwrite=True)
    assert (tmp_path / "link").is_symlink()
    assert made.path == str(tmp_path / "link")
    holds(made, dataset)
    made = ibdata.export(dataset, "rllib", tmp_path / "scratch" / "x", overwrite=True)
    holds(made, dataset)
    assert os.listdir(tmp_path / "scratch") == ["x"]


def test_a_target_in_the_dataset_or_with_nul_is_refused(dataset):
    with pytest.raises(UsageError, match="lies within the dataset"):
        ibdata.export(dataset, "csv", dataset.path / "data" / "x.csv")
    assert not (dataset.path / "data" / "x.csv").exists()
    with pytest.raises(UsageError, match=r"'a\\x00b', expected a path without NUL$"):
        ibdata.export(dataset, "npz", "a\0b")


@pytest.mark.slow
def test_a_folder_that_may_not_be_written_is_one_line(dataset, tmp_path, ibdata):
    (tmp_path / "file").write_text("")
    done = ibdata("export", str(dataset.path), "--to", "csv", "--out", str(tmp_path / "file" / "x.csv"))
    assert (done.returncode, len(done.stderr.splitlines())) == (1, 1)
    assert os.listdir(tmp_path) == ["file"]
