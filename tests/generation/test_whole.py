"""All shards or an error: what is not whole is never published, and what is finished is gone on with."""

import io
import json
import os
import shutil
from contextlib import suppress
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.folders import contents, is_right, part_of, receipts, run_of
from helpers.refusals import refused

import ibdata
from ibdata import IbdataError
from ibdata._system.files import read_hashed, with_hash, write
from ibdata._system.part import DATASET
from ibdata._system.runs import FolderRun
from ibdata.cli import main
from ibdata.dataset.models import Code
from ibdata.errors import DatasetError, Interrupted, UsageError
from ibdata.generation import shard as shard_writing
from ibdata.generation import workers
from ibdata.generation.record import Record
from ibdata.plan.dataset_spec import DatasetSpec


def unreadable(monkeypatch):
    """The receipt of shard 2 after its file was made, as a client of a network file system sees it."""
    real = shard_writing.read_receipt
    found = lambda run, shard: None if shard.number == 2 else real(run, shard)  # noqa: E731
    monkeypatch.setattr(shard_writing, "read_receipt", found)


def cut(monkeypatch):
    """The file of shard 2, of which a part is on the disk."""
    real = workers.write_receipt

    def putting(run, written):
        real(run, written)
        if written.shard.number == 2:
            path = run.path / DATASET / written.entry.path
            path.write_bytes(path.read_bytes()[:-7])

    monkeypatch.setattr(workers, "write_receipt", putting)


@pytest.mark.parametrize("lose", [unreadable, cut])
def test_a_lost_shard_is_an_error_and_the_run_goes_on(tiny, files, monkeypatch, lose):
    with monkeypatch.context() as broken:
        lose(broken)
        with pytest.raises(
            IbdataError,
            match=r"^out: 1 of 4 shards are missing or damaged: data/part-00002; ibdata generate makes",
        ) as e:
            ibdata.generate(TINY, "out", workers=1)
    assert (e.value.exit_code, Path("out").exists()) == (1, False)
    assert len(list((run_of("out") / "dataset/data").iterdir())) == 4
    ibdata.generate(TINY, "out", workers=1)
    assert is_right("out", tiny[0].path, files)


@pytest.fixture(scope="module")
def unfinished(tmp_path_factory):
    """A folder with two unfinished runs; those of `other` fit `out`, but for their numbers."""
    folder = tmp_path_factory.mktemp("begun")
    ibdata.generate(TINY, folder / "out", workers=1, shards="1/2")
    shutil.copytree(run_of(folder / "out"), run_of(folder / "other"))
    note = Record.of(DatasetSpec.of(TINY.model_copy(update={"seed": 1})), code=[], reproducible=True)
    note.write(FolderRun(run_of(folder / "other")))
    return folder


@pytest.fixture
def begun(unfinished):
    """A copy of them in the current folder."""
    shutil.copytree(unfinished, ".", dirs_exist_ok=True)


def flipped(data, other):
    at = len(data) // 2
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


DAMAGE = {
    "flipped": flipped,
    "cut": lambda data, other: data[:-9],
    "foreign": lambda data, other: other,
}
ENTERED = [
    "run.json",
    "receipts",
    "receipts/00001.npy",
    "dataset",
    "dataset/data",
    "dataset/data/part-00001-*",
]
ENTERED += ["dataset/meta", "dataset/.DS_Store"]
FILES = {"run.json": "run.json", "receipt": "receipts/00001.npy", "shard": "dataset/data/part-00001-*"}
FILES_OF_SHARDS = [FILES["receipt"], FILES["shard"]]
CASES = [
    *((path, damage, "same") for path in FILES_OF_SHARDS for damage in DAMAGE.values()),
    *((path, flipped, "finalize") for path in FILES_OF_SHARDS),
]


@pytest.mark.parametrize(("path", "damage", "write"), CASES)
def test_what_is_damaged_in_a_part_is_made_again(tiny, files, begun, path, damage, write):
    """A file of another run is damage, too; and of another shard."""
    (found,) = run_of("out").glob(path)
    other = next(run_of("other").glob(path.replace("00001", "00000")))
    found.write_bytes(damage(found.read_bytes(), other.read_bytes()))
    shutil.rmtree(part_of("other"))
    if write == "finalize":
        ibdata.generate(TINY, "out", workers=1, shards="1/1")
        ibdata.finalize("out")
    else:
        ibdata.generate(TINY, "out", workers=1)
    assert is_right("out", tiny[0].path, files)


@pytest.mark.parametrize("damage", DAMAGE.values())
def test_a_run_whose_note_is_damaged_is_refused_and_replaced(tiny, files, begun, damage):
    """Nobody can tell whose it is."""
    note = run_of("out") / "run.json"
    note.write_bytes(damage(note.read_bytes(), (run_of("other") / "run.json").read_bytes()))
    shutil.rmtree(part_of("other"))
    line = (
        r"^out: holds an unfinished run (whose note is damaged, or of .*|of another .*\)), 2 of [?4] shards"
    )
    for options in ({}, {"shards": "1/2"}):
        refused(line, ibdata.generate, TINY, "out", workers=1, **options)
    ibdata.generate(TINY, "out", workers=1, overwrite=True)
    assert is_right("out", tiny[0].path, files)


@pytest.mark.parametrize("content", [b"junk", b"", b"[1]"])
def test_a_receipt_of_another_form_is_made_again(tiny, files, begun, content):
    """As another ibdata may write it, or somebody forges it."""
    receipt = run_of("out") / "receipts/00001.npy"
    if content == b"[1]":  # a header that is no mapping
        arrays = io.BytesIO()
        for _ in range(9):
            np.save(arrays, np.frombuffer(content, np.uint8))
        content = arrays.getvalue()
    receipt.write_bytes(with_hash(content))
    ibdata.generate(TINY, "out", workers=1)
    assert is_right("out", tiny[0].path, files)


@pytest.mark.parametrize("damage", [b"", b"{}"])
def test_a_run_that_is_about_to_appear_goes_on(tiny, files, begun, monkeypatch, damage):
    """A process was killed before its last rename, and the manifest that it had written is damaged."""
    with monkeypatch.context() as killed, suppress(KeyboardInterrupt):
        killed.setattr("ibdata._system.part.Part.place", Mock(side_effect=KeyboardInterrupt))
        ibdata.generate(TINY, "out", workers=1)
    (run_of("out") / "dataset/meta/manifest.json").write_bytes(damage)
    assert len(receipts("out")) == 4
    ibdata.finalize("out")
    assert is_right("out", tiny[0].path, files)


def test_a_pipe_in_a_run_hangs_nobody(begun, capsys):
    """Nor does an endless file, which is no regular one."""
    shutil.rmtree(part_of("other"))
    run, note = run_of("out"), json.loads(read_hashed(run_of("out") / "run.json"))
    write(run, "run.json", with_hash(json.dumps({**note, "manifest": "0" * 64}).encode()))
    (run / "dataset/meta").mkdir()
    os.mkfifo(run / "dataset/meta/manifest.json")
    for command in (["ls", "."], ["info", "out"]):
        with suppress(SystemExit):
            main(command)
    for call in (ibdata.generate, ibdata.estimate):
        refused(r"manifest\.json: found what ibdata did not", call, TINY, "out")


NOTES = {
    "of another form": b'{"data_version": 4, "pieces": 2}',
    "of no object": b"[]",
    "too deep": b"[" * 100_000,
    "of strange numbers": b'{"shards": "many", "manifest": 5, "live": 0}',
}


@pytest.mark.parametrize("note", NOTES.values(), ids=NOTES)
def test_a_note_of_another_form_is_one_line_for_every_reader(begun, note, capsys):
    """As a newer ibdata may write it, or somebody forges it."""
    shutil.rmtree(part_of("other"))
    (run_of("out") / "run.json").write_bytes(with_hash(note))
    lines = {
        ("info", "out"): "an unfinished run has 2 of ? shards here\n",
        ("validate", "out"): "an unfinished run has 2 of ? shards here\n",
        ("ls", "."): ".out.part/run",
        (
            "finalize",
            "out",
        ): "out: holds an unfinished run whose note is damaged, or of another ibdata; remove",
        ("repair", "out"): "no finished dataset here",
    }
    for command, line in lines.items():
        with suppress(SystemExit):
            main(command)
        said = "".join(capsys.readouterr())
        assert line in said
        assert "bug" not in said
    ibdata.generate(TINY, "out", workers=1, overwrite=True)


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_folder_in_a_part_that_ibdata_does_not_know_stays(begun, overwrite):
    """An older ibdata had its run in a folder with another name."""
    other = part_of("out") / "0123456789abcdef"
    other.mkdir()
    with pytest.raises(UsageError, match=r"0123456789abcdef: found what ibdata did not make"):
        ibdata.generate(TINY, "out", workers=1, overwrite=overwrite)
    assert other.is_dir()


@pytest.mark.parametrize("name", ["old", "run", *(f"run/{path}" for path in ENTERED)])
@pytest.mark.parametrize("overwrite", [False, True])
def test_no_link_in_a_part_is_followed(begun, name, overwrite):
    """Nothing is removed or written where it leads; a name that is missing is a link to a folder."""
    linked = next(part_of("out").glob(name), part_of("out") / name)
    if linked.exists():
        linked.rename("elsewhere")
    else:
        Path("elsewhere").mkdir()
        Path("elsewhere/thesis.txt").touch()
    linked.symlink_to(Path("elsewhere").absolute())
    before = contents()
    for call in (
        lambda: ibdata.generate(TINY, "out", workers=1, overwrite=overwrite),
        lambda: ibdata.finalize("out"),
    ):
        refused(r"what ibdata did not make, expected nothing; |not a dataset of", call)
    assert contents() == before


def test_finalize_refuses_a_run_of_another_data_version(begun, monkeypatch):
    ibdata.generate(TINY, "out", workers=1, shards="1/1")
    monkeypatch.setattr("ibdata.dataset.manifest.DATA_VERSION", 4)
    with pytest.raises(DatasetError, match=r"^out: found an unfinished run of another ibdata; finish it"):
        ibdata.finalize("out")


def test_a_run_goes_on_with_the_same_code_only():
    """tests/generation/test_origin.py does it with files and folders."""
    hashes = ({"helper.py": letter * 64} for letter in "ab")
    codes = (Code(target="mine:Own", version=None, sha256="c" * 64, files=each) for each in hashes)
    one, other = (Record.of(DatasetSpec.of(TINY), code=[code], reproducible=True) for code in codes)
    assert one.difference(DatasetSpec.of(TINY), one) is None
    assert one.difference(DatasetSpec.of(TINY), other) == "with other code, in helper.py"


@pytest.fixture(autouse=True)
def _one_processor(monkeypatch):
    monkeypatch.setattr("ibdata.generation.workers.available_processors", lambda: 1)  # shards in order


FULL = OSError(28, "No space left on device")
ERRORS = {  # after how many shards what is raised, what is seen, and its line
    "a full disk": (0, FULL, IbdataError, r"^a/b: cannot be written: No space left on device$"),
    "memory": (2, MemoryError(), IbdataError, r"^a/b: out of memory; use fewer workers"),
    "a signal": (2, Interrupted(15), Interrupted, r"^stopped by signal 15; 2 shards are"),
    "an early signal": (0, Interrupted(15), Interrupted, r"^stopped by signal 15; nothing"),
    "a bug": (2, ZeroDivisionError(), ZeroDivisionError, None),
}


@pytest.mark.parametrize(("shards", "error", "seen", "line"), ERRORS.values(), ids=ERRORS)
def test_an_error_leaves_finished_shards_or_nothing(monkeypatch, files, tiny, shards, error, seen, line):
    """tests/life and tests/faults raise errors of the system at any operation."""
    real, calls = workers.write_shard, iter(range(9))

    def failing(*args):
        if next(calls) >= shards:
            raise error
        return real(*args)

    with monkeypatch.context() as patched:
        patched.setattr(workers, "write_shard", failing)
        with pytest.raises(seen, match=line):
            ibdata.generate(TINY, "a/b", workers=1)
    assert len(receipts("a/b")) == shards
    assert bool(contents()) == bool(shards)
    ibdata.generate(TINY, "a/b", workers=1)
    assert is_right("a/b", tiny[0].path, files)
