"""The files that a custom policy declares: where they are looked for, and what depends on them."""

import pytest
from helpers.own_code import PLAIN, sha256

import ibdata
from ibdata import Experiment
from ibdata.errors import UsageError


@pytest.fixture
def make(here):
    """A function that makes the dataset of beside/own.yaml."""
    (here / "at-70-stop.py").unlink()
    (here / "beside").mkdir()
    (here / "own.yaml").rename("beside/own.yaml")

    def run(out, workers=1):
        return ibdata.generate("beside/own.yaml", out, allow_code=True, workers=workers)

    return run


@pytest.mark.slow
def test_declared_files_lie_beside_the_yaml_or_here(here, make):
    (here / "weights.txt").rename("mine.txt")
    (here / "mine.py").write_text((here / "mine.py").read_text().replace("weights.txt", "mine.txt"))
    (here / "beside/weights.txt").write_text("0.75")
    for out, path, workers in (("out", "beside/weights.txt", 2), ("other", "weights.txt", 1)):
        (made,) = make(out, workers).manifest["code"]
        assert made["files"]["weights.txt"] == sha256(path)
        (here / path).rename("weights.txt" if out == "out" else "gone.txt")
    with pytest.raises(UsageError, match=r"^mine:Own: files: found no file 'weights.txt', expected it besi"):
        make("third")
    assert not (here / "third").exists()


def test_declared_files_do_not_change_the_cells():
    own = PLAIN["policies"][0]
    bare = {key: value for key, value in own.items() if key != "files"}
    digests = [
        Experiment.model_validate({**PLAIN, "policies": [policy]}).cells[0].digest for policy in (own, bare)
    ]
    assert digests[0] == digests[1]
