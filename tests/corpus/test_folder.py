"""What the commands that write say of what they find at a place; nothing is changed unasked."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.tiny import FOUR_SHARDS

import ibdata
from ibdata.cli import main
from ibdata.dataset import manifest
from ibdata.experiment import as_yaml
from ibdata.system.part import locked_part

pytestmark = pytest.mark.corpus

OTHER = FOUR_SHARDS.model_copy(update={"seed": 1})


def nothing() -> None:
    """The place is free."""


def empty() -> None:
    os.mkdir("d")


def file() -> None:
    Path("d").write_text("mine")


def somebodys() -> None:
    os.mkdir("d")
    Path("d/notes.txt").write_text("mine")


def dataset() -> None:
    shutil.copytree("made", "d")


def other() -> None:
    shutil.copytree("other", "d")


def linked() -> None:
    dataset()
    os.rename("d", "elsewhere")
    os.symlink("elsewhere", "d")


def with_file(path: str) -> Callable[[], None]:
    def make() -> None:
        dataset()
        Path("d", path).write_text("mine")

    return make


def without(path: str) -> Callable[[], None]:
    def make() -> None:
        dataset()
        Path("d", path).unlink()

    return make


def unfinished(experiment: ibdata.Experiment) -> Callable[[], None]:
    def make() -> None:
        ibdata.generate(experiment, "d", shards="1/2", workers=1)

    return make


def unfinished_beside() -> None:
    """A replacement of the dataset of another experiment was stopped."""
    unfinished(FOUR_SHARDS)()
    other()


def stale() -> None:
    """A run was killed before its first shard."""
    Path(".d.part/dataset/data").mkdir(parents=True)
    Path(".d.part/dataset/data/part-00000-00000000.parquet").write_bytes(b"half")


THERE = (0, "ibdata: d: already there; nothing was written")
MADE = (0, "")
FOREIGN = (2, "d: not a dataset of ibdata, left as it is; choose another --out")
OF_ANOTHER = (2, "d: holds the dataset of another experiment; --overwrite to replace it")
BEGUN = "d: holds an unfinished run"
ELSE = "--overwrite to start again, or choose another --out"
# What is there; then exit code and line of `generate`, with --resume, and with --overwrite.
TABLE = {
    nothing: (MADE, MADE, MADE),
    empty: (MADE, MADE, MADE),
    stale: (MADE, MADE, MADE),
    file: ((2, "d: is a file, not a folder; choose another --out"),) * 3,
    somebodys: (FOREIGN, FOREIGN, FOREIGN),
    dataset: (THERE, THERE, MADE),
    linked: (THERE, THERE, MADE),
    other: (OF_ANOTHER, OF_ANOTHER, MADE),
    with_file("notes.txt"): (
        THERE,
        THERE,
        (2, "d/notes.txt: found a file that is not the dataset's; move it away"),
    ),
    with_file("data/x.parquet"): (
        THERE,
        THERE,
        (2, "d/data/x.parquet: found a file that is not the dataset's; move it away"),
    ),
    with_file("README.md"): (THERE, THERE, (0, "ibdata: d/README.md: was edited, and is now README.md.old")),
    with_file(manifest.REPORT): (THERE, THERE, MADE),
    without(manifest.PATH): (FOREIGN, FOREIGN, FOREIGN),
    with_file(manifest.PATH): (
        (2, "d: not a dataset of ibdata, left as it is (d/meta/manifest.json: …); choose another --out"),
    )
    * 3,
    without(manifest.EXPERIMENT): (
        (3, "d/meta/experiment.yaml: missing; run ibdata repair d"),
        (3, "d/meta/experiment.yaml: missing; run ibdata repair d"),
        MADE,
    ),
    unfinished(FOUR_SHARDS): (
        (2, f"{BEGUN}; --resume to go on with it"),
        MADE,
        MADE,
    ),
    unfinished(OTHER): (
        (2, f"{BEGUN} of another experiment; {ELSE}"),
        (2, f"{BEGUN} of another experiment; {ELSE}"),
        (0, "ibdata: d: the unfinished run of another experiment that was begun here is discarded"),
    ),
    unfinished_beside: (OF_ANOTHER, OF_ANOTHER, MADE),
}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folders with the datasets of both experiments, and with x.yaml."""
    folder = tmp_path_factory.mktemp("made")
    ibdata.generate(FOUR_SHARDS, folder / "made", workers=1)
    ibdata.generate(OTHER, folder / "other", workers=1)
    (folder / "x.yaml").write_bytes(as_yaml(FOUR_SHARDS))
    return folder


@pytest.fixture
def run(made, tmp_path, monkeypatch, capfd):
    shutil.copytree(made, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ibdata.cli._end_at_signals", lambda: None)  # the tests have handlers of their own

    def call(*args: str) -> tuple[int, str]:
        with pytest.raises(SystemExit) as end:
            main(args)
        sys.stdout.flush()
        return end.value.code or 0, capfd.readouterr().err.replace(f"{tmp_path}/", "").rstrip("\n")

    return call


def contents() -> dict[str, bytes | None]:
    paths = [Path(folder, name) for folder, folders, files in os.walk(".") for name in (*folders, *files)]
    return {str(path): path.read_bytes() if path.is_file() else None for path in paths}


CASES = [
    pytest.param(prepare, option, *answer, id=f"{prepare.__qualname__.partition('.')[0]} {option}")
    for prepare, answers in TABLE.items()
    for option, answer in zip(((), ("--resume",), ("--overwrite",)), answers, strict=True)
]


@pytest.mark.parametrize(("prepare", "option", "code", "line"), CASES)
def test_generate_says_what_it_finds_and_makes_the_dataset_or_changes_nothing(
    run, prepare, option, code, line
):
    prepare()
    before = contents()
    found, said = run("generate", "x.yaml", "--out", "d", "--workers", "1", *option)
    start, _, end = line.partition("…")
    assert (found, said[: len(start)], said[len(said) - len(end) :]) == (code, start, end), said
    assert len(said.splitlines()) == bool(line)
    if code or "already there" in line:
        assert contents() == before
    else:
        assert ibdata.open("d").content_root == ibdata.open("made").content_root
        assert ibdata.validate("d") == []
        assert not Path(".d.part").exists()


@pytest.mark.parametrize(
    ("out", "line"),
    [
        (".", ".: is the current folder or around it; choose another --out"),
        ("..", "..: is the current folder or around it; choose another --out"),
        ("/proc", "/proc: is a mount point, which cannot be replaced; choose a folder in it"),
        ("made/data/d", "made/data/d: lies within the dataset made; choose a place outside of it"),
        ("link/data", "made/data: lies within the dataset made; choose a place outside of it"),
        ("policy=x/d", "policy=x/d: found the folder policy=x, from whose name some readers would take the"),
        ("x.yaml/d", "x.yaml/d: lies in a file, not a folder; choose another --out"),
    ],
)
def test_no_command_writes_to_a_place_at_which_no_dataset_can_appear(run, out, line):
    os.symlink("made", "link")
    before = contents()
    for args in (
        ("generate", "x.yaml", "--overwrite", "--out", out),
        ("generate", "x.yaml", "--shards", "1/2", "--out", out),
        ("merge", "made", "other", "--out", out),
        ("split", "made", "--materialize", out),
    ):
        code, said = run(*args)
        assert (code, said[: len(line)]) == (2, line), args
    assert contents() == before


def test_a_second_writer_is_refused(run):
    dataset()
    with locked_part(Path("d").resolve()):
        for args in (
            ("generate", "x.yaml", "--overwrite", "--out", "d"),
            ("split", "d", "--fractions", "0.5,0.5"),
            ("card", "d"),
        ):
            assert run(*args) == (
                75,
                "d: another process is writing here; wait for it, or choose another --out",
            )
