"""A dataset gets its name by one rename or exchange, and nothing that is not the dataset's is lost."""

import os
import shutil
import stat
from contextlib import suppress
from pathlib import Path
from unittest.mock import Mock

import pytest
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.folders import is_right
from helpers.objects import Mine
from helpers.refusals import refused

import ibdata
from ibdata._system import part
from ibdata._system.files import read_hashed, with_hash, write
from ibdata._system.part import locked_part
from ibdata.cli import main
from ibdata.errors import DatasetError, Interrupted, UsageError

OTHER = TINY.model_copy(update={"seed": 1})


@pytest.fixture(autouse=True)
def _beside_a_dataset(tiny):
    shutil.copytree(tiny[1].path, "out")


def replace(experiment=TINY):
    return ibdata.generate(experiment, "out", workers=1, overwrite=True)


def test_mode_and_group_are_kept():
    for path, mode in {"out": 0o2750, "out/data": 0o770, "out/meta/manifest.json": 0o640}.items():
        if os.geteuid() == 0:
            os.chown(path, -1, 12345)
        Path(path).chmod(mode)
    group = Path("out").stat().st_gid
    shard = replace().manifest["shards"][0]["path"]
    paths = ["out", "out/data", "out/meta/manifest.json", f"out/{shard}"]
    found = [(stat.S_IMODE(os.stat(path).st_mode), os.stat(path).st_gid) for path in paths]
    assert found == [(0o2750, group), (0o770, group), (0o640, group), (0o640, group)]


@pytest.fixture(scope="module")
def killed(tiny, tmp_path_factory):
    """A folder as a run leaves it that is killed between two renames."""
    folder = tmp_path_factory.mktemp("killed")
    shutil.copytree(tiny[1].path, folder / "out")

    def rename(path, target, real=part.rename):
        real(path, target)
        if target.name == part.OLD:
            shutil.copytree(folder, folder / "as it is")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(part, "exchanged", lambda a, b: False)
        patch.setattr(part, "rename", rename)
        ibdata.generate(TINY, folder / "out", workers=1, overwrite=True)
    assert [path.name for path in (folder / "as it is").iterdir()] == [".out.part"]
    return folder / "as it is"


OTHERS = {
    "itself": lambda path: ibdata.generate(OTHER, "out", workers=1),
    "a range": lambda path: ibdata.generate(TINY, "out", workers=1, shards="1/2"),
    "finalize": lambda path: ibdata.finalize("out"),
    "merge": lambda path: ibdata.merge([path, path.with_name("0")], "out"),
    "export": lambda path: ibdata.export(path, "npz", "out", overwrite=True),
    "card": lambda path: locked_part(Path("out").absolute()).__enter__(),
}


@pytest.mark.parametrize("write", OTHERS.values(), ids=OTHERS)
def test_the_old_dataset_is_not_lost_between_two_renames(killed, tiny, files, write):
    shutil.rmtree("out")
    shutil.copytree(killed, ".", dirs_exist_ok=True)
    with suppress(ibdata.IbdataError):
        write(tiny[1].path)
    assert files("out") == files(tiny[1].path)
    assert ibdata.validate("out") == []


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


def test_a_file_is_on_the_disk_before_it_has_its_name_and_the_name_afterwards(events, tmp_path):
    write(tmp_path, "x", b"new")
    assert [name for name, *_ in events] == ["sync", "move", "sync"]
    assert events[-1] == ("sync", str(tmp_path))


@pytest.mark.parametrize("out", ["new", "out"], ids=["new", "replaced"])
def test_all_is_on_the_disk_before_it_is_published(events, tmp_path, out):
    """Every file and folder is synced before the dataset gets its name, and the name afterwards."""
    ibdata.generate(TINY, out, workers=1, overwrite=True)
    target = tmp_path / out
    ((at, inner),) = [(i, Path(event[1])) for i, event in enumerate(events) if event[-1] == str(target)]
    moved = [inner / path.relative_to(target) for path in [target, *target.rglob("*")]]
    before = [event[1] for event in events[:at] if event[0] == "sync"]
    assert {str(path) for path in moved} <= set(before)
    last = {path: i for i, path in enumerate(before)}
    assert all(last[str(p.parent)] > last[str(p)] for p in moved if p != inner)
    assert ("sync", str(tmp_path)) in events[at:]


def kill_if_published(self, real=part.Part.clear):
    if self.receipts:
        raise KeyboardInterrupt
    real(self)


@pytest.mark.parametrize(("exchange", "first"), [(True, False), (False, False), (True, True)])
def test_a_dataset_that_was_published_before_a_kill_may_be_moved_away(
    tiny, files, monkeypatch, exchange, first
):
    """What it has replaced does not come back, and none of its shards are taken for those of the next run."""
    if first:
        shutil.rmtree("out")
    if not exchange:
        monkeypatch.setattr(part, "exchanged", lambda a, b: False)
    with monkeypatch.context() as killed, suppress(KeyboardInterrupt):
        killed.setattr(part.Part, "clear", kill_if_published)
        replace()
    Path("out").rename("aside")
    assert part.Part(Path("out").absolute()).receipts
    with locked_part(Path("out").absolute()):
        assert not Path("out").exists()
    ibdata.generate(TINY, "out", workers=1)
    for name in ("aside", "out"):
        assert is_right(name, tiny[0].path, files)
    assert not Path(".out.part").exists()


def test_a_preview_sees_the_dataset_that_is_to_be_restored(killed):
    """As the run after it, and a dry run moves nothing."""
    shutil.rmtree("out")
    shutil.copytree(killed, ".", dirs_exist_ok=True)
    assert ibdata.estimate(OTHER, "out")["action"] == "open the finished dataset"
    refused(r"^out: holds the dataset of another experiment .seed: found 1, e", ibdata.estimate, TINY, "out")
    assert not Path("out").exists()


def test_overwrite_drops_the_run_of_a_third_experiment(files, capsys):
    third = TINY.model_copy(update={"seed": 3})
    shutil.rmtree("out")
    ibdata.generate(third, "out", workers=1, shards="1/4")
    Path(".out.part").rename("aside")
    ibdata.generate(OTHER, "out", workers=1)
    Path("aside").rename(".out.part")
    with pytest.raises(UsageError) as refused:
        ibdata.generate(TINY, "out", workers=1)
    assert str(refused.value) == (
        "out: holds the dataset of another experiment (seed: found 1, expected 0), and an unfinished run of "
        "another experiment (seed: found 3, expected 0), 1 of 4 shards; overwrite=True to replace both, or "
        "choose another out"
    )
    replace()
    dropped = "dropped an unfinished run of another experiment (seed: found 3, expected 0), 1 of 4 shards"
    assert capsys.readouterr().err == f"ibdata: out: {dropped}\n"
    assert ibdata.open("out").content_root == ibdata.generate(TINY, "plain", workers=1).content_root


@pytest.mark.parametrize("after", [ibdata.finalize, lambda out: ibdata.generate(TINY, out, workers=1)])
def test_what_was_published_leaves_nothing(monkeypatch, after, capsys):
    """The command that was killed after it published tidies up when it is repeated."""
    shutil.rmtree("out")
    for number in "12":
        ibdata.generate(TINY, "out", workers=1, shards=f"{number}/2")
    with monkeypatch.context() as killed, suppress(KeyboardInterrupt):
        killed.setattr(part.Part, "clear", kill_if_published)
        after("out")
    assert Path(".out.part").exists()
    assert capsys.readouterr().err == ""
    with suppress(SystemExit):
        main(["ls", "."])
    assert "unfinished" not in capsys.readouterr().out
    after("out")
    assert not Path(".out.part").exists()


def test_a_run_of_a_session_s_object_is_no_unfinished_run(monkeypatch, capsys):
    """Nobody can go on with it, so nothing says so, also where it was killed."""
    with monkeypatch.context() as stopping:
        stopping.setattr("ibdata.generation.build.finish", Mock(side_effect=Interrupted(2)))
        stopping.setattr("ibdata.generation.folder.Folder.clear", Mock())
        with pytest.raises(Interrupted):
            ibdata.generate({"name": "x", "setpoints": 70, "steps": 4, "policies": [Mine()]}, "live")
    assert Path(".live.part/run/receipts").exists()
    with suppress(SystemExit):
        main(["ls", "."])
    assert "unfinished" not in capsys.readouterr().out
    assert "unfinished" not in ibdata.validate("live")[0].message
    ibdata.generate(TINY, "live", workers=1)


def test_a_run_of_another_version_is_refused(tiny, files, capsys):
    """Whose experiment this version does not read."""
    shutil.rmtree("out")
    ibdata.generate(TINY, "out", workers=1, shards="1/2")
    run = Path(".out.part/run/run.json")
    write(run.parent, run.name, with_hash(read_hashed(run).replace(b'"random"', b'"wander"')))
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["ls", "."])
    assert "unfinished, unreadable" in capsys.readouterr().out
    refused(r"^out: found an unfinished run of another ibdata", ibdata.finalize, "out", error=DatasetError)
    with pytest.raises(UsageError, match=r"^out: holds an unfinished run of another .*\(policies.*2 of 4"):
        ibdata.generate(TINY, "out", workers=1)
    replace()
    assert is_right("out", tiny[0].path, files)
