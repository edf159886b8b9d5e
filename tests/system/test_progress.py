"""Bars of long tasks reach their ends, move by a few steps, and are shown only where wanted."""

import sys
from contextlib import nullcontext

import pytest

import ibdata
from ibdata.cli import cli


@pytest.fixture
def bars(monkeypatch):
    """The bars that are shown: the total of each and the numbers by which it moves."""
    shown = []

    class Bar(nullcontext):
        def __init__(self, total, **options):
            super().__init__(self)
            self.total, self.moves = total, []
            self.update = self.moves.append
            shown.append(self)

    monkeypatch.setattr("tqdm.auto.tqdm", Bar)
    return shown


@pytest.mark.parametrize(("workers", "steps"), [(1, 40), pytest.param(2, 100, marks=pytest.mark.slow)])
def test_the_bar_of_generate_moves_by_parts_of_files(bars, tmp_path, monkeypatch, workers, steps):
    """600 episodes in two files, each simulated in blocks of 256 and 44 episodes, 32 steps at a time."""
    monkeypatch.setattr("ibdata.generation.workers.available_processors", lambda: 2)
    plain = {"name": "parts", "setpoints": 70, "policies": ["constant"], "episodes": 600, "steps": steps}
    plain["output"] = {"latent": False, "shard_rows": 300 * steps}
    ibdata.generate(plain, tmp_path / "made", workers=workers, progress=True)
    [bar] = bars
    assert bar.total == sum(bar.moves) == 600 * steps
    blocks = [32] * (steps // 32) + [steps % 32]
    assert sorted(n for n in bar.moves if n) == sorted(2 * [n * count for n in (44, 256) for count in blocks])


COMMANDS = {
    "evaluate": "evaluate --policy safe --steps 3",
    "generate": "generate --config random --set steps=3 --out {out}/made --workers 1",
}


@pytest.mark.parametrize("line", COMMANDS.values(), ids=COMMANDS)
def test_a_command_shows_its_bar_only_in_a_terminal(bars, tmp_path, monkeypatch, line):
    for terminal, more in ((False, ""), (True, " --quiet"), (True, " --overwrite" * ("generate" in line))):
        monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal)  # noqa: B023
        assert bars == []
        cli.main((line + more).format(out=tmp_path).split(), standalone_mode=False)
    assert len(bars) == 1
