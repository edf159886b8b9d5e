"""Commands print no control characters of datasets, experiments and URLs, and no credentials."""

import json
import re
from itertools import product
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.datasets import PLAIN
from helpers.folders import seal

from ibdata.generation.metadata import as_json

EVIL = "\x1b]0;x\x07\x1b[2Jvalid\r\x9b31m\u202edilav\u2066\x7f\nforged: line"
RAW = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u200b-\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def relabelled(path):
    """Put the text in the place of every policy's label."""
    table = pq.read_table(path)
    texts = pa.array([EVIL] * len(table)).dictionary_encode()
    place = table.column_names.index("policy")
    pq.write_table(table.set_column(place, table.schema.field(place), texts), path)


@pytest.fixture
def crafted(run, made_at):
    """A dataset with texts for the terminal wherever it holds any, and every hash right."""
    made_at(PLAIN, "d")
    made_at(PLAIN, "whole")
    info = json.loads(Path("d/meta/dataset.json").read_bytes())
    info |= {"dynamics": {"base": EVIL, EVIL: 1}, "start": EVIL}
    Path("d/meta/dataset.json").write_bytes(as_json(info))
    relabelled("d/meta/episodes.table")
    for path in Path("d/data").iterdir():
        relabelled(path)
    code = [{"target": EVIL, "version": EVIL, "sha256": None}]
    experiments = [{**PLAIN, "name": EVIL, "extra": {EVIL: EVIL}, "steps": EVIL}]
    changes = {"versions": {EVIL: EVIL}, "code": code, "experiments": experiments, "content_root": "0" * 64}
    seal(Path("d"), lambda listed: listed.update(changes))


READING = ["info d", "head d", "stats d", "validate d", "ls", "split d --list", "reproduce d"]
READING += ["repair d", "split d --by policy", "merge d whole --out m", "card d"]


def test_no_text_of_a_dataset_reaches_the_terminal_as_it_is(crafted, run):
    for line, more in product(READING, ([], ["--json"])):
        code, out, err = run(*line.split(), *more)
        assert code in (0, 2, 3), err
        assert "a bug of ibdata" not in err
        assert not RAW.search(out + err)
        assert "\nforged" not in out + err
        if more and out:
            json.loads(out)
    assert r"\u202edilav" in run("info", "d")[1]
    assert json.loads(run("info", "d", "--json")[1])["info"]["start"] == EVIL
