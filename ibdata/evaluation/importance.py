"""Off-policy evaluation: the return of a policy from the data of another one, by importance weights."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from ibdata._numerics.arguments import public
from ibdata._numerics.arrays import Floats, Ints
from ibdata._numerics.confidence import mean_estimate
from ibdata.dataset.dataset import Place, opened
from ibdata.dataset.episodes import refuse_by_returns, refuse_empty
from ibdata.dataset.tabular import Table, Tabular
from ibdata.errors import UsageError
from ibdata.evaluation.overlap import (
    Ratios,
    log_ratios,
    parts_by_policy,
    recorded_in,
    refuse_remembered_draws,
)
from ibdata.evaluation.play import checked_discount
from ibdata.evaluation.policies import as_policy, loaded
from ibdata.evaluation.states import Replayable
from ibdata.plan.code_record import refuse_changed
from ibdata.plan.consent import consented_spec
from ibdata.policies.user_object import UserObject

LEAST_EFFECTIVE = 100.0  # episodes, below which the weighted estimate has a warning
METHODS = ("weighted", "per decision", "ordinary")
FARTHEST = 2.0  # standard errors; an estimate farther from the weighted one has a warning

WRONG = 8.0  # errors from 1; if the densities are right, less than one of 1,000 calls goes so far
LACKING = 4.0  # errors from 1, beyond which the weighted estimate has a warning
TOLERANCE = 1e-3  # more than float32 changes in the recorded log densities of 1,000 steps
NONE = (None, None, None)  # no estimate, error or interval
OVERFLOW = "warning: some weights are larger than any number, so only the weighted estimate is there"
FEWEST = 100  # episodes that are looked at; fewer have a warning anyway
# A weight above this share of the episodes has too few like it for a standard error. It is divided by π, so
# that weights of policies with a few actions never equal the bound, where rounding would decide.
LARGE = 1.0 / (64.0 * math.pi)


class Estimated(NamedTuple):
    """The target's mean return as a method estimates it. Errors are None for one episode.

    Attributes:
        method: "weighted", "per decision" or "ordinary"; `importance` has their formulas.
        mean_return: the estimate; None if the weights of a step are all 0, or larger than any number.
        standard_error: the standard error of `mean_return`.
        interval: the 95 % interval of `mean_return`.
        mean_weight: the mean weight of the last step, which is expected to be 1.
        weight_error: the standard error of `mean_weight`.
        effective: the effective number of episodes at the last step, (Σw)²/Σw².
    """

    method: str
    mean_return: float | None
    standard_error: float | None
    interval: tuple[float, float] | None
    mean_weight: float
    weight_error: float | None
    effective: float


@dataclasses.dataclass(frozen=True, repr=False)
class Importance(Tabular):
    """Estimates of a policy's return from the data of others, the most reliable first, and their weights.

    Attributes:
        policy: the label of the target.
        results: an `Estimated` for each method.
        ratios: the density of each action under the target, divided by that under the behaviour,
            (episodes, steps).
        weights: the products w of the ratios from the start of the episode (episodes, steps).
        rewards: the discounted rewards (episodes, steps).
        effective: the effective number of episodes (Σw)²/Σw² at each step (steps,).
        discount: the discount factor.
        notes: warnings of what makes estimates doubtful, a line for each reason.
    """

    policy: str
    results: list[Estimated]
    ratios: Floats
    weights: Floats
    rewards: Floats
    effective: Floats
    discount: float
    notes: list[str]

    def tables(self) -> list[Table]:
        """The estimates, a row each."""
        episodes, steps = self.weights.shape
        said = f"policy: {self.policy}; discount: {self.discount:g}; {episodes:,} episodes of {steps:,} steps"
        return [Table(Estimated._fields, self.results, [said, *self.notes])]

    def plain(self) -> dict[str, Any]:
        """The estimates and notes as plain data."""
        results = [result._asdict() for result in self.results]
        return {"policy": self.policy, "discount": self.discount, "results": results, "notes": self.notes}


@public
def importance(
    ds: Place,
    target: Any,
    *,
    discount: float = 0.97,
    steps: int | None = None,
    split: str | Sequence[str] | None = None,
    history: int = 1,
    allow_code: bool = False,
) -> Importance:
    """Estimate the return of a policy from the data of other policies, by importance sampling.

    With w_t = Π_{k ≤ t} π(a_k)/β(a_k), the weight of step t, and T the last step, over the episodes:

        weighted       Σ_t γᵗ mean of w_t r_t / mean of w_t
        per decision   mean of Σ_t γᵗ w_t r_t
        ordinary       mean of w_T Σ_t γᵗ r_t

    The last two are unbiased, the first has a little bias and much less variance. Sources: Precup, Sutton
    and Singh 2000, Eligibility traces for off-policy policy evaluation; for the first, which is also known as
    consistent weighted per-decision importance sampling, Thomas 2015, Safe reinforcement learning.

    The densities of the behaviour, β, are the `action_log_prob` of the data, whose policies must be able to
    take every action of the target, and often enough for data of this size. That is tried: the target draws
    an action at each recorded observation, and the densities and point masses of both are compared there. The
    density of the target, π, is that of the recorded action, given the recorded observations and actions, and
    what the target remembers of them.

    Args:
        ds: the dataset, its folder or URL, or a selection of its episodes.
        target: the policy to be evaluated, as in `evaluate`; an object states its density by returning a
            `Distribution` from `decide` (the page "Custom policies").
        discount: the discount factor γ, in [0, 1].
        steps: only so many first steps of each episode; by default all.
        split: only episodes of this split, or of these.
        history: the number of observations that an object sees, if it has no `needs`.
        allow_code: whether custom policies, of the data or in a file, may run.

    Returns:
        The estimates, with the ratios, the weights and the effective number of episodes at each step.

    Raises:
        UsageError: a policy of the data never or hardly ever takes some actions of the target, a density is
            not known, episodes have different lengths or were chosen by their returns, or an argument is
            invalid.
        PolicyError: the target failed, or returned no valid density.
        DatasetError: a file is missing or damaged.
    """
    discount = checked_discount(discount)
    evaluated = as_policy(target, history, allow_code)
    selection = opened(ds).select(split)
    refuse_empty(selection)
    refuse_by_returns(selection)
    stored = selection.stored
    source = Replayable(stored, consented_spec(stored, allow_code))
    episodes = np.flatnonzero(selection.inside)
    steps = _horizon(steps, source.lengths[episodes])
    parts = list(parts_by_policy(source, episodes, steps))
    behaviours = {id(part.behaviour): part.behaviour for part in parts}
    ratios, rewards = Ratios(*np.empty((2, len(episodes), steps))), np.empty((len(episodes), steps))
    with loaded([evaluated, *behaviours.values()]) as [evaluated, *acting]:
        objects = [part for behaviour in acting for part in behaviour.everywhere(UserObject)]
        refuse_changed(stored.manifest.code, objects, stored.name)
        if not all(map(evaluated.is_same, acting)):
            refuse_remembered_draws(evaluated)
        ready = dict(zip(behaviours, acting, strict=True))
        for part in parts:
            positions, behaviour = part.positions, ready[id(part.behaviour)]
            recorded, rewards[positions], log_prob = recorded_in(source, episodes[positions], steps)
            of_part = log_ratios(part, behaviour, recorded, log_prob, evaluated, len(episodes) * steps)
            ratios.recorded[positions], ratios.drawn[positions] = of_part
    return of_ratios(evaluated.label, ratios, rewards, discount)


def _horizon(steps: int | None, lengths: Ints) -> int:
    """How many steps of each episode count."""
    shortest, longest = int(lengths.min()), int(lengths.max())
    if steps is None:
        if shortest < longest:
            raise UsageError(
                f"steps: found episodes of {shortest} and of {longest}, expected one length; or give "
                f"steps, at most {shortest}"
            )
        return shortest
    if not 1 <= steps <= shortest:
        raise UsageError(f"steps: found {steps}, expected a whole number from 1 to {shortest}")
    return steps


def of_ratios(label: str, ratios: Ratios, rewards: Floats, discount: float) -> Importance:
    """The estimates from the ratios and the rewards (episodes, steps)."""
    logs = np.cumsum(ratios.recorded, axis=1)
    greatest = logs.max(axis=0)
    with np.errstate(over="ignore"):
        weights = np.exp(logs)
    relative = np.exp(logs - np.where(np.isfinite(greatest), greatest, 0.0))  # of long episodes, not all 0
    paid = rewards * discount ** np.arange(rewards.shape[1])
    squares = (relative**2).sum(axis=0)
    effective = np.divide(relative.sum(axis=0) ** 2, squares, out=np.zeros(len(squares)), where=squares > 0.0)
    is_finite = bool(np.isfinite(weights).all())
    estimates = (
        _weighted(relative, paid),
        mean_estimate([(weights * paid).sum(axis=1)]) if is_finite else NONE,
        mean_estimate([weights[:, -1] * paid.sum(axis=1)]) if is_finite else NONE,
    )
    mean, error, _ = mean_estimate([weights[:, -1]]) if is_finite else (math.inf, None, None)
    results = [
        Estimated(method, *values, mean, error, float(effective[-1]))
        for method, values in zip(METHODS, estimates, strict=True)
    ]
    notes = [
        *([] if is_finite else [OVERFLOW]),
        *_notes_on_effective(effective),
        *notes_on_mean_weights(ratios, weights),
        *_notes_on_distance(*results),
    ]
    return Importance(label, results, np.exp(ratios.recorded), weights, paid, effective, discount, notes)


def _notes_on_effective(effective: Floats) -> Iterator[str]:
    if not effective[-1]:
        yield (
            f"warning: all weights are 0 from step {int((effective == 0.0).argmax())} on, so there is no "
            "weighted estimate, the ordinary one is 0, and the one per decision leaves out the rewards from "
            "there on"
        )
    elif effective[-1] < LEAST_EFFECTIVE:
        yield (
            f"warning: weighted rests on {effective[-1]:,.1f} effective episodes, fewer than "
            f"{LEAST_EFFECTIVE:g}; trust neither its estimate nor its interval"
        )


def _notes_on_distance(weighted: Estimated, *others: Estimated) -> Iterator[str]:
    """A warning for each estimate far from the weighted one, on which the mean weight has less influence."""
    for other in others:
        if weighted.mean_return is None or other.mean_return is None or other.standard_error is None:
            continue
        distance = abs(other.mean_return - weighted.mean_return)
        is_far = distance > FARTHEST * other.standard_error
        if is_far and not math.isclose(other.mean_return, weighted.mean_return):  # of equal returns
            errors = other.standard_error and f"{distance / other.standard_error:.3g}"
            yield (
                f"warning: {other.method} is {errors or 'infinitely many'} of its standard errors from "
                f"weighted, more than {FARTHEST:g}; trust neither its estimate nor its interval"
            )


def _weighted(weights: Floats, paid: Floats) -> tuple[float | None, float | None, tuple[float, float] | None]:
    """The weighted estimate, from weights up to a factor. The error is that of the delta method."""
    means = weights.mean(axis=0)
    if not means.all():
        return None, None, None
    shares = weights / means
    expected = (shares * paid).mean(axis=0)
    return mean_estimate([expected.sum() + (shares * (paid - expected)).sum(axis=1)])


def notes_on_mean_weights(ratios: Ratios, weights: Floats) -> list[str]:
    """A warning for the first step whose mean weight is not 1.

    Heavy tails make a mean fall short of 1 by many of its estimated errors, although nothing is wrong. So
    the test of the densities is of `without_large` weights, whose mean is 1 too. If they pass it, the weights
    themselves tell whether the data lack episodes.
    """
    if len(weights) < FEWEST:
        return []
    kept, large = without_large(ratios)
    if far := _first_far(kept + large, WRONG):
        return [f"{far[1]}, further from 1 than chance allows: one of the densities is wrong"]
    if far := _first_far(weights, LACKING):
        step, place = far
        return [
            f"{place}, more than {LACKING:g} errors from 1; weighted may miss episodes too rare for these "
            f"data, from which {min(large[:, step].mean(), 1.0):.0%} of the expectation comes"
        ]
    return []


def _first_far(weights: Floats, errors: float) -> tuple[int, str] | None:
    """The first step whose mean weight is more than so many errors from 1, and how a warning of it begins."""
    with np.errstate(invalid="ignore"):  # of weights that are infinite
        mean, error = weights.mean(axis=0), weights.std(axis=0, ddof=1) / np.sqrt(len(weights))
    far = np.abs(mean - 1.0) > errors * error + TOLERANCE
    if not far.any():
        return None
    step = int(far.argmax())
    return step, f"warning: the mean weight of step {step} is {mean[step]:.3g} ± {error[step]:.2g}"


def without_large(ratios: Ratios) -> tuple[Floats, Floats]:
    """Weights without the large ones, and the weights that large ones would have added, (n, steps) each.

    An episode ends where its weight gets large, so its later weights are 0. How much that takes away from the
    mean is known without the rare episodes in which it happens: it is the weight of the step before, times
    the probability that the target's action makes it large. One drawn action estimates that without bias. So
    the mean of the sum of both is 1, and its terms are bounded.
    """
    log_largest = math.log(LARGE * max(len(ratios.recorded), 500))
    kept, large = np.empty_like(ratios.recorded), np.empty_like(ratios.recorded)
    log_weight, added = np.zeros(len(kept)), np.zeros(len(kept))
    for t in range(kept.shape[1]):
        added = added + np.where(log_weight + ratios.drawn[:, t] > log_largest, np.exp(log_weight), 0.0)
        log_weight = log_weight + ratios.recorded[:, t]
        log_weight[log_weight > log_largest] = -np.inf
        kept[:, t], large[:, t] = np.exp(log_weight), added
    return kept, large
