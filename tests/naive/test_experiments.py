"""What people hand to ibdata in a normal year: configs of other libraries, edited files, datasets that change."""

from __future__ import annotations

import pytest

import ibdata
from ibdata.errors import BusyError
from ibdata.plots import plot
from ibdata.tools.card import card

PLAIN = {"name": "m", "setpoints": [20, 70], "policies": ["random", "safe"], "steps": 5}

TAKING = {  # every function that takes a dataset
    "validate": ibdata.validate,
    "reproduce": ibdata.reproduce,
    "repair": ibdata.repair,
    "card": card,
    "split": lambda ds: ibdata.split(ds, "setpoint"),
    "merge": lambda ds: ibdata.merge([ds, ds], "merged"),
    "export": lambda ds: ibdata.export(ds, "npz", "out.npz"),
    "plot": lambda ds: plot(ds, "summary"),
    "importance": lambda ds: ibdata.importance(ds, "random"),
    "noise_floor": ibdata.noise_floor,
    "true_values": lambda ds: ibdata.true_values(ds, [0], "safe"),
    "state_at": lambda ds: ibdata.state_at(ds, [0]),
    "open": ibdata.open,
    "arrays": lambda ds: ds.arrays(),
}


@pytest.fixture(scope="module")
def replaced(tmp_path_factory):
    """A dataset that was opened and then replaced by one of another seed."""
    folder = tmp_path_factory.mktemp("replaced") / "m"
    ds = ibdata.generate(PLAIN, folder, workers=1)
    ibdata.generate(PLAIN, folder, seed=1, overwrite=True, workers=1)
    return ds


@pytest.mark.parametrize("call", TAKING.values(), ids=TAKING)
def test_a_dataset_is_replaced_while_it_is_open(replaced, tmp_path, monkeypatch, call):
    """Another run overwrites a dataset that a notebook has open: no call answers for the new one."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BusyError, match=r"m: replaced while it was read; open it again$"):
        call(replaced)
    assert ibdata.validate(replaced.path) == []
