"""A dataset gets its name by one rename or exchange, and nothing of the old one or of a user is lost."""

import os
import shutil
import stat
from pathlib import Path

import pytest
from helpers.folders import is_right, part_of
from helpers.tiny import FOUR_SHARDS as TINY

import ibdata
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


def replace(experiment=TINY):
    return ibdata.generate(experiment, "out", workers=1, overwrite=True)


def test_no_two_runs_give_a_file_the_same_name():
    """So that a late reader gets an error and never other rows."""
    first, second = ({path.name for path in Path(replace().path, "data").iterdir()} for _ in range(2))
    assert len(first | second) == 8


def test_mode_and_group_are_kept(exchange):
    for path, mode in {"out": 0o2750, "out/data": 0o770, "out/meta/manifest.json": 0o640}.items():
        if os.geteuid() == 0:
            os.chown(path, -1, 12345)
        Path(path).chmod(mode)
    group = Path("out").stat().st_gid
    shard = replace().manifest["shards"][0]["path"]
    paths = ["out", "out/data", "out/meta/manifest.json", f"out/{shard}"]
    found = [(stat.S_IMODE(os.stat(path).st_mode), os.stat(path).st_gid) for path in paths]
    assert found == [(0o2750, group), (0o770, group), (0o640, group), (0o640, group)]


def test_an_edited_card_is_kept_beside_the_new_one(exchange, capsys):
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


NEXT = {
    "plain": lambda: ibdata.generate(TINY, "out", workers=1),
    "overwrite": replace,
    "finalize": lambda: ibdata.finalize("out"),
    "shards": lambda: (ibdata.generate(TINY, "out", shards="1/2", workers=1), ibdata.finalize("out")),
}


@pytest.mark.parametrize("then", NEXT.values(), ids=NEXT)
def test_a_kill_between_two_renames_is_settled(tiny, files, monkeypatch, then):
    """Where the folders cannot be exchanged, whoever comes next gives the new dataset its name."""
    calls, rename = iter(range(9)), Path.rename

    def killed(path, target):
        if target == Path("out").resolve() and next(calls) == 0:
            raise Killed
        return rename(path, target)

    with monkeypatch.context() as patched:
        patched.setattr(part, "exchanged", lambda a, b: False)
        patched.setattr(Path, "rename", killed)
        with pytest.raises(Killed):
            replace()
    assert not Path("out").exists()
    then()
    assert is_right("out", tiny[0].path, files)


# --- on the disk


@pytest.fixture
def events(monkeypatch):
    """What is synced, renamed and exchanged, in order, by paths."""
    seen = []

    def noting(name, real, path_of=str):
        def noted(*args):
            seen.append((name, *map(path_of, args)))
            return real(*args)

        return noted

    path_of = lambda descriptor: os.readlink(f"/proc/self/fd/{descriptor}")  # noqa: E731
    monkeypatch.setattr(os, "fsync", noting("sync", os.fsync, path_of))
    monkeypatch.setattr(part, "exchanged", noting("move", part.exchanged))
    for name in ("rename", "replace"):
        monkeypatch.setattr(Path, name, noting("move", getattr(Path, name)))
    return seen


@pytest.mark.parametrize("out", ["new", "out"], ids=["new", "replaced"])
def test_all_is_on_the_disk_before_it_is_published(events, tmp_path, out):
    """Every file and folder is synced before the dataset gets its name, and the name afterwards."""
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
    ibdata.generate(TINY, "new", shards="1/4", workers=1)
    folder = part_of(tmp_path / "new")
    (shard,) = (folder / "dataset/data").iterdir()
    (move,) = [event for event in events if event[-1] == str(folder / "receipts/00000.npy")]
    order = [events.index(event) for event in (("sync", str(shard)), ("sync", move[1]), move)]
    assert order == sorted(order)


def test_a_small_file_is_on_the_disk_before_it_replaces_another(events, tmp_path):
    write(tmp_path, "out/README.md", b"new")
    (_, temporary), (_, *renamed), (_, folder) = events
    assert renamed == [temporary, str(tmp_path / "out/README.md")]
    assert folder == str(tmp_path / "out")
