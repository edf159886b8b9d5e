"""What `generate` does with what is at its place and in its part, and what a preview says about it."""

import os
import shutil
from pathlib import Path

import pytest
from helpers.datasets import FOUR_SHARDS as TINY
from helpers.folders import contents, is_right, receipts, run_of

import ibdata
from ibdata.dataset import manifest
from ibdata.errors import IbdataError
from ibdata.generation import record

OTHER = TINY.model_copy(update={"seed": 1})


def begun(experiment=TINY):
    """An unfinished run with one finished shard of four."""
    ibdata.generate(experiment, "out", shards="1/4", workers=1)


def of_other_bits():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(record, "digest", lambda run: b"0" * 32)
        begun()


def dataset(experiment=TINY):
    ibdata.generate(experiment, "out", workers=1)


def with_file(path):
    """A dataset, in which a file has been replaced or added."""
    return lambda: (dataset(), Path("out", path).write_text("mine"))


def without(path):
    return lambda: (dataset(), *(file.unlink() for file in Path("out").glob(path)))


SEED = "another experiment (seed: found 1, expected 0)"
REPLACE = f"out: holds the dataset of {SEED}; overwrite=True to replace it, or choose another out"
BOTH = f"out: holds the dataset of {SEED}, and an unfinished run {{}} shards; overwrite=True to replace both"
FILE = "out: is a file, not a folder; choose another out"
FOREIGN = "out: not a dataset of ibdata, left as it is; move it away, or choose another out"
DAMAGED = "out: not a dataset that this ibdata reads, left as it is ("
NOTE = "out/notes.txt: found a file that is not the dataset's; move it away"
LOST = "out/meta/experiment.yaml: missing or not whole, but the dataset is finished; ibdata repair makes"
HALF = "out/data/part-00001-"
DROP = "remove .out.part/run to drop it, overwrite=True "
WORDS = {
    "of other bits": "of a machine that computes other bits, 1 of 4",
    "another's": f"of {SEED}, 1 of 4",
    "damaged": "whose note is damaged, or of another ibdata, 1 of ?",
}
BEGUN, NOTED = (
    f"out: holds an unfinished run {WORDS[who]} shards; {DROP}" for who in ("another's", "damaged")
)
LIKE = "a machine like the first goes on with it"
BITS = f"out: holds an unfinished run {WORDS['of other bits']} shards; {LIKE}, {DROP}"
PARTS = {  # how what is in the part is made
    "none": lambda: None,
    "mine": begun,
    "of other bits": of_other_bits,
    "another's": lambda: begun(OTHER),
    "damaged": lambda: (begun(), (run_of("out") / "run.json").write_bytes(b"")),
    "in vain": lambda: (begun(OTHER), shutil.rmtree(run_of("out") / "receipts")),
}
FREE = ("made", "goes on", BITS, BEGUN, NOTED, "made")
REPLACED = ("made", "goes on", "dropped", "dropped", "dropped", "made")
PLACES = {  # how what is at the place is made, and the outcomes with each part
    "nothing": (lambda: None, FREE),
    "an empty folder": (lambda: Path("out").mkdir(), FREE),
    "the dataset": (dataset, ("there",) * 6),
    "another dataset": (
        lambda: dataset(OTHER),
        (*(REPLACE,) * 3, BOTH.format(WORDS["another's"]), BOTH.format(WORDS["damaged"]), REPLACE),
    ),
    "without a shard": (without("data/part-00001-*"), (HALF,) * 2),
    "a file": (lambda: Path("out").write_text("mine"), (FILE,)),
    "a folder": (lambda: (Path("out").mkdir(), Path("out/notes.txt").touch()), (FOREIGN,)),
    "a link to it": (lambda: (dataset(), Path("out").rename("d"), Path("out").symlink_to("d")), ("there",)),
    "with a report": (with_file(manifest.REPORT), ("there",)),
    "with a note": (with_file("notes.txt"), ("there",)),
    "with another manifest": (with_file(manifest.PATH), (DAMAGED,)),
    "without a manifest": (without(manifest.PATH), (FOREIGN,)),
    "without its experiment": (without(manifest.EXPERIMENT), (LOST,)),
}
REFUSED = {"a file": FILE, "a folder": FOREIGN, "with a note": NOTE}  # also with --overwrite
REFUSED |= {"with another manifest": DAMAGED, "without a manifest": FOREIGN}
CASES = [
    *((place, part, {}, outcome) for place, (_, row) in PLACES.items() for part, outcome in zip(PARTS, row)),  # noqa: B905
    *((place, "none", {"overwrite": True}, REFUSED.get(place, "made")) for place in PLACES),
    *(
        (place, part, {"overwrite": True}, outcome)
        for place in ("nothing", "another dataset")
        for part, outcome in zip(PARTS, REPLACED, strict=True)
    ),
    *(("nothing", part, {"shards": "1/4"}, outcome) for part, outcome in zip(PARTS, FREE, strict=True)),
    ("the dataset", "mine", {"shards": "1/4"}, "there"),
    ("another dataset", "mine", {"shards": "1/4"}, REPLACE.replace("to", "without shards to")),
]
PREVIEWS = {"made": "make it", "dropped": "make it"}
PREVIEWS |= {"goes on": "go on after 1 finished shard", "there": "open the finished dataset"}


@pytest.fixture(scope="module")
def states(tmp_path_factory):
    """A folder for each place and each part."""
    home = tmp_path_factory.mktemp("states")
    with pytest.MonkeyPatch.context() as patch:
        for name, prepare in [*PARTS.items(), *((name, prepare) for name, (prepare, _) in PLACES.items())]:
            (home / name).mkdir()
            patch.chdir(home / name)
            prepare()
    return home


@pytest.fixture(scope="module")
def plain(states):
    return ibdata.open(states / "the dataset/out")


def preview(**options):
    try:
        return ibdata.estimate(TINY, "out", **options)["action"]
    except IbdataError as error:
        return str(error)


@pytest.mark.parametrize(("place", "part", "options", "outcome"), CASES)
def test_each_state_has_one_outcome(states, plain, files, capsys, place, part, options, outcome):
    """A run makes, goes on, drops or refuses, as the table and a preview say, and leaves no more."""
    for name in (place, part):
        shutil.copytree(states / name, ".", symlinks=True, dirs_exist_ok=True)
    before, folder = contents(), os.stat("out").st_ino if os.path.exists("out") else None
    is_range = "shards" in options
    said = None if is_range or part == "of other bits" else preview(**options)
    assert contents() == before
    if outcome not in PREVIEWS:
        with pytest.raises(IbdataError) as error:
            ibdata.generate(TINY, "out", workers=1, **options)
        assert outcome in str(error.value)
        assert said is None or outcome in said
        assert error.value.exit_code == (3 if outcome in (LOST, HALF) else 2)
        assert contents() == before or part == "in vain"
        return
    assert said in (None, PREVIEWS[outcome])
    ibdata.generate(TINY, "out", workers=1, **options)
    notice = {"there": "" if is_range else "ibdata: out: already there; nothing was written\n"}
    if outcome == "dropped":
        notice[outcome] = f"ibdata: out: dropped an unfinished run {WORDS[part]} shards\n"
    assert capsys.readouterr().err == notice.get(outcome, "")
    if is_range:
        assert len(receipts("out")) == 1
        return
    known = {Path(path).name for path in before if "/data/part-" in path}
    assert outcome != "goes on" or len(known & {path.name for path in Path("out/data").iterdir()}) == 1
    assert outcome == "there" or is_right("out", plain.path, files)
    is_as_before = contents() == before and os.stat("out").st_ino == folder  # equal datasets have equal files
    assert is_as_before == (outcome == "there" and part != "in vain")
