"""NumPy's NPZ, with the keys of D4RL: observations, actions, rewards, next_observations, terminals, timeouts,
and infos/… with episode, step, latent state and action_log_prob. Not compressed. Includes the last transition
of each episode, with its next observation. All arrays are in memory at once, as they are when np.load reads
them.
"""

from __future__ import annotations

from pathlib import Path

from ibdata.exporters._source import Source, d4rl_arrays, write_npz

HOLDS_COSTS = True  # it has a place for them


def export(source: Source, path: Path, target: Path) -> str:
    """Write the NPZ."""
    write_npz(source, d4rl_arrays, path)
    return f"""\
import numpy as np

data = np.load({str(target)!r})
data["observations"], data["actions"], data["rewards"], data["next_observations"], data["terminals"]
"""
