"""A URL in pyarrow's local file system."""

import pytest


@pytest.fixture
def url(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return f"{tmp_path.as_uri()}/there"
