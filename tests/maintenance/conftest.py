"""A small dataset, and a copy of it that a test may damage."""

import shutil
from pathlib import Path

import pytest
from helpers.tiny import PLAIN

import ibdata


@pytest.fixture(scope="session")
def made(tmp_path_factory):
    return ibdata.generate(PLAIN, tmp_path_factory.mktemp("made") / "tiny", workers=1)


@pytest.fixture
def copied(made, tmp_path):
    return Path(shutil.copytree(made.path, tmp_path / "copied"))


@pytest.fixture
def file(copied, shard_file):
    """The path of a file in the copy: of a shard, given as `shard 0`, or the path itself."""

    def path(what):
        return shard_file(copied, int(what.removeprefix("shard "))) if what.startswith("shard ") else what

    return path
