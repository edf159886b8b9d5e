"""One line on stderr tells that somebody waits for the compiler."""

from __future__ import annotations

import pytest

from ibdata._numerics import compiled
from ibdata._system.cache_folders import CacheFolders

ONCE = "ibdata: compiling the simulator, in about 12 seconds, once\n"


@pytest.fixture(autouse=True)
def places(monkeypatch, tmp_path):
    found = [CacheFolders((str(tmp_path),), True)]
    monkeypatch.setattr(compiled, "cache_folders", lambda: found[0])
    return found


def test_all_that_a_process_compiles_is_one_line(capsys):
    """Functions that are compiled for another one are no news either."""
    said = compiled.Announcement()
    for _ in range(3):
        said.begin("ibdata.dynamics.step")
        said.begin("ibdata.dynamics.step")  # for the first
        said.end()
        said.end()
    assert capsys.readouterr() == ("", ONCE)


def test_what_a_later_process_compiles_is_a_part_and_without_a_cache_folder_the_line_says_why(
    tmp_path, places, capsys
):
    """It takes less time, or happens in every run."""
    (tmp_path / "numba").mkdir()
    (tmp_path / "numba/x.nbc").touch()
    compiled.Announcement().begin("ibdata.policies.network")
    said = "ibdata: compiling ibdata.policies.network, in a few seconds, once\n"
    assert capsys.readouterr().err == said
    places[0] = places[0]._replace(lasting=False)
    compiled.Announcement().begin("ibdata.policies.network")
    assert "in every run because no cache folder can be written to" in capsys.readouterr().err


def test_a_terminal_shows_how_many_functions_are_compiled(monkeypatch, capsys):
    """In the same line, which is empty afterwards; of how many is known if it is the whole simulator."""
    monkeypatch.setattr("sys.stderr.isatty", lambda: True, raising=False)
    said = compiled.Announcement()
    said.begin("ibdata._simulation.kernel")
    said.begin("ibdata.dynamics.step")
    said.end()
    said.end()
    shown = capsys.readouterr().err.removeprefix(ONCE).split("\r\033[K")
    counts = [f"ibdata: functions compiled: {n} of about {compiled.FUNCTIONS}" for n in (0, 0, 1)]
    assert shown == ["", *counts, ""]
