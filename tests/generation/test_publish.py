"""A dataset gets its name by one rename or exchange, and nothing of the old one or of a user is lost."""

from __future__ import annotations

import os
import shutil
import stat
from pathlib import Path

import pytest
from helpers.folders import is_right, part_of
from helpers.tiny import FOUR_SHARDS as TINY

import ibdata
from ibdata.errors import BusyError
from ibdata.system import part
from ibdata.system.files import write

OTHER = TINY.model_copy(update={"seed": 1})


class Killed(BaseException):
    """Stands for a SIGKILL: no code of ibdata handles it."""


@pytest.fixture(autouse=True)
def _beside_a_dataset(tiny):
    shutil.copytree(tiny[1].path, "out")


@pytest.fixture(params=[True, False], ids=["exchange", "renames"])
def exchange(request, monkeypatch):
    """Whether the system can exchange two folders."""
    if not request.param:
        monkeypatch.setattr(part, "exchanged", lambda a, b: False)
    return request.param


def replace(experiment=TINY):
    return ibdata.generate(experiment, "out", workers=1, overwrite=True)


def test_no_two_runs_give_a_file_the_same_name():
    """The names of shards differ between runs, so that a late reader gets an error and never other rows."""
    first, second = ({path.name for path in Path(replace().path, "data").iterdir()} for _ in range(2))
    assert len(first | second) == 8


READS = [
    lambda d: d.table(),
    lambda d: d.to_pandas(),
    lambda d: d.episodes,
    lambda d: d.statistics(),
    lambda d: list(d.iter_batches()),
]


def test_who_opened_the_old_dataset_is_told(exchange):
    """Whatever a dataset that was opened before the replacement reads afterwards is a BusyError."""
    before = [ibdata.open("out") for _ in READS]
    replace()
    for dataset, read in zip(before, READS, strict=True):
        with pytest.raises(BusyError, match=r"^out: replaced while it was read; open it again") as error:
            read(dataset)
        assert error.value.exit_code == 75
    assert len(ibdata.open("out").table()) == 20


def test_mode_and_group_are_kept(exchange):
    """A replaced dataset keeps the modes and groups of its folders and files."""
    for path, mode in {"out": 0o2750, "out/data": 0o770, "out/meta/manifest.json": 0o640}.items():
        if os.geteuid() == 0:
            os.chown(path, -1, 12345)
        Path(path).chmod(mode)
    group = Path("out").stat().st_gid
    dataset = replace()
    paths = ["out", "out/data", "out/meta/manifest.json", f"out/{dataset.manifest['shards'][0]['path']}"]
    found = [(stat.S_IMODE(os.stat(path).st_mode), os.stat(path).st_gid) for path in paths]
    assert found == [(0o2750, group), (0o770, group), (0o640, group), (0o640, group)]


def test_an_edited_card_is_kept_beside_the_new_one(exchange, capsys):
    """A README.md that somebody has edited becomes README.md.old, said on stderr, and stays there."""
    card, old = Path("out/README.md"), Path("out/README.md.old")
    replace()
    assert not old.exists()
    text = card.read_text().replace("# ", "# My ", 1)
    card.write_text(text)
    replace(OTHER)
    assert capsys.readouterr().err.endswith("out/README.md: was edited, and is now README.md.old\n")
    assert text != card.read_text()
    replace()
    assert (old.read_text(), capsys.readouterr().err) == (text, "")
    assert ibdata.validate("out") == []


# --- killed while publishing


def kill_between_renames(monkeypatch):
    """Let a run that replaces the dataset be killed where the folders cannot be exchanged."""
    calls, rename = iter(range(9)), Path.rename

    def second(path, target):
        if target == Path("out").resolve() and next(calls) == 0:
            raise Killed
        return rename(path, target)

    with monkeypatch.context() as patched:
        patched.setattr(part, "exchanged", lambda a, b: False)
        patched.setattr(Path, "rename", second)
        with pytest.raises(Killed):
            replace()


NEXT = {
    "plain": lambda: ibdata.generate(TINY, "out", workers=1),
    "resume": lambda: ibdata.generate(TINY, "out", workers=1, resume=True),
    "overwrite": replace,
    "finalize": lambda: ibdata.finalize("out"),
    "shards": lambda: (ibdata.generate(TINY, "out", shards="1/2", workers=1), ibdata.finalize("out")),
}


@pytest.mark.parametrize("then", NEXT.values(), ids=NEXT)
def test_a_kill_between_two_renames_is_settled(tiny, files, monkeypatch, then):
    """Where the folders cannot be exchanged, whoever comes next gives the new dataset its name."""
    kill_between_renames(monkeypatch)
    assert not Path("out").exists()
    then()
    assert is_right("out", tiny[0].path, files)


# --- on the disk


@pytest.fixture
def events(monkeypatch):
    """What is synced, renamed and exchanged, in order, by paths."""
    seen = []

    def noting(name, real):
        def noted(*args):
            seen.append((name, *map(str, args)))
            return real(*args)

        return noted

    real = os.fsync
    monkeypatch.setattr(
        os, "fsync", lambda fd: seen.append(("sync", os.readlink(f"/proc/self/fd/{fd}"))) or real(fd)
    )
    monkeypatch.setattr(part, "exchanged", noting("move", part.exchanged))
    for name in ("rename", "replace"):
        monkeypatch.setattr(Path, name, noting("move", getattr(Path, name)))
    return seen


@pytest.mark.parametrize("out", ["new", "out"], ids=["new", "replaced"])
def test_all_is_on_the_disk_before_it_is_published(events, tmp_path, out):
    """Every file and folder of a dataset is synced before it gets its name, and the name afterwards."""
    ibdata.generate(TINY, out, workers=1, overwrite=True)
    target, inner = tmp_path / out, part_of(tmp_path / out) / "dataset"
    (at,) = [i for i, event in enumerate(events) if event == ("move", str(inner), str(target))]
    moved = [inner / path.relative_to(target) for path in [target, *target.rglob("*")]]
    before = [event[1] for event in events[:at] if event[0] == "sync"]
    assert {str(path) for path in moved} <= set(before)
    last = {path: i for i, path in enumerate(before)}
    assert all(last[str(p.parent)] > last[str(p)] for p in moved if p != inner)
    assert ("sync", str(tmp_path)) in events[at:]


def test_a_receipt_follows_its_shard_to_the_disk(events, tmp_path):
    """A receipt gets its name when the shard's file and the receipt itself are on the disk."""
    ibdata.generate(TINY, "new", shards="1/4", workers=1)
    folder = part_of(tmp_path / "new")
    (shard,) = (folder / "dataset/data").iterdir()
    (move,) = [event for event in events if event[-1] == str(folder / "receipts/00000.npy")]
    order = [events.index(event) for event in (("sync", str(shard)), ("sync", move[1]), move)]
    assert order == sorted(order)


def test_a_small_file_is_on_the_disk_before_it_replaces_another(events, tmp_path):
    """A file that `write` replaces is synced, then renamed, then its folder is synced."""
    write(tmp_path, "out/README.md", b"new")
    (_, temporary), (_, *renamed), (_, folder) = events
    assert renamed == [temporary, str(tmp_path / "out/README.md")]
    assert folder == str(tmp_path / "out")
