"""A dataset of another data version is refused in one line, by whoever reads its manifest."""

from __future__ import annotations

import pytest
from helpers.forging import seal

import ibdata
from ibdata.dataset import manifest
from ibdata.errors import DatasetError, IbdataError
from ibdata.evaluation.states import state_at

USES = {
    "open": ibdata.open,
    "reproduce": ibdata.reproduce,
    "split": lambda folder: ibdata.split(folder, by="policy"),
    "merge": lambda folder: ibdata.merge([folder, folder], folder.parent / "both"),
    "export": lambda folder: ibdata.export(folder, to="npz", out=folder.parent / "x.npz"),
    "state_at": lambda folder: state_at(folder, 0, 0),
}


@pytest.fixture
def other(copied):
    """A dataset whose manifest has another data version, and its bytes."""
    seal(copied, lambda listed: listed.update(data_version=1))
    return copied, {path: path.read_bytes() for path in copied.rglob("*") if path.is_file()}


def test_every_dataset_has_the_one_data_version(either):
    assert either.manifest["data_version"] == manifest.DATA_VERSION == 2


@pytest.mark.parametrize("use", USES.values(), ids=USES)
def test_a_dataset_of_another_data_version_is_refused_and_left_as_it_is(other, use):
    folder, before = other
    with pytest.raises(DatasetError) as error:
        use(folder)
    assert str(error.value) == (
        f"{folder / manifest.PATH}: found data version 1, expected 2; make the dataset again with this ibdata"
    )
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_validate_names_another_data_version_and_nothing_else(other):
    folder, _ = other
    (problem,) = ibdata.validate(folder)
    assert str(problem) == (
        f"{manifest.PATH}: manifest: found data version 1, expected 2; "
        "make the dataset again with this ibdata"
    )


def test_a_dataset_of_another_data_version_is_not_taken_for_finished(other, declared):
    folder, before = other
    with pytest.raises(IbdataError, match="found data version 1, expected 2"):
        ibdata.generate(declared, folder, workers=1, resume=True)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before
