"""The noise floor: the errors of the best possible prediction of the next fatigue and consumption."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import public
from ibdata.dataset.dataset import Place, opened
from ibdata.dataset.episodes import refuse_by_returns
from ibdata.dataset.tabular import Table, Tabular
from ibdata.dataset.transitions import stacked_columns
from ibdata.dynamics import Noise, State, Variant, step
from ibdata.dynamics.noise import amplification_cdf, quadrature
from ibdata.dynamics.state import NO_DRIFT
from ibdata.errors import UsageError
from ibdata.evaluation.states import Source
from ibdata.policies.baselines import Constant
from ibdata.views.options import ACTIONS

Floats = npt.NDArray[np.float64]
QUANTITIES = ("fatigue", "consumption")
BATCH_ROWS, PART = 32_768, 512  # rows that are simulated, and integrated, at a time
FOLDED = math.sqrt(2.0 / math.pi)  # the mean of |z|, with z ~ N(0, 1)


class Floor(NamedTuple):
    """The errors of the best prediction of a quantity: no model has smaller expected ones."""

    quantity: str
    root_mean_square_error: float
    mean_absolute_error: float


@dataclasses.dataclass(frozen=True, repr=False)
class NoiseFloor(Tabular):
    """The noise floor of one-step predictions, and the law behind it for each of n rows.

    Columns are those of fatigue and consumption. `mean` is the prediction with the least squared error,
    `deviation` the standard deviation around it, and `absolute` the mean absolute deviation from the median.
    """

    results: list[Floor]
    mean: Floats  # (n, 2)
    deviation: Floats  # (n, 2)
    absolute: Floats  # (n, 2)

    def tables(self) -> list[Table]:
        """The errors, a row for each quantity."""
        return [Table(Floor._fields, self.results, [f"of one step, over {len(self.mean):,} rows"])]

    def plain(self) -> dict[str, Any]:
        """The errors as plain data."""
        return {"rows": len(self.mean), "results": [result._asdict() for result in self.results]}


@public
def noise_floor(
    ds: Place,
    split: str | Sequence[str] | None = None,
    *,
    setpoint: float | Sequence[float] | None = None,
    policy: str | Sequence[str] | None = None,
) -> NoiseFloor:
    """The least errors with which any model can predict the next fatigue and the next consumption.

    A perfect model knows the hidden state and the action of a row, but not the random numbers of the step.
    Their law is known:

        c ~ N(ĉ, (1 + k ĉ)²)
        f = f_b (1 + 2 α)/3, where P(α <= x) is `ibdata.dynamics.noise.amplification_cdf`

    with ĉ and f_b of the next state. The states are simulated again from the random numbers' addresses, so
    the dataset needs no latent columns; moments of α are computed by quadrature. Where the setpoint moves,
    the next one counts as known.

    Args:
        ds: The dataset, its folder or URL, or a selection of its episodes.
        split: Only rows of this split, or of these.
        setpoint: Only rows at this setpoint, or at these; moving ones count by their first value.
        policy: Only rows of the policy with this label, or with these.

    Returns:
        The root mean square errors and mean absolute errors, and the law of each row, in the order of
        `ds.to_pandas` with the same arguments.

    Raises:
        UsageError: The dataset has no such split, setpoint or policy, or no such row; episodes were chosen
            by their returns; or the dynamics have another `eta_squash` than the published ones.
        DatasetError: The rows are damaged, or this ibdata cannot simulate them again.
    """
    selection = opened(ds).select(split, setpoint=setpoint, policy=policy)
    refuse_by_returns(selection)
    source = Source(selection.stored)
    names = ["episode", "step", *ACTIONS, "next_obs_setpoint"]
    moments = []
    for batch in selection.iter_batches(names, batch_rows=BATCH_ROWS):
        episodes, steps, p = (batch[x].to_numpy() for x in ("episode", "step", "next_obs_setpoint"))
        actions, laws = stacked_columns(batch, ACTIONS), np.empty((len(p), 3, 2))
        states = source.carries_at(episodes, steps, Constant()).state  # any policy that sees nothing
        for experiment, positions, _ in source.by_experiment(episodes):
            state = states.take(positions)
            if experiment.drifting:
                state = state.replace(setpoint=p[positions], drift_left=np.full(len(positions), NO_DRIFT))
            laws[positions] = _law(state, actions[positions], experiment.variant)
        moments.append(laws)
    mean, deviation, absolute = np.moveaxis(np.concatenate(moments), 1, 0)
    errors = zip(QUANTITIES, np.sqrt((deviation**2).mean(axis=0)), absolute.mean(axis=0), strict=True)
    return NoiseFloor([Floor(x, float(a), float(b)) for x, a, b in errors], mean, deviation, absolute)


def _law(state: State, actions: npt.NDArray[Any], variant: Variant) -> Floats:
    """Mean, standard deviation and mean absolute deviation of fatigue and consumption (n, 3, 2).

    Raises UsageError for a variant whose η has no known law.
    """
    k, n = variant.parameters, len(actions)
    if not math.isclose(1.0, 1.0 / max(k.eta_scale, 1e-9) + k.eta_shift):
        raise UsageError(
            f"dynamics: found eta_squash {list(variant.eta_squash)}, expected [2, 0.5], [1, 0] or another "
            "[scale, shift] with 1/scale + shift = 1; the law of other noise is not known"
        )
    after = step(state, actions, Noise(*np.zeros((len(Noise._fields), n))), variant)
    out = np.empty((n, 3, 2))
    spread = 1.0 + k.consumption_noise * after.expected_consumption
    out[:, :, 1] = np.column_stack([after.expected_consumption, spread, FOLDED * spread])
    x, weights = quadrature()
    for first in range(0, n, PART):
        part = slice(first, first + PART)
        cdf = amplification_cdf(
            x,
            state.mu_v[part],
            state.mu_g[part],
            after.effective_velocity[part],
            after.effective_gain[part],
            k,
        )
        mean = 1.0 - cdf @ weights
        variance = 1.0 - 2.0 * (cdf @ (weights * x)) - mean**2
        absolute = np.minimum(cdf, 1.0 - cdf) @ weights
        moments = np.column_stack([1.0 + 2.0 * mean, 2.0 * np.sqrt(variance), 2.0 * absolute])
        out[part, :, 0] = after.basic_fatigue[part, None] / 3.0 * moments
    return out
