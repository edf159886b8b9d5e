"""Commands print no control characters of datasets, experiments and URLs, and no credentials."""

from __future__ import annotations

import io
import json
import re
import shutil
import signal
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.forging import seal

import ibdata
from ibdata import Experiment
from ibdata.cli import main
from ibdata.system.signals import STOPPING
from ibdata.writing.metadata import as_json

EVIL = "\x1b]0;x\x07\x1b[2Jvalid\r\x9b31m\u202edilav\u2066\x7f\nforged: line"
RAW = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
PLAIN = {
    "name": "tiny",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "random"}, {"kind": "safe"}],
    "episodes": 2,
    "steps": 3,
    "output": {"shard_rows": 6},
    "splits": {"low": {"setpoint": 20}},
}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("printing") / "whole"
    ibdata.generate(Experiment.model_validate(PLAIN), folder, workers=1)
    return folder


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def run(monkeypatch):
    """What `ibdata …` prints to streams of an encoding, and its exit code."""
    handlers = {number: signal.getsignal(number) for number in STOPPING}

    def call(*args, encoding="utf-8"):
        streams = [io.TextIOWrapper(io.BytesIO(), encoding=encoding) for _ in range(2)]
        with monkeypatch.context() as patch:
            patch.setattr(sys, "stdout", streams[0])
            patch.setattr(sys, "stderr", streams[1])
            with pytest.raises(SystemExit) as end:
                main(args)
        for stream in streams:
            stream.flush()
        out, err = (stream.buffer.getvalue().decode("utf-8") for stream in streams)
        return end.value.code or 0, out, err

    yield call
    for number, handler in handlers.items():
        signal.signal(number, handler)


def changed(path, **changes):
    data = json.loads(Path(path).read_bytes())
    Path(path).write_bytes(as_json({**data, **changes}))


def relabelled(path):
    """Put the text in the place of every policy's label."""
    table = pq.read_table(path)
    texts = pa.array([EVIL] * len(table)).dictionary_encode()
    place = table.column_names.index("policy")
    pq.write_table(table.set_column(place, table.schema.field(place), texts), path)


@pytest.fixture
def crafted(made):
    """A dataset with texts for the terminal wherever it holds any, and every hash right."""
    shutil.copytree(made, "d")
    shutil.copytree(made, "whole")
    changed("d/meta/dataset.json", dynamics={"base": EVIL, EVIL: 1}, start=EVIL)
    relabelled("d/meta/episodes.parquet")
    for path in Path("d/data").iterdir():
        relabelled(path)
    code = [{"target": EVIL, "version": EVIL, "sha256": None}]
    experiments = [{**PLAIN, "name": EVIL, "extra": {EVIL: EVIL}, "steps": EVIL}]
    changes = {"versions": {EVIL: EVIL}, "code": code, "experiments": experiments, "content_root": "0" * 64}
    seal(Path("d"), lambda listed: listed.update(changes))
    return "d"


READING = ["info d", "head d", "stats d", "validate d", "diff d whole", "ls", "split d --list", "reproduce d"]
READING += ["repair d", "split d --by policy", "merge d whole --out m", "card d"]


@pytest.mark.parametrize("line", READING)
def test_no_text_of_a_dataset_reaches_the_terminal_as_it_is(crafted, run, line):
    for more in ([], ["--json"]):
        code, out, err = run(*line.split(), *more)
        assert code in (0, 2, 3), err
        assert "a bug of ibdata" not in err
        assert not RAW.search(out + err)
        assert "\nforged" not in out + err
        if more and out:
            json.loads(out)


def test_what_is_escaped_is_shown(crafted, run):
    assert r"\u202edilav" in run("info", "d")[1]
    assert json.loads(run("info", "d", "--json")[1])["info"]["start"] == EVIL
