"""One line on stderr tells that somebody waits for the compiler."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from ibdata.numerics import announcement
from ibdata.system.cache_folders import CacheFolders

ONCE = "ibdata: compiling the simulator; this happens once and takes up to 30 seconds\n"


@pytest.fixture
def clock(monkeypatch):
    now = SimpleNamespace(seconds=0.0)
    monkeypatch.setattr(announcement.time, "monotonic", lambda: now.seconds)
    return now


@pytest.fixture(autouse=True)
def places(monkeypatch, tmp_path):
    found = [CacheFolders((str(tmp_path),), True)]
    monkeypatch.setattr(announcement, "cache_folders", lambda: found[0])
    return found


def test_functions_compiled_one_after_another_are_one_line(clock, capsys):
    """Those that are compiled for another one are no news either."""
    said = announcement.Announcement()
    for _ in range(3):
        said.begin()
        clock.seconds += 100.0
        said.begin()  # for the first
        said.end()
        said.end()
        clock.seconds += 0.1
    assert capsys.readouterr() == ("", ONCE)


def test_a_part_that_is_compiled_later_is_another_line(clock, tmp_path, capsys):
    """It says that this is a part, which takes less time."""
    said = announcement.Announcement()
    said.begin()
    said.end()
    (tmp_path / "numba").mkdir()
    (tmp_path / "numba/x.nbc").touch()
    clock.seconds += 2 * announcement.PAUSE
    said.begin()
    assert capsys.readouterr().err == ONCE + (
        "ibdata: compiling a part of the simulator that was not used before; this happens once and takes "
        "a few seconds\n"
    )


def test_without_a_cache_folder_the_line_says_why(clock, places, capsys):
    """It happens in every run then."""
    places[0] = places[0]._replace(lasting=False)
    announcement.Announcement().begin()
    assert "in every run, because no cache folder can be written to" in capsys.readouterr().err
