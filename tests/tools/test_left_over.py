"""What a process has left that was killed after it had published is removed by the same call."""

import pytest
from helpers.folders import part_of
from helpers.refusals import refused

import ibdata


def left(place):
    """The part of a process that was killed while it cleared that."""
    (part_of(place) / "tmp-0123456789abcdef").mkdir(parents=True)
    (part_of(place) / "ibdata.lock").touch()
    return part_of(place)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    experiment = {"name": "x", "setpoints": 50, "policies": ["random"], "episodes": 2, "steps": 5}
    return ibdata.generate(experiment, tmp_path_factory.mktemp("left") / "x", workers=1)


def test_an_export_that_is_there(dataset, tmp_path):
    ibdata.export(dataset, "npz", tmp_path / "made")
    part = left(tmp_path / "made")
    refused("exists already", ibdata.export, dataset, "npz", tmp_path / "made")
    assert not part.exists()


def test_windows_that_are_there(dataset, tmp_path):
    whole = len(dataset.windows(folder=tmp_path / "made"))
    part = left(tmp_path / "made")
    assert len(dataset.windows(folder=tmp_path / "made")) == whole
    assert not part.exists()


def test_a_dataset_that_is_whole(dataset):
    part = left(dataset.path)
    assert ibdata.repair(dataset.path) == []
    assert not part.exists()


def test_a_signal_after_publication_stops_nothing(dataset, tmp_path, monkeypatch):
    """The export is there, so the call says so."""
    import signal

    from ibdata._system.part import Part

    clear = Part.remove

    def interrupted(part):
        signal.raise_signal(signal.SIGINT)
        clear(part)

    monkeypatch.setattr(Part, "remove", interrupted)
    assert ibdata.export(dataset, "npz", tmp_path / "made").rows == 10
    assert [each.name for each in tmp_path.iterdir()] == ["made"]
