"""The target policies of docs/policy-selection.md as files: checkpoints of the training of the baselines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import ibdata
from training.offline import HISTORY, STEPS, Rows, train
from training.selecting import Checkpoint

SEED = 0


def write_checkpoints(wanted: list[Checkpoint], rows: Rows, folder: Path) -> None:
    """Train an algorithm as `scripts/baselines` does, up to the last of some checkpoints, and write these."""
    by_steps = {each.training_steps: each for each in wanted}

    def keep(step: int, learned: Any) -> None:
        if one := by_steps.get(step):
            path = one.file(folder)
            path.parent.mkdir(parents=True, exist_ok=True)
            said = f"{one.algorithm} on {one.set}, seed {SEED}, {step} of {STEPS} steps"
            ibdata.save_network(path, learned, history=HISTORY, provenance=said)

    train(wanted[0].algorithm, rows, SEED, max(by_steps), keep)
