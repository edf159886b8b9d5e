"""What `generate` does with what is at its place, and what a preview says that it would do."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from helpers.folders import contents, is_right, part_of
from helpers.tiny import FOUR_SHARDS as TINY

import ibdata
from ibdata.dataset import manifest
from ibdata.errors import IbdataError, UsageError
from ibdata.generation import make_shard
from ibdata.generation.estimate import estimate

OTHER = TINY.model_copy(update={"seed": 1})


def begun(experiment=TINY):
    """An unfinished run with one finished shard of four."""
    ibdata.generate(experiment, "out", shards="1/4", workers=1)


def without_a_shard():
    begun(OTHER)
    shutil.rmtree(part_of("out") / "receipts")


def replacing():
    begun()
    part_of("out").rename("aside")
    ibdata.generate(OTHER, "out", workers=1)
    Path("aside").rename(part_of("out"))


def dataset(experiment=TINY):
    ibdata.generate(experiment, "out", workers=1)


def with_file(path):
    """A dataset, in which a file has been replaced or added."""
    return lambda: (dataset(), Path("out", path).write_text("mine"))


def without(path):
    return lambda: (dataset(), Path("out", path).unlink())


def foreign():
    Path("out").mkdir()
    Path("out/notes.txt").write_text("mine")


def linked():
    dataset()
    Path("out").rename("elsewhere")
    Path("out").symlink_to("elsewhere")


STATES = {
    "nothing": lambda: None,
    "an empty folder": lambda: Path("out").mkdir(),
    "a file": lambda: Path("out").write_text("mine"),
    "a folder": foreign,
    "the dataset": dataset,
    "a link to it": linked,
    "with a report": with_file(manifest.REPORT),
    "with a note": with_file("notes.txt"),
    "with another manifest": with_file(manifest.PATH),
    "without a manifest": without(manifest.PATH),
    "without its experiment": without(manifest.EXPERIMENT),
    "another dataset": lambda: dataset(OTHER),
    "begun": begun,
    "begun in vain": without_a_shard,
    "another begun": lambda: begun(OTHER),
    "replacing another": replacing,
}
REPLACE = "out: holds the dataset of another experiment; --overwrite to replace it"
BEGUN = "out: holds an unfinished run; --resume to go on with it"
ANOTHER = "out: holds an unfinished run of another experiment; --overwrite to start again, or choose another"
FILE = "out: is a file, not a folder; choose another --out"
FOREIGN = "out: not a dataset of ibdata, left as it is; choose another --out"
DAMAGED = "out: not a dataset of ibdata, left as it is ("
NOTE = "out/notes.txt: found a file that is not the dataset's; move it away"
LOST = "out/meta/experiment.yaml: missing; run ibdata repair "
OUTCOMES = {  # without options, with --resume, with --overwrite
    "nothing": ("made", "made", "made"),
    "an empty folder": ("made", "made", "made"),
    "a file": (FILE, FILE, FILE),
    "a folder": (FOREIGN, FOREIGN, FOREIGN),
    "the dataset": ("there", "there", "replaced"),
    "a link to it": ("there", "there", "replaced"),
    "with a report": ("there", "there", "replaced"),
    "with a note": ("there", "there", NOTE),
    "with another manifest": (DAMAGED, DAMAGED, DAMAGED),
    "without a manifest": (FOREIGN, FOREIGN, FOREIGN),
    "without its experiment": (LOST, LOST, "replaced"),
    "another dataset": (REPLACE, REPLACE, "replaced"),
    "begun": (BEGUN, "goes on", "goes on"),
    "begun in vain": ("made", "made", "made"),
    "another begun": (ANOTHER, ANOTHER, "discards"),
    "replacing another": (REPLACE, REPLACE, "goes on"),
}
SHARDS = {"made": 4, "replaced": 4, "discards": 4, "goes on": 3, "there": 0}
PREVIEWS = {
    "made": None,
    "replaced": "exists; generate would replace the dataset in it",
    "there": "exists; generate would find the dataset finished, and write nothing",
    "goes on": "generate would go on with the unfinished run in it",
    "discards": "generate would discard the unfinished run in it",
}
SAID = {
    "there": "ibdata: out: already there; nothing was written\n",
    "discards": "ibdata: out: the unfinished run of another experiment that was begun here is discarded\n",
}
CASES = [
    pytest.param(state, options, outcome, id=f"{state}-{name}")
    for state, outcomes in OUTCOMES.items()
    for (name, options), outcome in zip(
        {"plain": {}, "resume": {"resume": True}, "overwrite": {"overwrite": True}}.items(),
        outcomes,
        strict=True,
    )
]


@pytest.fixture(scope="module")
def states(tmp_path_factory):
    """A folder for each state."""
    home = tmp_path_factory.mktemp("states")
    with pytest.MonkeyPatch.context() as patch:
        for name, prepare in STATES.items():
            (home / name).mkdir()
            patch.chdir(home / name)
            prepare()
    return home


@pytest.fixture(scope="module")
def plain(states):
    return ibdata.open(states / "the dataset/out")


@pytest.fixture
def made(monkeypatch):
    """The numbers of the shards that are made."""
    numbers, real = [], make_shard.make_shard

    def noted(spec, shard, *rest):
        numbers.append(shard.number)
        real(spec, shard, *rest)

    monkeypatch.setattr("ibdata.generation.workers.make_shard", noted)
    return numbers


def preview(**options):
    """What a preview says that `generate` would do."""
    try:
        return estimate(TINY, "out", workers=1, **options)["folder"]
    except IbdataError as error:
        return str(error)


@pytest.mark.parametrize(("state", "options", "outcome"), CASES)
def test_each_state_has_one_outcome(states, plain, made, files, capsys, state, options, outcome):
    """A run makes, replaces, resumes or refuses, as the table and a preview say, and leaves nothing else."""
    shutil.copytree(states / state, ".", symlinks=True, dirs_exist_ok=True)
    before = contents()
    said = preview(**options)
    assert contents() == before
    if outcome not in SHARDS:
        with pytest.raises(IbdataError) as error:
            ibdata.generate(TINY, "out", workers=1, **options)
        assert outcome in str(error.value)
        assert outcome in said
        assert error.value.exit_code == (3 if outcome == LOST else 2)
        assert (made, contents()) == ([], before)
        return
    assert said == PREVIEWS[outcome]
    ibdata.generate(TINY, "out", workers=1, **options)
    assert len(made) == SHARDS[outcome]
    assert outcome == "there" or is_right("out", plain.path, files)
    assert capsys.readouterr().err == SAID.get(outcome, "")
    assert (contents() == before) == (outcome == "there")


@pytest.mark.parametrize("call", [ibdata.generate, ibdata.estimate])
def test_resume_and_overwrite_exclude_each_other(call):
    """Both options together are refused, whatever is there."""
    with pytest.raises(UsageError, match=r"^--resume and --overwrite exclude each other"):
        call(TINY, "out", resume=True, overwrite=True)


@pytest.mark.parametrize("resume", [False, True])
def test_a_finished_dataset_needs_no_writing(plain, monkeypatch, resume):
    """A finished dataset on a read-only disk is opened: no lock is taken and no folder is made."""
    monkeypatch.setattr("ibdata.generation.run.locked_part", None)
    shutil.copytree(plain.path, "out")
    assert ibdata.generate(TINY, "out", workers=1, resume=resume).content_root == plain.content_root


def test_a_damaged_shard_of_a_part_is_made_again(plain, made, files):
    """A shard of an unfinished run whose file is not the one of its receipt is made again."""
    begun()
    (shard,) = (part_of("out") / "dataset/data").iterdir()
    shard.write_bytes(shard.read_bytes()[:-1])
    made.clear()
    ibdata.generate(TINY, "out", workers=1, resume=True)
    assert sorted(made) == [0, 1, 2, 3]
    assert is_right("out", plain.path, files)


@pytest.mark.parametrize("damage", [b"", b"x" * 100, None], ids=["empty", "other", "cut"])
def test_a_damaged_receipt_counts_as_none(plain, files, damage):
    """A shard whose receipt cannot be read is made again."""
    begun()
    (path,) = (part_of("out") / "receipts").iterdir()
    path.write_bytes(path.read_bytes()[:-9] if damage is None else damage)
    ibdata.generate(TINY, "out", workers=1, resume=True)
    assert is_right("out", plain.path, files)


@pytest.mark.parametrize("note", [None, b"", b"{", b"[]", b'{"code": []}'])
def test_a_run_without_its_note_is_begun_again_only(plain, files, note):
    """An unfinished run whose note is lost or damaged is refused by --resume and discarded by --overwrite."""
    begun()
    path = part_of("out") / "run.json"
    path.unlink() if note is None else path.write_bytes(note)
    for options in ({}, {"resume": True}):
        with pytest.raises(UsageError, match=r"^out: holds an unfinished run of another experiment; --overw"):
            ibdata.generate(TINY, "out", workers=1, **options)
    with pytest.raises(UsageError, match=r"^out: holds no run to finish"):
        ibdata.finalize("out")
    ibdata.generate(TINY, "out", workers=1, overwrite=True)
    assert is_right("out", plain.path, files)
