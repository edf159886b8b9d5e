"""The files that a custom policy declares: where they are looked for, and what depends on them."""

from __future__ import annotations

import pytest
from helpers.own_code import PLAIN, sha256

import ibdata
from ibdata import Experiment
from ibdata.errors import IbdataError, UsageError

pytestmark = pytest.mark.slow


def test_declared_files_lie_beside_the_yaml_or_in_the_current_folder(here):
    (here / "at-70-stop.py").unlink()
    (here / "beside").mkdir()
    (here / "own.yaml").rename("beside/own.yaml")
    (here / "weights.txt").rename("mine.txt")
    (here / "beside/weights.txt").write_text("0.75")
    (here / "mine.py").write_text((here / "mine.py").read_text().replace("weights.txt", "mine.txt"))
    made = ibdata.generate("beside/own.yaml", "out", workers=2, allow_code=True)
    assert made.manifest["code"][0]["files"]["weights.txt"] == sha256("beside/weights.txt")
    (here / "beside/weights.txt").rename("weights.txt")
    made = ibdata.generate("beside/own.yaml", "other", workers=1, allow_code=True)
    assert made.manifest["code"][0]["files"]["weights.txt"] == sha256("weights.txt")
    (here / "weights.txt").unlink()
    with pytest.raises(
        UsageError, match=r"^mine:Own: files: found no file 'weights.txt', expected it beside"
    ):
        ibdata.generate("beside/own.yaml", "third", workers=1, allow_code=True)
    assert not (here / "third").exists()


def test_a_declared_file_of_which_there_are_two_that_differ_is_refused(here):
    (here / "beside").mkdir()
    (here / "own.yaml").rename("beside/own.yaml")
    (here / "beside/weights.txt").write_text("0.5")
    with pytest.raises(IbdataError, match="RuntimeError: stopped"):
        ibdata.generate("beside/own.yaml", "out", workers=1, allow_code=True)
    (here / "at-70-stop.py").unlink()
    (here / "weights.txt").write_text("0.75")
    line = f"mine:Own: files: found {here}/beside/weights.txt and {here}/weights.txt, which differ, "
    with pytest.raises(UsageError, match=f"^{line}so nobody knows which of the two is read; remove one$"):
        ibdata.generate("beside/own.yaml", "out", workers=1, resume=True, allow_code=True)
    (here / "weights.txt").write_text("0.5")
    ibdata.generate("beside/own.yaml", "out", workers=1, resume=True, allow_code=True)
    assert ibdata.reproduce("out", allow_code=True) == (4, [])


def test_declared_files_are_no_part_of_what_the_data_hang_on():
    block = PLAIN["policies"][0]
    bare = {key: value for key, value in block.items() if key != "files"}
    for wrap in (dict, lambda own: {"kind": "epsilon_greedy", "base": own, "epsilon": 0.5}):
        declared, plain = (
            Experiment.model_validate({**PLAIN, "policies": [wrap(own)]}) for own in (block, bare)
        )
        assert [cell.digest for cell in declared.cells] == [cell.digest for cell in plain.cells]
        assert "files" in str(declared.plain())
        assert "files" not in str(plain.plain())


def test_where_an_experiment_was_loaded_from_is_no_part_of_it(here):
    loaded = ibdata.load("own.yaml")
    assert loaded.folder == here
    assert loaded.model_copy(update={"seed": 1}).folder == here
    assert loaded == Experiment.model_validate(PLAIN)
