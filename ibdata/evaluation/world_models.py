"""The noise floor, the errors of the best possible prediction; errors and likelihood of world models."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import public
from ibdata._numerics.arrays import Floats, Ints
from ibdata.dataset.dataset import Place, opened
from ibdata.dataset.episodes import BLOCK_ROWS, refuse_by_returns
from ibdata.dataset.selection import whole_numbers
from ibdata.dataset.tabular import Table, Tabular
from ibdata.dataset.transitions import stacked_columns
from ibdata.dynamics import Noise, State, Variant, step
from ibdata.dynamics.noise import amplification_cdf, quadrature
from ibdata.dynamics.state import NO_DRIFT
from ibdata.errors import PolicyError, UsageError
from ibdata.evaluation.states import Replayable
from ibdata.policies.checked import AnswerError, numbers
from ibdata.views.options import ACTIONS

QUANTITIES = ("fatigue", "consumption")
PART = 512  # rows that are integrated at a time
FOLDED = math.sqrt(2.0 / math.pi)  # the mean of |z|, with z ~ N(0, 1)


class Floor(NamedTuple):
    """The errors of the best prediction of a quantity: no model has smaller expected ones.

    Attributes:
        quantity: "fatigue" or "consumption".
        root_mean_square_error: the root of the mean squared error.
        mean_absolute_error: the mean absolute error.
    """

    quantity: str
    root_mean_square_error: float
    mean_absolute_error: float


@dataclasses.dataclass(frozen=True, repr=False)
class NoiseFloor(Tabular):
    """The noise floor of one-step predictions, and the law behind it for each of n rows.

    The columns of the arrays are fatigue and consumption.

    Attributes:
        results: a `Floor` for each quantity.
        mean: the prediction with the least squared error (n, 2).
        deviation: the standard deviation around `mean` (n, 2).
        absolute: the mean absolute deviation from the median (n, 2).
    """

    results: list[Floor]
    mean: Floats
    deviation: Floats
    absolute: Floats

    def tables(self) -> list[Table]:
        """The errors, a row for each quantity."""
        return [Table(Floor._fields, self.results, [f"of one step, over {len(self.mean):,} rows"])]

    def plain(self) -> dict[str, Any]:
        """The errors as plain data."""
        return {"rows": len(self.mean), "results": [result._asdict() for result in self.results]}


@public
def noise_floor(ds: Place, split: str | Sequence[str] | None = None) -> NoiseFloor:
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

    Returns:
        The root mean square errors and mean absolute errors, and the law of each row, in the order of
        `ds.to_pandas` with the same arguments.

    Raises:
        UsageError: The dataset has no such split, or the selection is empty; episodes were chosen by their
            returns; or the dynamics have another `eta_squash` than the published ones.
        DatasetError: The rows are damaged, or this ibdata cannot simulate them again.
    """
    selection = opened(ds).select(split)
    refuse_by_returns(selection)
    source = Replayable(selection.stored)
    names = ["episode", "step", *ACTIONS, "next_obs_setpoint"]
    moments = []
    for batch in selection.iter_batches(names, batch_rows=BLOCK_ROWS):
        episodes, steps, p = (batch[x].to_numpy() for x in ("episode", "step", "next_obs_setpoint"))
        actions, laws = stacked_columns(batch, ACTIONS), np.empty((len(p), 3, 2))
        states = source.carries_at(episodes, steps).state
        for experiment, positions, _ in source.by_experiment(episodes):
            state = states.take(positions)
            if experiment.drifting:
                state = state.replace(setpoint=p[positions], drift_left=np.full(len(positions), NO_DRIFT))
            laws[positions] = _law(state, actions[positions], experiment.scenario.variant)
        moments.append(laws)
    mean, deviation, absolute = np.moveaxis(np.concatenate(moments), 1, 0)
    errors = zip(QUANTITIES, np.sqrt((deviation**2).mean(axis=0)), absolute.mean(axis=0), strict=True)
    return NoiseFloor([Floor(x, float(a), float(b)) for x, a, b in errors], mean, deviation, absolute)


def _law(state: State, actions: npt.NDArray[Any], variant: Variant) -> Floats:
    """Mean, standard deviation and mean absolute deviation of fatigue and consumption (n, 3, 2).

    Raises UsageError for a variant whose η has no known law.
    """
    k, n = variant.parameters, len(actions)
    scale, shift = k.eta_squash
    if not math.isclose(1.0, 1.0 / max(scale, 1e-9) + shift):
        raise UsageError(
            f"dynamics: found eta_squash {list(variant.eta_squash)}, expected [2, 0.5], [1, 0] or another "
            "[scale, shift] with 1/scale + shift = 1; the law of other noise is not known"
        )
    after = step(state, actions, Noise(*np.zeros((len(Noise._fields), n))), variant)
    out = np.empty((n, 3, 2))
    spread = np.abs(1.0 + k.consumption_noise * after.expected_consumption)
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
        deviation = np.sqrt((1.0 - 2.0 * (cdf @ (weights * x)) - mean**2).clip(0.0))
        absolute = np.minimum(cdf, 1.0 - cdf) @ weights
        moments = np.column_stack([1.0 + 2.0 * mean, 2.0 * deviation, 2.0 * absolute])
        out[part, :, 0] = after.basic_fatigue[part, None] / 3.0 * moments
    return out


ANSWERS = ("predictions", "standard deviations")
STEERED, PREDICTED = slice(0, 4), slice(4, 6)  # of an observation: setpoint to shift, fatigue and consumption


class ModelScore(NamedTuple):
    """The errors of a model's predictions of a quantity after some steps, and those of the noise floor.

    Attributes:
        steps: after how many steps.
        quantity: "fatigue" or "consumption".
        root_mean_square_error: the root of the model's mean squared error.
        floor_root_mean_square_error: the least possible one.
        mean_absolute_error: the model's mean absolute error.
        floor_mean_absolute_error: the least possible one.
        log_likelihood: the mean log density of what followed, after one step; None for a model that gives no
            standard deviations.
        floor_log_likelihood: the greatest expected one of normal predictions; None where the next value of a
            row is certain.
    """

    steps: int
    quantity: str
    root_mean_square_error: float
    floor_root_mean_square_error: float
    mean_absolute_error: float
    floor_mean_absolute_error: float
    log_likelihood: float | None
    floor_log_likelihood: float | None


@dataclasses.dataclass(frozen=True, repr=False)
class ModelScores(Tabular):
    """The scores of a model, and the noise floor of the rows.

    Attributes:
        results: a `ModelScore` for each number of steps and quantity.
        floor: the noise floor of the rows.
    """

    results: list[ModelScore]
    floor: NoiseFloor

    def tables(self) -> list[Table]:
        """The scores, a row each."""
        return [Table(ModelScore._fields, self.results)]

    def plain(self) -> dict[str, Any]:
        """The scores as plain data."""
        return {"results": [result._asdict() for result in self.results]}


@public
def score_model(
    ds: Place,
    model: Callable[..., Any],
    split: str | Sequence[str] | None = None,
    *,
    steps: int | Sequence[int] = (1, 10),
    history: int = 1,
) -> ModelScores:
    """Score a world model on a dataset, beside the least errors that any model can have.

    A model predicts the next fatigue and consumption from the last observations and the action. For several
    steps, predicted values take the places of observed ones; the recorded actions are given, and so are the
    setpoint, velocity, gain and shift to which they lead. See `noise_floor` for the floor, which after
    several steps is that of the last one: for fatigue a lower bound.

    Args:
        ds: The dataset, its folder or URL, or a selection of its episodes.
        model: A callable `model(observations, actions)` of float32 observations (n, 6 · history), newest
            first, and actions (n, 3). It returns fatigue and consumption (n, 2) of the next step, or a tuple
            of these and their standard deviations (n, 2), which give a likelihood.
        split: Only rows of this split, or of these.
        steps: After how many steps predictions are scored: one number or several.
        history: The number of observations that the model sees.

    Returns:
        The scores for each number of steps, and the noise floor of the rows.

    Raises:
        UsageError: An argument is invalid, or no row has so many observations before and so many steps after.
        PolicyError: The model returned no finite numbers of this shape.
        DatasetError: The rows are damaged, or this ibdata cannot simulate them again.
    """
    selection = opened(ds).select(split)
    horizons = np.unique(whole_numbers("steps", steps))
    if not horizons.size or horizons[0] < 1:
        raise UsageError(f"steps: found {steps}, expected whole numbers of at least 1")
    arrays, floor = selection.arrays(history), noise_floor(selection)
    episode, after = arrays["episode"], arrays["next_observations"][:, PREDICTED].astype(np.float64)
    results: list[ModelScore] = []
    for horizon in horizons.tolist():
        first = np.flatnonzero(arrays["step"] >= history - 1)
        first = first[first + horizon <= len(episode)]
        first = first[episode[first] == episode[first + horizon - 1]]
        if not len(first):
            raise UsageError(
                f"steps: found no row with {history} observations before and {horizon} steps after it"
            )
        mean, deviation = _predicted(model, arrays, first, horizon)
        last = first + horizon - 1
        results += _scores(horizon, mean, deviation, after[last], floor, last)
    return ModelScores(results, floor)


def _predicted(
    model: Callable[..., Any], arrays: dict[str, npt.NDArray[Any]], first: Ints, horizon: int
) -> tuple[Floats, Floats | None]:
    """Fatigue and consumption (n, 2) so many steps after rows (n,), and their deviations if known."""
    seen = arrays["observations"][first]
    for k in range(horizon):
        rows = first + k
        try:
            mean, deviation = _answer(model(seen.copy(), arrays["actions"][rows]), len(first))
        except AnswerError as error:
            raise PolicyError(f"model: step {k + 1}: {error}") from None
        steered = arrays["next_observations"][rows, STEERED]
        seen = np.concatenate([steered, mean.astype(np.float32), seen[:, :-6]], axis=1)
    return mean, deviation if horizon == 1 else None


def _answer(answer: Any, n: int) -> tuple[Floats, Floats | None]:
    """The predictions (n, 2) of a model, and their standard deviations (n, 2) if it gives them."""
    parts = answer if isinstance(answer, tuple) else (answer,)
    if not 1 <= len(parts) <= 2:
        raise AnswerError(f"found {len(parts)} arrays, expected predictions, or these and their deviations")
    arrays = [numbers(part, (n, 2), what) for part, what in zip(parts, ANSWERS, strict=False)]
    for values, what in zip(arrays, ANSWERS, strict=False):
        broken = ~np.isfinite(values).all(axis=1)
        if broken.any():
            raise AnswerError(
                f"found NaN or infinity in {broken.sum()} of {n} {what}, such as {values[broken][0]}, "
                "expected finite fatigue and consumption"
            )
    if len(arrays) == 2 and (arrays[1] <= 0.0).any():
        raise AnswerError("found a standard deviation of 0 or less, expected positive ones")
    return arrays[0], arrays[1] if len(arrays) == 2 else None


def _scores(
    horizon: int, mean: Floats, deviation: Floats | None, after: Floats, floor: NoiseFloor, rows: Ints
) -> list[ModelScore]:
    """The scores of predictions (n, 2) of what followed (n, 2) at the rows (n,) of the floor."""
    errors, spread, absolute = mean - after, floor.deviation[rows], floor.absolute[rows]
    likelihood = floor_likelihood = np.full(2, np.nan)
    if horizon == 1:
        floor_likelihood = _log_density(1.0, spread)
        if deviation is not None:
            likelihood = _log_density((errors / deviation) ** 2, deviation)
    return [
        ModelScore(
            steps=horizon,
            quantity=name,
            root_mean_square_error=float(np.sqrt((errors[:, i] ** 2).mean())),
            floor_root_mean_square_error=float(np.sqrt((spread[:, i] ** 2).mean())),
            mean_absolute_error=float(np.abs(errors[:, i]).mean()),
            floor_mean_absolute_error=float(absolute[:, i].mean()),
            log_likelihood=_number(likelihood[i]),
            floor_log_likelihood=_number(floor_likelihood[i]),
        )
        for i, name in enumerate(QUANTITIES)
    ]


def _number(x: float) -> float | None:
    """A finite number, else None."""
    return float(x) if np.isfinite(x) else None


def _log_density(squares: Floats | float, deviation: Floats) -> Floats:
    """The mean log density (2,) of normal predictions, from squared errors in units of their deviations."""
    with np.errstate(divide="ignore"):  # infinite where nothing is random
        logs: Floats = (-0.5 * squares - np.log(deviation) - 0.5 * np.log(2.0 * np.pi)).mean(axis=0)
    return logs
