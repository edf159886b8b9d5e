"""Datasets of every form for the pictures."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from helpers.splits import BY_POLICY

import ibdata
from ibdata import Dataset, Experiment

PLAIN: dict[str, Any] = {
    "name": "many",
    "setpoints": [20.0, 50.0, 80.0],
    "policies": [{"kind": "random"}, {"kind": "safe"}, {"kind": "mediocre"}],
    "episodes": 2,
    "steps": 60,
}
FORMS: dict[str, dict[str, Any]] = {
    "moving": {"setpoints": {"drifting": [20.0, 50.0]}, "output": {"latent": "full", "dtype": "float64"}},
    "bare": {"output": {"latent": False}},
    "next": {"output": {"latent": "next"}, "splits": {"low": {"setpoint": 20}}},
    "single": {
        "setpoints": 50.0,
        "policies": [{"kind": "constant", "action": [0, 0, 0]}],
        "episodes": 1,
        "steps": 1,
    },
    "crowd": {
        "setpoints": {"start": 1, "stop": 30, "step": 1},
        "policies": [{"kind": "constant", "action": [i / 10, 0, 0], "name": f"c{i}"} for i in range(10)],
        "steps": 5,
    },
}

Make = Callable[..., Dataset]


@pytest.fixture(scope="session")
def make(tmp_path_factory) -> Make:
    """The dataset of the plain experiment with changes."""

    def of(**changes: Any) -> Dataset:
        experiment = Experiment.model_validate({**PLAIN, **changes})
        return ibdata.generate(experiment, tmp_path_factory.mktemp("plots") / "made", workers=1)

    return of


@pytest.fixture(scope="session")
def many(make) -> Dataset:
    """72,000 rows in one file, more than are read at once; splits that overlap."""
    dataset = make(episodes=8, steps=1000)
    dataset = ibdata.split(
        dataset.path, {"source": {"setpoint": 20}, "target": {"setpoint": 80, "episodes": 3}}
    )
    return ibdata.split(dataset.path, BY_POLICY)


@pytest.fixture(scope="session")
def merged(make, tmp_path_factory) -> Dataset:
    """Episodes of 60 and of 100 steps."""
    parts = [make(splits={"low": {"setpoint": 20}}), make(seed=1, steps=100)]
    return ibdata.merge([part.path for part in parts], tmp_path_factory.mktemp("merged") / "both")


@pytest.fixture(params=["many", "merged", *FORMS])
def any_form(request, make) -> Dataset:
    return make(**FORMS[request.param]) if request.param in FORMS else request.getfixturevalue(request.param)
