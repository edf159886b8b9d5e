"""An export is complete or absent, and replaces only an export; `ExportTests` has what each format does."""

import io
import os
import resource
from contextlib import suppress
from itertools import count
from pathlib import Path

import pytest
from exporters.reading import files, holds
from helpers import python
from helpers.refusals import refused

import ibdata
from ibdata.errors import IbdataError, UsageError
from ibdata.exporters._target import HDF5

KILLED = """
import os, signal, sys
import ibdata.exporters._source as source
from ibdata.cli import main
source.BLOCK_ROWS = 60
whole = source.Source.tables
def tables(self, columns):
    for i, table in enumerate(whole(self, columns)):
        if i == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        yield table
source.Source.tables = tables
main(sys.argv[1:])
"""


@pytest.mark.slow
def test_what_a_killed_export_left_is_discarded_by_the_next(dataset, tmp_path):
    args = ("export", dataset.path, "--to", "csv", "--out", tmp_path / "made")
    assert python("-c", KILLED, *args).returncode == -9
    assert list(tmp_path.rglob(".*.part"))
    made = ibdata.export(dataset, "csv", tmp_path / "made")
    assert not list(tmp_path.rglob(".*"))
    holds(made, dataset)


@pytest.mark.parametrize("to", ["lerobot", "npz"])
def test_a_file_that_cannot_be_opened_once_is_an_error(dataset, tmp_path, to, monkeypatch):
    """zipfile, which fails to open a file to add to it, empties it, and goes on."""
    real, numbers = io.open, count(1)

    def once(file, mode="r", *args, **options):
        if set(mode) & set("awx+") and str(tmp_path) in str(file) and next(numbers) == fails:
            raise OSError(5, "stale")
        return real(file, mode, *args, **options)

    monkeypatch.setattr(io, "open", once)
    monkeypatch.setattr(Path, "open", once)  # Python 3.10 remembers the other
    for fails in count(1):
        numbers = count(1)
        with suppress(IbdataError):
            made = ibdata.export(dataset, to, tmp_path / f"{fails}")
            break
    assert next(numbers) == fails > 1  # nothing failed
    holds(made, dataset)


@pytest.mark.parametrize("limit", [0, 5, 100])
def test_hdf5_reads_what_could_not_be_written(tmp_path, limit):
    """What it finds in place of it ends the process, now and then."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    with HDF5(tmp_path / "made") as file:
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limits[1]))
        try:
            file.write(b"0123456789")
            file.seek(20)
            file.write(b"more")
            file.seek(2)
            file.write(b"xy")
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        assert file.seek(0, os.SEEK_END) == 24
        file.seek(1)
        found = bytearray(b"?" * 25)
        file.readinto(found)
        assert bytes(found) == b"1xy456789" + bytes(10) + b"more" + bytes(2)
        with suppress(OSError):
            file.check()
            assert limit == 100


def test_only_an_export_is_replaced(dataset, tmp_path):
    ibdata.generate("random.yaml", tmp_path / "data" / "x", overrides=["steps=5"], workers=1)
    (tmp_path / "mine").mkdir()
    for name in ("arrays.parquet", "thesis.txt"):
        (tmp_path / "mine" / name).write_text("")
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


USERS = {
    "notes.csv": b"step,note\n1,mine\n",
    "mine.npz": b"PK\x05\x06" + bytes(18),
    "mine.h5": b"\x89HDF\r\n\x1a\nmine",
    "mine.parquet": b"PAR1mine",
    "mine/arrays.parquet": b"mine",
}


def test_a_file_that_is_no_export_is_not_replaced(dataset, tmp_path):
    for name, data in USERS.items():
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
        out = path.parent if path.name == "arrays.parquet" else path
        for to in ("csv", "rllib"):
            with pytest.raises(UsageError, match=r"found (no export of ibdata|arrays.parquet, which is not)"):
                ibdata.export(dataset, to, out, overwrite=True)
        assert path.read_bytes() == data


@pytest.mark.parametrize(("to", "name"), [("csv", "x.csv.gz"), ("rllib", "x.parquet")])
def test_another_form_of_a_format_is_replaced_too(dataset, tmp_path, to, name):
    ibdata.export(dataset, to, tmp_path / name, view={"observe": "markov"})
    holds(ibdata.export(dataset, to, tmp_path / name, overwrite=True), dataset)


def test_a_file_or_what_a_link_points_to_is_replaced(dataset, tmp_path):
    (tmp_path / "scratch").mkdir()
    (tmp_path / "scratch" / "x").write_text("")
    (tmp_path / "link").symlink_to("scratch/x")
    made = ibdata.export(dataset, "npz", tmp_path / "link", overwrite=True)
    assert (tmp_path / "link").is_symlink()
    assert made.path == str(tmp_path / "link")
    holds(made, dataset)
    made = ibdata.export(dataset, "rllib", tmp_path / "scratch" / "x", overwrite=True)
    holds(made, dataset)
    assert os.listdir(tmp_path / "scratch") == ["x"]


def test_a_target_that_cannot_be_written_is_refused(dataset, tmp_path):
    (tmp_path / "file").write_text("")
    for out, line in (
        (dataset.path / "data" / "x.csv", "lies within the dataset"),
        ("a\0b", r"'a\\x00b', expected a path without NUL$"),
        (tmp_path / "file" / "x.csv", "file/x.csv: "),
    ):
        refused(line, ibdata.export, dataset, "csv", out, error=IbdataError)
    assert not (dataset.path / "data" / "x.csv").exists()
    assert os.listdir(tmp_path) == ["file"]
