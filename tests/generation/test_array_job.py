"""Array jobs: several hosts make one dataset in one folder, and one finishes it."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
from helpers.tiny import TEN_SHARDS

import ibdata
from ibdata import IbdataError
from ibdata.errors import BusyError, UsageError
from ibdata.experiment.plan import plan
from ibdata.generation import origin, receipt
from ibdata.generation.ranges import Range
from ibdata.simulation import self_check
from ibdata.system import lock

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def tiny():
    return TEN_SHARDS


def make(tiny, *ranges, out="out"):
    return [ibdata.generate_shards(tiny, text, out, workers=1) for text in ranges]


# --- ranges


@pytest.mark.parametrize("parts", [1, 2, 3, 7, 10, 13])
def test_the_parts_are_all_shards_once_in_order_and_of_nearly_equal_size(tiny, parts):
    shards = plan(tiny)
    own = [Range(i + 1, parts).of(shards) for i in range(parts)]
    assert [shard for part in own for shard in part] == shards
    assert {len(part) for part in own} <= {10 // parts, -(-10 // parts)}


@pytest.mark.parametrize(
    "text", ["", "1", "0/3", "4/3", "1/0", "-1/3", "1/3/3", "a/3", "1/ 3", "²/3", "1/999999"]
)
def test_what_is_no_range_is_refused_before_anything_is_made(tiny, text):
    with pytest.raises(UsageError, match=r"^shards: found .*, expected i/n with i from 1 to n, such as 1/3"):
        make(tiny, text)
    assert list(Path().iterdir()) == []


@pytest.mark.parametrize("order", [("1/3", "2/3", "3/3"), ("3/3", "1/2", "1/3", "2/3"), ("1/1",)])
def test_ranges_in_any_order_make_the_files_of_a_plain_run(tiny, order, files):
    made = make(tiny, *order)
    assert (made[-1].missing, made[0].folder) == (0, Path("out"))
    dataset = ibdata.finalize("out")
    assert dataset.content_root == ibdata.generate(tiny, "plain", workers=1).content_root
    assert files("out") == files("plain")
    assert ibdata.validate("out") == []


def test_more_parts_than_shards_leave_some_with_nothing_to_make(tiny):
    made = make(tiny, *(f"{i}/12" for i in range(1, 13)))
    assert sorted(m.shards for m in made) == [0, 0] + [1] * 10
    assert len(ibdata.finalize("out")) == 50


def test_nothing_is_finished_before_it_is_finalized_and_nothing_is_made_twice(tiny, monkeypatch, files):
    make(tiny, "1/2", "2/2")
    with pytest.raises(IbdataError, match="no finished dataset here"):
        ibdata.open("out")
    monkeypatch.setattr("ibdata.generation.make_shard.shard_writer", None)
    assert make(tiny, "1/2") == make(tiny, "2/2")
    first = ibdata.finalize("out").manifest
    assert ibdata.finalize("out").manifest == first
    assert make(tiny, "1/2")[0].missing == 0
    assert not [path for path in files("out") if ".run" in path or ".lock" in path]


def test_a_plain_run_resumes_what_ranges_have_begun(tiny, files):
    make(tiny, "2/3")
    with pytest.raises(UsageError, match="holds an unfinished run; resume=True to go on with it"):
        ibdata.generate(tiny, "out", workers=1)
    resumed = ibdata.generate(tiny, "out", workers=1, resume=True)
    assert resumed.content_root == ibdata.generate(tiny, "plain", workers=1).content_root
    assert files("out") == files("plain")


# --- what finalizing refuses


def test_missing_and_damaged_shards_are_named_with_the_command_that_makes_them(
    tiny, ibdata_command, shard_file
):
    make(tiny, "1/3")
    Path("out", shard_file("out", 1)).write_bytes(b"damaged")
    with pytest.raises(IbdataError, match=r"^out: 8 of 10 shards are missing: 1, 3, 4, ") as error:
        ibdata.finalize("out")
    assert error.value.exit_code == 1
    assert not Path("out/meta").exists()
    commands = 0
    while not Path("out/meta").exists():
        try:
            ibdata.finalize("out")
        except IbdataError as failed:
            line = re.search(r"ibdata (generate --config .* --shards ./3)", str(failed))[1]
            ibdata_command(*shlex.split(line), "--workers", "1")
            commands += 1
    assert commands == 3
    assert ibdata.validate("out") == []


def test_of_a_plain_run_that_was_stopped_the_command_is_resume(tiny):
    make(tiny, "1/2")
    Path("out/.run/range-1-2.json").unlink()
    with pytest.raises(IbdataError, match=r"missing: 5, 6, 7, 8, 9; make them .* --resume$"):
        ibdata.finalize("out")


@pytest.mark.parametrize("found", ["nothing", "file", "foreign"])
def test_where_no_run_was_begun_there_is_nothing_to_finish(found):
    if found == "file":
        Path("out").write_text("mine")
    if found == "foreign":
        Path("out").mkdir()
        Path("out/notes.txt").write_text("mine")
    with pytest.raises(UsageError, match=r"^out: holds no run to finish; begin one with ibdata generate"):
        ibdata.finalize("out")


OTHER_BITS = {
    "of the known run": ("digest", lambda run=self_check.EXPERIMENT: "0" * 64),
    "of the other known run": (
        "digest",
        lambda run=self_check.EXPERIMENT: self_check.SHA256 if run is self_check.EXPERIMENT else "0" * 64,
    ),
    "denormals": ("keeps_denormals", lambda: False),
}


@pytest.mark.parametrize("change", OTHER_BITS.values(), ids=OTHER_BITS)
def test_a_machine_with_other_bits_than_the_first_is_refused_and_those_of_the_first_are_said(
    tiny, monkeypatch, capsys, change
):
    with monkeypatch.context() as other:
        other.setattr(self_check, *change)
        make(tiny, "1/2")
    assert capsys.readouterr().err.count("the manifest says reproducible: false") == 1
    with pytest.raises(UsageError, match=r"^out: this machine computes other bits than the one on"):
        make(tiny, "2/2")
    monkeypatch.setattr(self_check, *change)
    make(tiny, "2/2")
    assert ibdata.finalize("out").manifest["reproducible"] is False


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[]", b'{"code": []}', b'{"known_answer": "1a2b3c", "code": []}', None],
)
def test_a_note_that_is_none_is_named_with_the_way_out(tiny, content, files):
    make(tiny, "1/2")
    note = Path("out", origin.PATH)
    note.unlink()
    note.write_bytes(content) if content is not None else os.mkfifo(note)
    whole = files("out")
    for run in (
        lambda: make(tiny, "2/2"),
        lambda: ibdata.finalize("out"),
        lambda: ibdata.generate(tiny, "out", workers=1, resume=True),
    ):
        with pytest.raises(IbdataError, match=rf"^{note}: missing or damaged, so the code that made"):
            run()
    assert {path: data for path, data in files("out").items() if path in whole} == whole
    made = ibdata.generate(tiny, "out", workers=1, overwrite=True)
    assert made.content_root == ibdata.generate(tiny, "plain", workers=1).content_root
    assert files("out") == files("plain")


def forged(header, shard):
    """A receipt of other content whose own hash is right."""
    body = json.dumps(header).encode()
    Path("out", receipt.path_of(shard)).write_bytes(hashlib.sha256(body).digest() + body)


@pytest.mark.parametrize(
    "damage", ["pipe", "empty", "a list", "no header", "no entry", "other content", "other path"]
)
def test_a_shard_whose_receipt_is_none_is_made_again(tiny, shard_file, damage, files):
    make(tiny, "1/1")
    shard = plan(tiny)[0]
    path = Path("out", receipt.path_of(shard))
    header = json.loads(path.read_bytes()[32:])
    path.unlink()
    if damage == "pipe":
        os.mkfifo(path)
    elif damage == "empty":
        path.write_bytes(hashlib.sha256(b"").digest())
    elif damage == "a list":
        forged([header], shard)
    elif damage == "no header":
        forged({}, shard)
    elif damage == "no entry":
        forged({**header, "entry": None}, shard)
    elif damage == "other content":
        forged({**header, "content": header["identity"]}, shard)
    else:
        shutil.copy(Path("out", shard_file("out", 0)), "elsewhere")
        header["entry"][0] = "../elsewhere"
        forged(header, shard)
    with pytest.raises(IbdataError, match="1 of 10 shards are missing: 0; make them"):
        ibdata.finalize("out")
    made = ibdata.generate(tiny, "out", workers=1, resume=True)
    assert made.content_root == ibdata.generate(tiny, "plain", workers=1).content_root
    assert files("out") == files("plain")


# --- custom policies and what cannot be


POLICY = "class Still:\n    def predict(self, observations):\n        return observations[:, :3] * {}\n"


def test_custom_policies_need_leave_and_the_same_code_everywhere(tmp_path):
    Path("still.py").write_text(POLICY.format("0"))
    custom = {**TEN_SHARDS.plain(), "policies": [{"kind": "custom", "target": "still:Still"}]}
    Path("mine.yaml").write_text(json.dumps(custom))
    with pytest.raises(UsageError, match="allow_code=True"):
        ibdata.generate_shards("mine.yaml", "1/2", "out", workers=1)
    for text in ("1/2", "2/2"):
        ibdata.generate_shards("mine.yaml", text, "out", workers=1, allow_code=True)
    Path("still.py").write_text(POLICY.format("0.0"))
    with pytest.raises(UsageError, match=r"^out: found other code than the run began with, in still:Still; "):
        ibdata.generate_shards("mine.yaml", "2/2", "out", workers=1, allow_code=True)
    made = ibdata.finalize("out").manifest
    assert made["reproducible"] == "same-environment"
    assert [code["target"] for code in made["code"]] == ["still:Still"]


@pytest.mark.parametrize("more", [["--overwrite"], ["--dry-run"]])
def test_options_for_the_whole_are_refused_in_one_line(ibdata_command, more):
    done = ibdata_command("generate", "--config", "random", "--shards", "1/2", *more, code=2)
    assert done.stderr == f"--shards: found {more[0]} too, but these cannot be combined\n"
    assert list(Path().iterdir()) == []


def test_a_folder_of_experiments_is_refused_in_one_line(ibdata_command):
    done = ibdata_command("generate", "--config", "siemens-offline", "--shards", "1/2", code=2)
    assert done.stderr.count("\n") == 1
    assert "found a folder of experiments too, but these cannot" in done.stderr


# --- at the same time


def test_a_range_is_refused_where_it_or_the_whole_is_being_made(tiny):
    Path("out").mkdir()
    with lock.shared(Path("out")), lock.locked(Path("out"), ".lock-2-3"):
        with pytest.raises(BusyError):
            make(tiny, "2/3")
        make(tiny, "1/3", "3/3")
        for whole in (lambda: ibdata.generate(tiny, "out", workers=1), lambda: ibdata.finalize("out")):
            with pytest.raises(BusyError):
                whole()
    with lock.locked(Path("out")), pytest.raises(BusyError):
        make(tiny, "2/3")
    make(tiny, "2/3")
    assert len(ibdata.finalize("out")) == 50


def test_another_experiment_is_refused_and_the_first_stays(tiny, files):
    make(tiny, "1/2")
    before = files("out")
    with pytest.raises(UsageError, match="holds an unfinished run of another experiment"):
        ibdata.generate_shards(tiny, "2/2", "out", seed=1, workers=1)
    assert files("out") == before


def test_a_range_that_fails_leaves_the_files_of_others(tiny, monkeypatch, files):
    def fail(*args):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as failing:
        failing.setattr("ibdata.generation.make_shard.shard_writer", fail)
        with pytest.raises(IbdataError, match=r"^out: cannot be written: No space left on device$"):
            make(tiny, "2/2")
        assert not Path("out").exists()
    make(tiny, "1/2")
    under_way = Path("out/.tmp-123456789abc-part-00000.part")  # a host with 1/2 writes it
    under_way.write_bytes(b"part")
    before = files("out")
    with monkeypatch.context() as failing:
        failing.setattr("ibdata.generation.make_shard.shard_writer", fail)
        Path("out").joinpath(".lock").touch()
        with lock.shared(Path("out")), pytest.raises(IbdataError, match="No space left"):
            make(tiny, "2/2")
    after = files("out")
    assert set(after) - set(before) == {".run/range-2-2.json"}
    assert after[under_way.name] == b"part"
    make(tiny, "2/2")
    assert len(ibdata.finalize("out")) == 50
    assert not under_way.exists()


MANY = {**TEN_SHARDS.plain(), "name": "many", "setpoints": [20, 50, 70], "episodes": 40, "steps": 1000}


def test_of_three_processes_at_once_one_is_killed_and_run_again(start, ibdata_command, files):
    Path("many.yaml").write_text(json.dumps({**MANY, "output": {"shard_rows": 1000}}))
    experiment = ibdata.load("many.yaml")
    runs = [start(f"{i}/3") for i in (1, 2, 3)]
    second = Range(2, 3).of(plan(experiment))
    deadline = time.monotonic() + 120
    while not (Path("out") / receipt.path_of(second[1])).exists() and time.monotonic() < deadline:
        time.sleep(0.005)
    runs[1].send_signal(signal.SIGKILL)
    assert runs[1].wait() == -signal.SIGKILL
    again = start("2/3")
    said = [run.communicate(timeout=200) for run in (runs[0], again, runs[2])]
    assert [run.returncode for run in (runs[0], again, runs[2])] == [0, 0, 0], said
    assert all(re.match(r"out: part ./3 is complete: 40 shards with 40,000 rows\n", out) for out, _ in said)
    done = ibdata_command("finalize", "out", "--json")
    plain = ibdata.generate(experiment, "plain", workers=1)
    assert json.loads(done.stdout)["content_root"] == plain.content_root
    assert files("out") == files("plain")


@pytest.fixture
def ibdata_command(command):
    """Run `ibdata …` to its end, which is to be that code."""

    def run(*args, code=0):
        done = subprocess.run([command, *args], capture_output=True, text=True, timeout=200)
        assert done.returncode == code, done.stderr
        return done

    return run
