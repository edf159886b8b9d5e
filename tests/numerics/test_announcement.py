"""One line on stderr tells that somebody waits for the compiler."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from ibdata.numerics import announcement

ONCE = "ibdata: compiling the simulator; this happens once and takes up to 30 seconds\n"


@pytest.fixture
def clock(monkeypatch):
    now = SimpleNamespace(seconds=0.0)
    monkeypatch.setattr(announcement.time, "monotonic", lambda: now.seconds)
    return now


@pytest.fixture
def places(tmp_path):
    return SimpleNamespace(folders=[str(tmp_path)], lasting=True)


def test_functions_that_are_compiled_one_after_another_are_announced_once(clock, places, capsys):
    said = announcement.Announcement()
    for _ in range(3):
        said.begin(places)
        clock.seconds += 100.0
        said.begin(places)  # for the first
        said.end()
        said.end()
        clock.seconds += 0.1
    assert capsys.readouterr() == ("", ONCE)


def test_a_part_that_is_compiled_later_is_announced_as_a_part(clock, places, tmp_path, capsys):
    said = announcement.Announcement()
    said.begin(places)
    said.end()
    (tmp_path / "x.nbc").touch()
    clock.seconds += 2 * announcement.PAUSE
    said.begin(places)
    assert capsys.readouterr().err == ONCE + (
        "ibdata: compiling a part of the simulator that was not used before; this happens once and takes "
        "a few seconds\n"
    )


def test_who_has_no_cache_folder_learns_why_it_happens_in_every_run(clock, places, capsys):
    places.lasting = False
    announcement.Announcement().begin(places)
    assert "in every run, because there is no cache folder" in capsys.readouterr().err
