"""The measures of the quality of a dataset."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ibdata.arguments import public
from ibdata.dataset.dataset import Place, opened
from ibdata.dataset.tabular import Table, Tabular
from ibdata.dataset.transitions import stacked_columns, whole_episodes
from ibdata.measures.coverage import Coverage, state_numbers
from ibdata.measures.returns import MEANING as RETURN_MEANING
from ibdata.measures.returns import return_measures
from ibdata.measures.stochasticity import Stochasticity, action_entropy
from ibdata.views.options import ACTIONS

STEERINGS = ("obs_velocity", "obs_gain", "obs_shift")
DENSITY = "action_log_prob"
BATCH_ROWS = 65_536
MEANING = {
    **RETURN_MEANING,
    "state_action_coverage": "different pairs of state and action: 1 = as many as random actions",
    "action_stochasticity": "standard deviation of the actions in a cell of the state grid",
    "action_entropy": "from the recorded densities: 0 = deterministic, 2.08 = random; no bounds",
}


@dataclasses.dataclass(frozen=True, repr=False)
class Quality(Tabular):
    """Measures of the quality of a dataset; a measure is None where it is not defined.

    `pairs` are the different pairs of a state and an action on a grid, and `reference_pairs` those of random
    actions.
    """

    rows: int
    episodes: int
    trajectory_quality: float | None
    return_improvement: float | None
    state_action_coverage: float
    action_stochasticity: float | None
    action_entropy: float | None
    pairs: int
    reference_pairs: int

    def tables(self) -> list[Table]:
        """The measures, a row each."""
        rows = [(name.replace("_", " "), getattr(self, name), said) for name, said in MEANING.items()]
        size = f"{self.rows:,} rows in {self.episodes:,} episodes, {self.pairs:,} different pairs"
        return [Table(("measure", "value", "meaning"), rows, [size])]

    def plain(self) -> dict[str, Any]:
        """The result as plain data."""
        return dataclasses.asdict(self)


@public
def quality(
    ds: Place,
    split: str | Sequence[str] | None = None,
    *,
    setpoint: float | Sequence[float] | None = None,
    policy: str | Sequence[str] | None = None,
) -> Quality:
    """Measure the quality of a dataset for offline reinforcement learning, in one pass in bounded memory.

    Trajectory quality and state-action coverage are those of Schweighofer et al. 2022 (arXiv 2111.04714),
    return improvement and action stochasticity those of Swazinna, Udluft and Runkler 2021 (arXiv 2111.13461).
    The entropy needs the recorded densities and no behaviour model. docs/quality.md has their definitions,
    grid and reference data, and the values of the shipped sets.

    Args:
        ds: The dataset, its folder or URL, or a selection of its episodes.
        split: Only episodes of this split, or of these.
        setpoint: Only episodes at this setpoint, or at these; moving ones count by their first value.
        policy: Only episodes of the policy with this label, or with these.

    Returns:
        The measures. The trajectory quality is None if ibdata has no reference returns for the dynamics,
        start, setpoint and length of all episodes; see `Dataset.returns`.

    Raises:
        UsageError: The dataset has no such split, setpoint or policy, or no such episode.
        DatasetError: A file is missing or damaged.
    """
    selection = opened(ds).select(split, setpoint=setpoint, policy=policy)
    names = ["obs_setpoint", *STEERINGS, *ACTIONS, DENSITY, "step", "terminated", "truncated"]
    batches, episodes = selection.iter_batches(names, batch_rows=BATCH_ROWS), selection.episode_table
    coverage, stochasticity, entropies = Coverage(), Stochasticity(), []
    rows = 0
    for table in whole_episodes(batches, selection.place):
        at = table["obs_setpoint"].to_numpy()
        steerings, actions = (stacked_columns(table, x).astype(np.float64) for x in (STEERINGS, ACTIONS))
        lengths = np.diff(np.flatnonzero(np.append(table["step"].to_numpy() == 0, True)))
        coverage.add(at, steerings, actions, lengths)
        stochasticity.add(state_numbers(at, steerings), actions)
        entropies.append(len(table) * action_entropy(table[DENSITY].to_numpy()))
        rows += len(table)
    entropy = math.fsum(entropies) / rows
    pairs, reference_pairs = coverage.pairs
    return Quality(
        rows,
        len(episodes),
        *return_measures(episodes, selection.stored.info),
        pairs / reference_pairs,
        stochasticity.value,
        entropy if math.isfinite(entropy) else None,
        pairs,
        reference_pairs,
    )
