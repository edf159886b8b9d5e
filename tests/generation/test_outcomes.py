"""What `generate` does with what is at its place, and what a preview says that it would do."""

import shutil
from pathlib import Path

import pytest
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.folders import contents, is_right, part_of
from ibdata.generation.target import Action, At, Begun, Found, Mode, TakenError, decide

import ibdata
from ibdata.dataset import manifest
from ibdata.errors import DatasetError, IbdataError, UsageError
from ibdata.generation import workers
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


def with_report():
    return dataset(), Path("out", manifest.REPORT).write_bytes(b"a page")


def without(path):
    return lambda: (dataset(), *(file.unlink() for file in Path("out").glob(path)))


def foreign():
    Path("out").mkdir()
    Path("out/notes.txt").write_text("mine")


def linked():
    dataset()
    Path("out").rename("elsewhere")
    Path("out").symlink_to("elsewhere")


REPLACE = "out: holds the dataset of another experiment; --overwrite to replace it"
BEGUN = "out: holds an unfinished run; --resume to go on with it"
ANOTHER = "out: holds an unfinished run of another experiment; --overwrite to start again, or choose another"
FILE = "out: is a file, not a folder; choose another --out"
FOREIGN = "out: not a dataset of ibdata, left as it is; move it away, or choose another --out"
DAMAGED = "out: not a dataset of ibdata, left as it is ("
NOTE = "out/notes.txt: found a file that is not the dataset's; move it away"
LOST = "out/meta/experiment.yaml: missing or not whole, but the dataset is finished; ibdata repair makes"
HALF = "out/data/part-00001-"
STATES = {  # how each is made, and the outcome without options, with --resume, with --overwrite
    "nothing": (lambda: None, "made", "made", "made"),
    "an empty folder": (lambda: Path("out").mkdir(), "made", "made", "made"),
    "a file": (lambda: Path("out").write_text("mine"), FILE, FILE, FILE),
    "a folder": (foreign, FOREIGN, FOREIGN, FOREIGN),
    "the dataset": (dataset, "there", "there", "replaced"),
    "a link to it": (linked, "there", "there", "replaced"),
    "with a report": (with_report, "there", "there", "replaced"),
    "with a note": (with_file("notes.txt"), "there", "there", NOTE),
    "with another manifest": (with_file(manifest.PATH), DAMAGED, DAMAGED, DAMAGED),
    "without a manifest": (without(manifest.PATH), FOREIGN, FOREIGN, FOREIGN),
    "without its experiment": (without(manifest.EXPERIMENT), LOST, LOST, "replaced"),
    "without a shard": (without("data/part-00001-*"), HALF, HALF, "replaced"),
    "another dataset": (lambda: dataset(OTHER), REPLACE, REPLACE, "replaced"),
    "begun": (begun, BEGUN, "goes on", "goes on"),
    "begun in vain": (without_a_shard, "made", "made", "made"),
    "another begun": (lambda: begun(OTHER), ANOTHER, ANOTHER, "discards"),
    "replacing another": (replacing, REPLACE, REPLACE, "goes on"),
}
OPTIONS = {"plain": {}, "resume": {"resume": True}, "overwrite": {"overwrite": True}}
SHARDS = {"made": 4, "replaced": 4, "discards": 4, "goes on": 3, "there": 0}
PREVIEWS = {
    "made": Action.BEGIN,
    "replaced": Action.BEGIN,
    "there": Action.OPEN,
    "goes on": Action.GO_ON,
    "discards": Action.DISCARD,
}
SAID = {
    "there": "ibdata: out: already there; nothing was written\n",
    "discards": "ibdata: out: the unfinished run of another experiment that was begun here is discarded\n",
}
CASES = [
    pytest.param(state, options, outcome, id=f"{state}-{name}")
    for state, (_, *outcomes) in STATES.items()
    for (name, options), outcome in zip(OPTIONS.items(), outcomes, strict=True)
]


@pytest.fixture(scope="module")
def states(tmp_path_factory):
    """A folder for each state."""
    home = tmp_path_factory.mktemp("states")
    with pytest.MonkeyPatch.context() as patch:
        for name, (prepare, *_) in STATES.items():
            (home / name).mkdir()
            patch.chdir(home / name)
            prepare()
    return home


@pytest.fixture(scope="module")
def plain(states):
    return ibdata.open(states / "the dataset/out")


@pytest.fixture
def go_to(states):
    """A function that puts a state into the current folder."""
    return lambda state: shutil.copytree(states / state, ".", symlinks=True, dirs_exist_ok=True)


@pytest.fixture
def made(monkeypatch):
    """The numbers of the shards that are made."""
    numbers, real = [], workers.make_shard

    def noted(spec, shard, *rest):
        numbers.append(shard.number)
        real(spec, shard, *rest)

    monkeypatch.setattr("ibdata.generation.workers.make_shard", noted)
    return numbers


def preview(**options):
    """What a preview says that `generate` would do."""
    try:
        return estimate(TINY, "out", workers=1, **options)["action"]
    except IbdataError as error:
        return str(error)


@pytest.mark.parametrize(("state", "options", "outcome"), CASES)
def test_each_state_has_one_outcome(go_to, plain, made, files, capsys, state, options, outcome):
    """A run makes, replaces, resumes or refuses, as the table and a preview say, and leaves nothing else."""
    go_to(state)
    before = contents()
    said = preview(**options)
    assert contents() == before
    if outcome not in SHARDS:
        with pytest.raises(IbdataError) as error:
            ibdata.generate(TINY, "out", workers=1, **options)
        assert outcome in str(error.value)
        assert outcome in said
        assert error.value.exit_code == (3 if outcome in (LOST, HALF) else 2)
        assert (made, contents()) == ([], before)
        return
    assert said == PREVIEWS[outcome].value
    ibdata.generate(TINY, "out", workers=1, **options)
    assert len(made) == SHARDS[outcome]
    assert outcome == "there" or is_right("out", plain.path, files)
    assert capsys.readouterr().err == SAID.get(outcome, "")
    assert (contents() == before) == (outcome == "there")


TAKEN, FIRM, BROKEN = (TakenError, "taken"), (UsageError, "firm"), (DatasetError, "broken")
UNFINISHED = (TakenError, "x: holds an unfinished run; --resume to go on with it")
ANOTHERS = (TakenError, "x: holds an unfinished run of another kind; --overwrite to start again, or choose ")
CHANGED = (
    TakenError,
    "x: holds the dataset of this experiment with other code, in mine.py; --overwrite to ma",
)
OPEN, BEGIN, GO_ON, DISCARD = Action
DECISIONS = {  # what is at the target, what was begun; without options, with --resume, with --overwrite
    (At.FREE, Begun.NOTHING): (BEGIN, BEGIN, BEGIN),
    (At.FREE, Begun.SAME): (UNFINISHED, GO_ON, GO_ON),
    (At.FREE, Begun.OTHER): (ANOTHERS, ANOTHERS, DISCARD),
    (At.SAME, Begun.NOTHING): (OPEN, OPEN, BEGIN),
    (At.SAME, Begun.SAME): (OPEN, OPEN, GO_ON),
    (At.SAME, Begun.OTHER): (OPEN, OPEN, DISCARD),
    (At.OTHER, Begun.NOTHING): (TAKEN, TAKEN, BEGIN),
    (At.OTHER, Begun.SAME): (TAKEN, TAKEN, GO_ON),
    (At.OTHER, Begun.OTHER): (TAKEN, TAKEN, DISCARD),
    (At.FOREIGN, Begun.NOTHING): (FIRM, FIRM, FIRM),
    (At.FOREIGN, Begun.SAME): (FIRM, FIRM, FIRM),
    (At.FOREIGN, Begun.OTHER): (FIRM, FIRM, FIRM),
}
REASONS = {  # of the dataset at the target, and what they change
    (At.SAME, "damage"): (BROKEN, BROKEN, BEGIN),
    (At.SAME, "other_code"): (CHANGED, OPEN, BEGIN),
    (At.SAME, "in_the_way"): (OPEN, OPEN, FIRM),
    (At.OTHER, "in_the_way"): (TAKEN, TAKEN, FIRM),
}
TEXTS = {"damage": "broken", "other_code": "mine.py", "in_the_way": "firm"}
ROWS = [
    *(
        (Found("x", at, begun, why="taken" if at is At.OTHER else "firm", run="of another kind"), answers)
        for (at, begun), answers in DECISIONS.items()
    ),
    *((Found("x", at, why="taken", **{key: TEXTS[key]}), answers) for (at, key), answers in REASONS.items()),
]


@pytest.mark.parametrize(("found", "answers"), ROWS)
def test_what_each_mode_does_in_each_state(found, answers):
    assert set(DECISIONS) == {(at, begun) for at in At for begun in Begun}
    for mode, answer in zip(Mode, answers, strict=True):
        if isinstance(answer, Action):
            assert decide(found, mode) is answer
            continue
        with pytest.raises(IbdataError) as error:
            decide(found, mode)
        assert (type(error.value), answer[1] in str(error.value)) == (answer[0], True)


@pytest.mark.parametrize("path", ["dataset/data/*", "receipts/*"])
def test_a_damaged_shard_of_a_part_is_made_again(go_to, plain, made, files, path):
    go_to("begun")
    (found,) = part_of("out").glob(path)
    found.write_bytes(found.read_bytes()[:-9])
    ibdata.generate(TINY, "out", workers=1, resume=True)
    assert sorted(made) == [0, 1, 2, 3]
    assert is_right("out", plain.path, files)
