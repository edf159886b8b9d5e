"""A dataset of another data version is refused in one line, by whoever reads its manifest."""

from __future__ import annotations

import pytest
from helpers.folders import contents
from helpers.forging import seal

import ibdata
from ibdata.dataset import manifest
from ibdata.errors import IbdataError
from ibdata.evaluation.states import state_at

FOUND = "found data version 1, expected 3; make the dataset again with this ibdata"
USES = {
    "open": ibdata.open,
    "reproduce": ibdata.reproduce,
    "repair": ibdata.repair,
    "split": lambda folder: ibdata.split(folder, by="policy"),
    "merge": lambda folder: ibdata.merge([folder, folder], folder.parent / "both"),
    "export": lambda folder: ibdata.export(folder, to="npz", out=folder.parent / "x.npz"),
    "state_at": lambda folder: state_at(folder, (0, 0)),
    "generate": lambda folder: ibdata.generate("random", folder, workers=1, resume=True),
    "overwrite": lambda folder: ibdata.generate("random", folder, workers=1, overwrite=True),
}


@pytest.fixture
def other(copied):
    """A dataset whose manifest has another data version."""
    seal(copied, lambda listed: listed.update(data_version=1))
    return copied


def test_every_dataset_has_the_one_data_version(either):
    """There is one data version, whatever an experiment uses."""
    assert either.manifest["data_version"] == manifest.DATA_VERSION == 3


@pytest.mark.parametrize("use", USES.values(), ids=USES)
def test_another_data_version_is_refused(other, use):
    """Readers and writers name another data version in one line, and leave the dataset as it is."""
    before = contents(other)
    with pytest.raises(IbdataError, match=FOUND):
        use(other)
    assert contents(other) == before


def test_validate_names_another_data_version_only(other):
    """`validate` has one problem for it, since nothing else of it can be judged."""
    (problem,) = ibdata.validate(other)
    assert str(problem) == f"{manifest.PATH}: manifest: {FOUND}"
