"""A small dataset, and a copy of it that a test may damage."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.tiny import PLAIN

import ibdata
from ibdata import Experiment


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return ibdata.generate(
        Experiment.model_validate(PLAIN), tmp_path_factory.mktemp("made") / "tiny", workers=1
    )


@pytest.fixture
def copied(made, tmp_path) -> Path:
    return Path(shutil.copytree(made.path, tmp_path / "copied"))


@pytest.fixture
def file(copied, shard_file) -> Callable[[str], str]:
    """The path of a file in the copy: of a shard, given as `shard 0`, or the path itself."""

    def path(what: str) -> str:
        return shard_file(copied, int(what.removeprefix("shard "))) if what.startswith("shard ") else what

    return path
