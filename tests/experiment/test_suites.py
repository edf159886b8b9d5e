"""The search for an experiment by path or name, and folders of experiments."""

from __future__ import annotations

from pathlib import Path

import pytest
from helpers.refusals import refused

from ibdata.errors import ConfigError
from ibdata.experiment import find, load, load_all, shipped, suites
from ibdata.experiment.catalogue import catalogue

TEXT = "name: {name}\nsetpoints: 70\npolicies: [{{kind: random}}]\n"


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def folder():
    """A folder with two experiments and other files."""
    made = Path("two")
    made.mkdir()
    for file, name in (("b", "first"), ("a", "second")):
        (made / f"{file}.yaml").write_text(TEXT.format(name=name))
    (made / "notes.txt").write_text("no experiment")
    return made


def test_find_takes_a_path_and_else_a_shipped_name():
    assert find("random") == find("random.yaml") == shipped()["random"]
    Path("random.yaml").write_text(TEXT.format(name="x"))
    assert find("random.yaml") == Path("random.yaml")
    assert load("random.yaml").setpoints == 70.0


def test_a_suite_and_its_files_are_shipped_by_name():
    assert find("siemens-offline") == find("siemens-offline/") == suites()["siemens-offline"]
    assert find("siemens-offline/bad-20.yaml") == shipped()["siemens-offline/bad-20"]
    assert load("siemens-offline/bad-20").name == "siemens-offline-bad-20"
    assert len(load_all("siemens-offline").experiments) == 16


def test_a_folder_is_loaded_in_the_order_of_its_files(folder):
    path, files, made = load_all(folder)
    assert (path, [experiment.name for experiment in made]) == (folder, ["second", "first"])
    assert files == [folder / "a.yaml", folder / "b.yaml"]
    assert load_all(folder / "a.yaml") == (None, [folder / "a.yaml"], [load(folder / "a.yaml")])
    _, _, made = load_all(folder, ["steps=3"], seed=4)
    assert [(experiment.steps, experiment.seed) for experiment in made] == [(3, 4)] * 2


def test_the_problems_of_all_files_are_told_at_once(folder):
    (folder / "a.yaml").write_text(TEXT.format(name="A"))
    (folder / "b.yaml").write_text(TEXT.format(name="b").replace("70", "101"))
    with pytest.raises(ConfigError) as caught:
        load_all(folder)
    first, second = caught.value.problems
    assert first.startswith("two/a.yaml:1:7: name: found 'A'")
    assert second == "two/b.yaml:2:12: setpoints: found 101, expected a number of at most 100"


NAMES = ", ".join([*(name for name in shipped() if "/" not in name), *suites()])
FORM = "expected a file, the name of a shipped experiment, a mapping or an Experiment"
FILES = "expected one with such files, each an experiment; ibdata init makes a first one"
REFUSED = [
    *((config, f"config: found {config!r}, {FORM}") for config in (None, 42, ["random"])),
    *(
        (name, f"config: found {name!r}, expected a file or one of {NAMES}")
        for name in ("zzzzzz", "x" * 300, "a\0b", "")
    ),
    ("randm.yaml", "config: found 'randm.yaml'; did you mean 'random'?"),
    ("empty", f"config: found the folder 'empty' without a file *.yaml, {FILES}"),
    (
        "two",
        "two: found a folder of experiments, expected a file such as two/a.yaml; generate takes a folder",
    ),
]


@pytest.mark.parametrize(("config", "line"), REFUSED)
def test_what_is_no_experiment_is_refused(folder, config, line):
    Path("empty").mkdir()
    assert refused("found", load, config) == line


def test_every_shipped_experiment_is_listed():
    found = {each.name: each for each in catalogue()}
    assert set(found) == {*shipped(), *(f"{suite}/" for suite in suites())}
    assert found["random"].rows == 10_000
    assert found["random"].content_root.startswith("566ea3f2793d")
    assert found["siemens-offline/"].content_root is None
    assert found["siemens-offline/"].rows == 16 * load("siemens-offline/bad-0").rows
    assert found["siemens-offline/"].description == "A folder of 16 experiments."
