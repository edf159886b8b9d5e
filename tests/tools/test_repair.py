"""Repairing changes the broken files only; reproducing makes episodes again; differences are named."""

import json
import shutil
import stat
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from helpers.datasets import PLAIN
from helpers.folders import contents, seal
from helpers.refusals import refused
from helpers.splits import BY_POLICY

import ibdata
from ibdata.dataset import manifest
from ibdata.errors import DatasetError
from ibdata.tools.repair import repair
from ibdata.tools.validate import validate


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return ibdata.generate(PLAIN, tmp_path_factory.mktemp("made") / "tiny", workers=1)


@pytest.fixture
def copied(made, tmp_path):
    return Path(shutil.copytree(made.path, tmp_path / "copied"))


@pytest.fixture
def file(copied, shard_file):
    """A function for the path of a shard in the copy."""
    return lambda number: shard_file(copied, number)


def cut(path):
    path.write_bytes(path.read_bytes()[:99])


def rewritten(path, change=lambda table: table):
    """Write a shard anew, with other bytes than ibdata's even where the rows are the same."""
    pq.write_table(change(pq.read_table(path)), path, compression="none", use_dictionary=["policy"])


def test_files_are_made_again_as_they_were(copied, file):
    before, lost = contents(copied), [file(0), "meta/episodes.table"]
    damaged = [file(3), "meta/dataset.json", "meta/statistics.json", manifest.EXPERIMENT, manifest.CROISSANT]
    for path in lost:
        (copied / path).unlink()
    for path in damaged:
        (copied / path).chmod(0o640)
        cut(copied / path)
    assert sorted(repair(copied, workers=1)) == sorted([*lost, *damaged])
    assert contents(copied) == before
    assert {stat.S_IMODE((copied / path).stat().st_mode) for path in damaged} == {0o640}


def test_other_bytes_with_the_same_content_only_change_hashes(copied, file, monkeypatch):
    """As after a repair that was killed before it wrote the manifest."""
    monkeypatch.setattr("ibdata.tools.repair.make_shards", None)  # nothing is simulated
    path = file(1)
    rewritten(copied / path)
    before, root = contents(copied), ibdata.open(copied).content_root
    assert [problem.rule for problem in validate(copied)] == ["hash"]
    assert repair(copied, workers=1) == [path, manifest.CROISSANT]
    after = contents(copied)
    changed = {str(copied / name) for name in (manifest.PATH, manifest.CROISSANT)}
    assert {name for name in after if after[name] != before[name]} == changed
    assert ibdata.open(copied).content_root == root
    assert validate(copied) == []


def test_what_validate_refuses_is_not_repaired(copied, file):
    """Here a row that breaks a rule, under the right hashes, beside a file that can be made again."""
    rewritten(copied / file(1), lambda table: table.set_column(0, "episode", table["step"].cast("int64")))
    seal(copied)
    cut(copied / "meta/dataset.json")
    with pytest.raises(DatasetError, match=r"part-00001-.*: found after all was made again: .*; make the"):
        repair(copied, workers=1)


def test_a_wrong_value_in_any_column_makes_the_shard_again(copied, file):
    """The content digest does not cover the number of an episode, but the rules of rows do."""
    before, path = contents(copied), file(1)
    for column in ("episode", "latent_mu_v"):
        table = pq.read_table(copied / path)
        i, field = table.column_names.index(column), table.schema.field(column)
        other = pa.array(np.roll(table[column].to_numpy(), 1) + 1, field.type)
        rewritten(copied / path, lambda table: table.set_column(i, field, other))  # noqa: B023
        assert repair(copied, workers=1) == [path]
        assert contents(copied) == before


def test_lost_splits_are_those_declared_and_a_line_says_so(copied, capsys):
    path = copied / manifest.SPLITS
    before = path.read_bytes()
    ibdata.split(copied, BY_POLICY)
    listed = json.loads(path.read_bytes())
    listed["safe"].update(runs=[[0, 6]])
    for damage in (path.unlink, lambda: path.write_text(json.dumps(listed))):
        damage()
        assert repair(copied, workers=1) == [manifest.SPLITS]
        line = (
            f"ibdata: {copied}: splits that were made later, if there were any, are lost; make them again\n"
        )
        assert capsys.readouterr().err == line
        assert path.read_bytes() == before


def test_a_dataset_is_reproduced_whole_or_in_part(made):
    for episodes, count in ((None, 12), (5, 5), (100, 12)):
        assert ibdata.reproduce(made.path, episodes) == (count, [])
    refused(r"^episodes: found -3, expected a whole number of at least 1", ibdata.reproduce, made.path, -3)


def test_an_episode_that_is_not_reproduced_is_named(copied, file):
    seal(copied, lambda listed: listed["experiments"][0].update(seed=1))
    count, problems = ibdata.reproduce(copied, 3)
    assert count == 3
    assert [(p.path, p.row, p.message) for p in problems] == [
        (file(0), 0, "episode 0: found other content when made again"),
        (file(2), 20, "episode 4: found other content when made again"),
        (file(5), 0, "episode 8: found other content when made again"),
    ]
