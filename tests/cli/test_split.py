"""`ibdata split` says what it makes, replaces and removes."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.experiment import as_yaml

PLAIN = {
    "name": "tiny",
    "setpoints": [20.0, 50.0, 70.0],
    "policies": [{"kind": "random"}, {"kind": "safe"}],
    "episodes": 2,
    "steps": 3,
    "splits": {"low": {"setpoint": 20}},
}


@pytest.fixture
def made(tmp_path):
    ibdata.generate(Experiment.model_validate(PLAIN), tmp_path / "d", workers=1)


def test_what_is_replaced_or_removed_is_said(made, run):
    assert run("split", "d", "--source", "50", "--target", "70", "--shots", "1", "--prefix", "few") == (
        0,
        "low              12 rows in 4 episodes (whole files)\n"
        "few-source       12 rows in 4 episodes (labels)\n"
        "few-target       6 rows in 2 episodes (labels)\n"
        "few-target-rest  6 rows in 2 episodes (labels)\n",
        "",
    )
    ibdata.split("d", by="policy", names={"safe": "careful"})
    code, out, _ = run(
        "split", "d", "--source", "20", "--target", "70", "--prefix", "few", "--remove", "random"
    )
    assert (code, out.splitlines()[:4]) == (
        0,
        [
            "removed the split few-target-rest",
            "removed the split random",
            "replaced the split few-source; --prefix or --name keeps both",
            "replaced the split few-target; --prefix or --name keeps both",
        ],
    )
    taken = json.loads(run("split", "d", "--remove", "careful", "--json")[1])["taken_away"]
    assert taken == {"removed": ["careful"]}


@pytest.mark.slow
def test_a_report_that_showed_the_old_splits_is_removed_and_named(made, run):
    pytest.importorskip("matplotlib")
    run("card", "d")
    out = run("split", "d", "--by", "policy", "--name", "safe=careful")[1]
    assert out.startswith("removed report.html, which showed the old splits; ibdata card d makes it again\n")
    for args in (("card", "d"), ("plot", "d"), ("stats", "d", "--split", "careful"), ("validate", "d")):
        assert run(*args)[0] == 0
    report = Path("d/report.html").read_text(encoding="utf-8")
    assert "careful" in report
    assert Path("figures/d/splits.png").is_file()


@pytest.mark.slow
def test_a_replaced_dataset_takes_its_report_along_and_says_so(made, run, tmp_path):
    pytest.importorskip("matplotlib")
    run("card", "d")
    (tmp_path / "x.yaml").write_bytes(as_yaml(Experiment.model_validate(PLAIN)))
    out = run("generate", "x.yaml", "--out", "d", "--overwrite")[1]
    assert out.endswith("\nremoved report.html, which showed the old dataset; ibdata card d makes it again\n")


def test_the_list_changes_nothing_and_takes_no_other_option(made, run):
    before = ibdata.open("d").manifest_model
    assert run("split", "d", "--list")[:2] == (0, "low  12 rows in 4 episodes (whole files)\n")
    code, out, err = run("split", "d", "--list", "--shots", "1")
    assert (code, out) == (2, "")
    assert "--list changes nothing, but found --shots too" in err
    assert ibdata.open("d").manifest_model == before
    assert "expected two names such as source=at-50" in run("split", "d", "--by", "policy", "--name", "x")[2]
