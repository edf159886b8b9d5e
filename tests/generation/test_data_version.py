"""A dataset of another data version is refused in one line, by whoever reads its manifest."""

import pytest
from helpers.folders import contents
from helpers.forging import seal

import ibdata
from ibdata.errors import IbdataError
from ibdata.evaluation.states import state_at

FOUND = "found data version 1, expected 3; make the dataset again with this ibdata"
USES = {
    "reproduce": ibdata.reproduce,
    "repair": ibdata.repair,
    "split": lambda folder: ibdata.split(folder, by="policy"),
    "merge": lambda folder: ibdata.merge([folder, folder], folder.parent / "both"),
    "export": lambda folder: ibdata.export(folder, to="npz", out=folder.parent / "x.npz"),
    "state_at": lambda folder: state_at(folder, (0, 0)),
    "generate": lambda folder: ibdata.generate("random", folder, workers=1, resume=True),
    "overwrite": lambda folder: ibdata.generate("random", folder, workers=1, overwrite=True),
}


@pytest.mark.parametrize("use", USES.values(), ids=USES)
def test_another_data_version_is_refused(copied, use):
    seal(copied, lambda listed: listed.update(data_version=1))
    before = contents(copied)
    with pytest.raises(IbdataError, match=FOUND):
        use(copied)
    (problem,) = ibdata.validate(copied)
    assert str(problem).endswith(FOUND)
    assert contents(copied) == before
