"""Stories of datasets: whatever happens, a folder is a finished dataset, or it is not there."""

from __future__ import annotations

import os
from collections.abc import Callable

import pytest
from helpers.forks import Forks
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis.stateful import run_state_machine_as_test

from life.story import Life, know

STEPS = 30
PARTS = 4  # of the many stories, for as many processes of pytest


@pytest.fixture(scope="session")
def known(forks: Forks, tmp_path_factory: pytest.TempPathFactory):
    """What all stories share."""
    return know(forks, tmp_path_factory.mktemp("known"))


@pytest.fixture
def tell(known, record_property: Callable[[str, object], None]) -> Callable[[int, int], None]:
    """Tell so many stories, the same ones every time; hypothesis prints one that goes wrong."""

    def told(number: int, stories: int) -> None:
        known.figures.clear()
        machine = seed(number)(type("Life", (Life,), {"known": known}))
        how = settings(
            database=None,
            deadline=None,
            max_examples=stories,
            stateful_step_count=STEPS,
            phases=[Phase.generate],
            print_blob=False,
            suppress_health_check=list(HealthCheck),
        )
        run_state_machine_as_test(machine, settings=how)
        record_property("figure", f"stories {number}: {stories}: {dict(sorted(known.figures.items()))}")

    return told


def test_a_few_stories(tell) -> None:
    """No command, kill, damage or reader of eight stories finds anything but a whole dataset or none."""
    tell(0, 8)


@pytest.mark.faults
@pytest.mark.parametrize("part", range(1, PARTS + 1))
def test_many_stories(tell, part: int) -> None:
    """Nor of a hundred, of which every process tells a part."""
    tell(part, int(os.environ.get("IBDATA_STORIES", "100")) // PARTS)
