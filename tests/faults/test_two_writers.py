"""F6: two runs at one place, and a run whose folder is moved away."""

from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.faults
BUSY = 75


def begin(tools: Any, out: Path, *more: object) -> Any:
    """A run that has finished a shard."""
    process = tools.start(tools.many, out, *more)
    tools.wait_for(lambda: tools.receipts(out), process)
    return process


def test_of_runs_that_start_together_one_wins(tools: Any, whole: str) -> None:
    """One makes the dataset; the others are refused, or find it finished."""
    races = tools.size(2, 50)
    for i in range(races):
        out = tools.where / f"out-{i}"
        seeds = (0, 0, 7) if i % 2 else (0, 0, 0)
        runs = [tools.start(tools.many, out, "--seed", seed) for seed in seeds]
        said = [run.communicate(timeout=100)[1] for run in runs]
        codes = sorted(run.returncode for run in runs)
        assert codes[0] == 0, said
        assert set(codes[1:]) <= {0, 2, BUSY}, said
        assert all(text == "" or tools.one_line(text) for text in said), said
        assert tools.root(out) == whole or runs[-1].returncode == 0
        assert tools.leftovers(out) == []
    tools.figure(f"F6, together: {races} races of 3 runs: one made the dataset")


@pytest.mark.parametrize("what", ["the part", "the parent"])
def test_a_run_whose_part_is_moved_away(tools: Any, ending: Any, whole: str, what: str) -> None:
    """It ends with one line, and the next run at that place begins anew."""
    parent = tools.where / "parent"
    out = parent / "out"
    moved = parent / ".out.part" if what == "the part" else parent
    with begin(tools, out) as first:
        ending(first)
        moved.rename(tools.where / "gone")
        _, stderr = first.communicate(timeout=60)
    second = tools.generate(tools.many, out, "--seed", 7)
    assert first.returncode == 1, stderr
    assert tools.one_line(stderr), stderr
    assert second.returncode == 0, second
    other = tools.root(out)
    assert other != whole
    assert tools.leftovers(out) == []
