"""Array jobs: several hosts make one dataset in one part, and one finishes it."""

import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import pytest
from helpers.datasets import TEN_SHARDS as TEN
from helpers.folders import contents, is_right, part_of, receipts, run_of
from helpers.refusals import refused

import ibdata
from ibdata import IbdataError
from ibdata._system import part as parts
from ibdata.cli import main
from ibdata.errors import BusyError
from ibdata.generation import folder, record, workers
from ibdata.generation.generate import PartMade, Range
from ibdata.plan.dataset_spec import DatasetSpec

SHARDS = DatasetSpec.of(TEN).shards
OTHER = TEN.model_copy(update={"seed": 1})


@pytest.fixture(autouse=True)
def _one_processor(monkeypatch):
    monkeypatch.setattr("ibdata.generation.workers.available_processors", lambda: 1)  # shards in order


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return ibdata.generate(TEN, tmp_path_factory.mktemp("plain") / "out", workers=1)


def make(*ranges):
    return [ibdata.generate(TEN, "out", shards=text, workers=1) for text in ranges]


@pytest.fixture
def interleaved(monkeypatch):
    """Let something happen when the first shard of a run is begun."""

    def arrange(action):
        real, waiting = workers.make_shard, [action]

        def making(*args):
            if waiting:
                waiting.pop()()
            real(*args)

        monkeypatch.setattr("ibdata.generation.workers.make_shard", making)

    return arrange


def test_what_is_no_range_is_refused():
    for text in ("1", "0/3", "4/3", "1/3/3", "1/ 3", "²/3", "1/999999"):
        refused(r"^shards: found .*, expected i/n with i from 1 to n, such as", make, text)
    assert contents() == {}


def test_options_for_the_whole_are_refused(capsys):
    for config, found in (
        ("random", "--overwrite"), ("random", "--dry-run"), ("siemens-offline", "a folder of experiments")
    ):  # fmt: skip
        with pytest.raises(SystemExit, match=r"^2$"):
            main(["generate", "--config", config, "--shards", "1/2", *[found][: found.startswith("-")]])
        assert capsys.readouterr().err == f"--shards: found {found} too, but these cannot be combined\n"
    assert contents() == {}


def test_ranges_divide_the_shards_evenly():
    for n in (1, 3, 7, 13):
        own = [Range(i + 1, n).of(SHARDS) for i in range(n)]
        assert [shard for each in own for shard in each] == SHARDS
        assert {len(each) for each in own} <= {10 // n, -(-10 // n)}


def test_ranges_in_any_order_make_one_dataset(plain, files, monkeypatch):
    """Also such that overlap or hold no shard; what is made once is not made again."""
    order = ("3/3", "11/12", "1/12", "1/2", "1/3", "2/3")
    made = make(*order)
    assert (made[-1].missing, made[0].folder) == (0, Path("out"))
    assert [each.shards for each in made] == [len(Range.parse(text).of(SHARDS)) for text in order]
    assert not Path("out").exists()
    monkeypatch.setattr("ibdata.generation.workers.make_shard", None)
    assert make(*order)[0].rows == made[0].rows
    assert ibdata.finalize("out").manifest == ibdata.finalize("out").manifest
    assert is_right("out", plain.path, files)
    assert make("1/2")[0].missing == 0


def test_ranges_that_meet_in_a_shard_both_succeed(plain, files, interleaved):
    others = []
    interleaved(lambda: others.extend(make("1/1")))
    assert [one.shards for one in (*make("1/2"), *others)] == [5, 10]
    ibdata.finalize("out")
    assert is_right("out", plain.path, files)


def test_a_shard_that_two_hosts_wrote_in_other_bytes_is_published_once(interleaved, small_blocks):
    """As with two versions of pyarrow: each host's file has a name of its own."""

    def on_another_host():
        small_blocks(row_group_rows=2)
        make("1/1")
        small_blocks(row_group_rows=1_000)

    interleaved(on_another_host)
    make("1/2")
    assert len(list((run_of("out") / "dataset/data").iterdir())) > 10
    made = ibdata.finalize("out")
    assert len(list((made.path / "data").iterdir())) == 10
    assert ibdata.validate(made.path) == []


def test_missing_and_damaged_shards_are_named(shard_file):
    make("1/3")
    folder = run_of("out") / "dataset"
    shard = folder / shard_file(folder, 1)
    shard.write_bytes(bytes(shard.stat().st_size))
    before = contents()
    with pytest.raises(
        IbdataError,
        match=r"^out: 8 of 10 shards are missing or damaged: data/part-00001, data/part-00003, .*; ibdata",
    ):
        ibdata.finalize("out")
    assert contents() == before
    make("1/3", "2/3", "3/3")
    assert ibdata.validate(ibdata.finalize("out").path) == []


@pytest.fixture
def together(monkeypatch):
    """A function that makes ranges in threads, which fill the folders of their runs at the same moment."""
    barrier, real = threading.Barrier(2), folder.rename

    def renaming(path, new):
        with suppress(threading.BrokenBarrierError):
            barrier.wait(5)
        real(path, new)

    monkeypatch.setattr(folder, "rename", renaming)

    def make_all(*experiments):
        with ThreadPoolExecutor(len(experiments)) as threads:
            calls = [
                threads.submit(ibdata.generate, experiment, "out", shards=f"{i}/2", workers=1)
                for i, experiment in enumerate(experiments, 1)
            ]
        return [call.exception() or call.result() for call in calls]

    return make_all


def test_hosts_that_begin_at_the_same_moment_make_one_run(plain, files, together):
    assert [made.shards for made in together(TEN, TEN)] == [5, 5]
    assert len(receipts("out")) == 10
    assert not list(part_of("out").glob("tmp-*"))
    ibdata.finalize("out")
    assert is_right("out", plain.path, files)


def test_of_hosts_with_other_experiments_that_begin_at_the_same_moment_one_is_refused(together):
    refused, made = sorted(together(TEN, OTHER), key=lambda answer: isinstance(answer, PartMade))
    assert str(refused).startswith("out: holds an unfinished run of another experiment (seed: found ")
    assert (made.shards, len(receipts("out"))) == (5, 5)
    assert not list(part_of("out").glob("tmp-*"))


def test_of_hosts_with_other_bits_that_begin_at_the_same_moment_one_is_refused(together, monkeypatch):
    answers = iter(["0" * 64, "1" * 64])
    monkeypatch.setattr(record, "known_answer", lambda: next(answers))
    refused, made = sorted(together(TEN, TEN), key=lambda answer: isinstance(answer, PartMade))
    assert str(refused).startswith("out: holds an unfinished run of a machine that computes other bits, ")
    assert (made.shards, len(receipts("out"))) == (5, 5)


def test_a_whole_run_and_ranges_exclude_each_other(interleaved, monkeypatch):
    monkeypatch.setattr(parts, "PATIENCE", 0.05)
    wholes = [lambda: ibdata.generate(TEN, "out", workers=1), lambda: ibdata.finalize("out")]

    def excluded(*calls):
        for call in calls:
            refused(r"^out: another process is writing here; wait for it", call, error=BusyError)

    interleaved(lambda: excluded(*wholes))
    make("1/2")
    interleaved(lambda: excluded(lambda: make("1/2"), *wholes))
    assert len(ibdata.generate(TEN, "out", workers=1)) == 50
