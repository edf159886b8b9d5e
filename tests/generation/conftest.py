"""Every test of whole runs begins in an empty folder; `here` has the files of a custom policy."""

import textwrap

import pytest
from helpers.own_code import FILES


@pytest.fixture(autouse=True)
def _in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def here(tmp_path):
    """The current folder, with the policy's files."""
    for path, text in FILES.items():
        (tmp_path / path).write_text(textwrap.dedent(text))
    return tmp_path
