"""Checks to be called in the tests of a policy."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from operator import itemgetter
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import public
from ibdata._numerics.arrays import Float32s, Floats
from ibdata.errors import PolicyError, UsageError
from ibdata.evaluation.policies import as_policy, loaded
from ibdata.policies import OBSERVATION, Observed, Policy, checked
from ibdata.policies.checked import AnswerError, ask, raise_placed
from ibdata.policies.compound import is_foreign
from ibdata.policies.distributions import Distribution, applied
from ibdata.policies.user_object import UserObject

ROWS = 256
LATER = 5  # a step at which the policy is checked again
DRAWS = 20_000  # in one situation, to compare the shares of actions with their probabilities
FEW = 100  # draws, below which a share says little
CERTAIN = 6.0  # standard errors
FREE = np.float32(2.0)  # in a pattern of actions, in place of a number that is not drawn again and again
# Which numbers of draws move, there and back, in turn; and how far, in widths of the middle half.
ALONE = np.eye(3)
TOGETHER = np.array([(1, 1, 0), (1, -1, 0), (1, 0, 1), (1, 0, -1), (0, 1, 1), (0, 1, -1)]) / np.sqrt(2.0)
STEP = 0.75
POINTS = 5_000  # at which a density is integrated over a box

# Actions (n, 3) -> the distribution in one situation, n times
OfPoints = Callable[[Float32s], Distribution]


@public
def check_policy(
    policy: Any, histories: Float32s | None = None, history: int = 1, allow_code: bool = False
) -> None:
    """Check that a policy returns valid actions and densities and is a pure function.

    The checks are:

    - Actions are finite numbers of shape (n, 3); the memory has the shape (n, memory).
    - The same inputs give the same outputs: asked again, and for half of the episodes in another order.
      The last bits of an object's actions may differ where the episodes are others.
    - Neither the inputs nor the arrays that earlier calls returned are changed.
    - Log densities are numbers (n,): finite at the policy's own actions, or NaN everywhere; never +inf. In a
      policy that is made of others, they may be NaN in some episodes. They do not depend on the step's draws.
    - Where a density is known, 20,000 actions are drawn in each of 8 situations. The share of each action
      that is drawn again and again is the probability that the density gives it. Of the other actions, those
      with the same numbers at ±1 or at another repeated value are one group; the share of a box in the middle
      of a group is the integral of the density over it. If draws moved to and fro as the density says, as
      many would leave the middle as come back. `atoms` is true for repeated numbers and no others.

    A policy is checked at the first step of 256 episodes and, unless it must be asked in order, at the sixth.
    `generate` and `evaluate` make the second check before they run code of a user. As they do, it says on
    stderr if a model has no environment, or if more than 20 % of an object's numbers are clipped.

    Args:
        policy: a `Policy`, or anything else that `ibdata.evaluate` takes.
        histories: observations to check it on, newest first, (n, history, 6), at least as many as it needs;
            by default 256 random ones.
        history: the number of observations passed to an object without `needs`.
        allow_code: whether a custom policy that a file names may run.

    Raises:
        UsageError: an argument is invalid, or code would run that is not allowed.
        AssertionError: a check failed; the message says which.
        PolicyError: the policy is not pure, raised an exception, or returned no numbers of the right shape.
    """
    if not (isinstance(policy, Policy) and is_foreign(policy)):  # whose own answers are checked, not copies
        policy = as_policy(policy, history, allow_code)
    with loaded([policy]) as [policy]:
        has_objects = any(policy.everywhere(UserObject))  # of which `loaded` has made sure
        if is_foreign(policy) or not has_objects:
            checked.refuse_impure(policy, exact=not has_objects)
        needed = policy.needs.history
        seen = checked.histories(ROWS, needed) if histories is None else _given(histories, needed)
        in_order = any(part.adapter.remembers for part in policy.everywhere(UserObject))
        for observed, actions in list(checked.played(policy, seen, 1 if in_order else LATER + 1))[::LATER]:
            try:
                _check_decision(policy, observed)
                _check_density(policy, observed, actions)
                for i, row in enumerate(range(0, len(seen), max(1, len(seen) // 8))):
                    directions = (ALONE[i % len(ALONE)], TOGETHER[i % len(TOGETHER)])
                    _check_frequencies(policy, observed.apply(itemgetter(slice(row, row + 1))), directions)
            except AnswerError as error:
                raise PolicyError(f"policy {policy.label}: {error}") from error


def _given(histories: Float32s, needed: int) -> Float32s:
    """The newest observations that a policy needs, of histories that a user gave."""
    shape = histories.shape
    if len(shape) != 3 or not len(histories) or shape[1] < needed or shape[2] != len(OBSERVATION):
        raise UsageError(f"histories: found shape {shape}, expected (n, {needed}, 6), as many as it needs")
    return np.ascontiguousarray(histories[:, :needed], dtype=np.float32)


def _distribution(policy: Policy, observed: Observed) -> tuple[Distribution, Floats]:
    try:
        return ask(policy, observed)
    except BaseException as error:
        raise_placed(error, policy.label, observed)


def _check_decision(policy: Policy, observed: Observed) -> None:
    if any(policy.everywhere(UserObject)):
        return  # an object gets copies, and returns them
    seen = observed.apply(np.copy)
    distribution, memory = _distribution(policy, seen)
    for field in Observed._fields:
        same = _same(getattr(observed, field), getattr(seen, field))
        assert same, f"decide changed the {field} that it was given"
    sample, kept = np.array(distribution.sample(observed.draws)), memory.copy()
    _distribution(policy, seen._replace(draws=1.0 - seen.draws))
    later = "a later call of decide changed an array that an earlier one returned"
    assert _same(distribution.sample(observed.draws), sample), later
    assert _same(memory, kept), later


def _check_density(policy: Policy, observed: Observed, action: Float32s) -> None:
    distribution, _ = _distribution(policy, observed.apply(np.copy))
    same_action = action.copy()
    density = distribution.log_density(same_action)
    assert _same(same_action, action), "log_density changed the actions that it was given"
    _check_values(policy, distribution, action, density)
    half, _ = _distribution(policy, observed.apply(lambda x: x[::2].copy()))
    same = np.allclose(half.log_density(action[::2]), density[::2], 1e-6, 1e-6, True)
    assert same, "log_density depends on the other episodes"
    other, _ = _distribution(policy, observed._replace(draws=1.0 - observed.draws))
    same = _same(other.log_density(action), density)
    assert same, "the distribution depends on the random numbers of its own step"


def _check_values(policy: Policy, distribution: Distribution, action: Float32s, density: Floats) -> None:
    """Check the values at a policy's own actions and elsewhere."""
    unknown, known = np.isnan(density), np.isfinite(density)
    valid = unknown.all() or known.all() or (bool(policy.inner) and (known | unknown).all())
    assert valid, "log_density must be finite at the policy's own actions"
    others = applied(np.random.default_rng(1).uniform(-1.25, 1.25, action.shape))
    elsewhere = distribution.log_density(others)
    wrong = np.where(unknown, ~np.isnan(elsewhere), ~(elsewhere < np.inf))
    expected = "a number below inf, or nan as at the policy's own action"
    assert not wrong.any(), (
        f"log_density is {elsewhere[wrong][:1]} at {others[wrong][:1]}, expected {expected}"
    )


def _check_frequencies(policy: Policy, one: Observed, directions: Sequence[Floats]) -> None:
    """Compare shares of many draws in one situation with the probabilities that the density gives them."""
    if np.isnan(_distribution(policy, one)[0].log_density(checked.decided(policy, one)[0])).any():
        return  # no density is known

    u = np.random.default_rng(2).random((DRAWS, one.draws.shape[1]))
    many = one.apply(lambda x: np.repeat(x, DRAWS, axis=0))._replace(draws=u)
    actions, _ = checked.decided(policy, many)

    def distribution(points: Float32s) -> Distribution:
        return _distribution(policy, many.apply(lambda x: x[: len(points)].copy()))[0]

    repeats = np.column_stack([_repeats(number) for number in actions.T])
    patterns, pattern_of, counts = np.unique(
        np.where(repeats, actions, FREE), axis=0, return_inverse=True, return_counts=True
    )
    is_whole, is_often = (patterns != FREE).all(axis=1), counts > FEW
    if (is_whole & is_often).any():
        which = is_whole & is_often
        _check_whole(patterns[which], counts[which] / DRAWS, distribution)
    for pattern in np.flatnonzero(~is_whole & is_often):
        _check_box(actions, pattern_of.ravel() == pattern, patterns[pattern], distribution)
    free = ~repeats & (np.abs(actions) < 1.0)
    of_all = distribution(actions)
    for direction in directions:
        _check_balance(of_all, actions, free, direction)


def _check_balance(
    distribution: Distribution, actions: Float32s, free: npt.NDArray[np.bool_], direction: Floats
) -> None:
    """Compare how many draws would move away from the middle and back, if they moved as the density says.

    With the density p of the draws, as many of them move from a to b = a + s as from b to a, where moves are
    accepted with the probability min(1, p(b)/p(a)) of Metropolis et al. 1953. Only `free` numbers move.
    """
    numbers = [x[is_free] if is_free.any() else x for x, is_free in zip(actions.T, free.T, strict=True)]
    low, middle, high = np.array([np.quantile(x, [0.25, 0.5, 0.75]) for x in numbers]).T
    width = np.where(high > low, high - low, 1.0)
    step = STEP * direction * free  # (n, 3), in widths
    place, far = ((actions - middle) / width * step).sum(axis=1), (step**2).sum(axis=1)
    there, back = (_accepted(distribution, actions, x * width) for x in (step, -step))
    for leave, enter, beyond in ((there, back, place), (back, there, -place)):
        out, home = leave * (beyond >= 0.0), enter * (beyond >= far)
        error = CERTAIN * np.sqrt(((out - home).var() + 1.0 / DRAWS) / DRAWS)
        assert abs((out - home).mean()) <= error, (
            f"log_density is not that of the draws: if they moved by ±{STEP * direction * width} as it says, "
            f"a share of {out.mean():.4f} would move away from the middle and {home.mean():.4f} back"
        )


def _accepted(distribution: Distribution, actions: Float32s, step: Floats) -> Floats:
    """The probabilities (n,) that draws (n, 3) move by a step (n, 3); 0 to and beyond ±1."""
    moved = (actions + step).astype(np.float32)
    inside = ((np.abs(moved) < 1.0) | (step == 0.0)).all(axis=1)
    before, after = map(distribution.log_density, (actions, np.clip(moved, -1.0, 1.0)))
    ratio = after - np.maximum(before, -1e300)
    return np.where(inside, np.exp(np.minimum(ratio, 0.0)), 0.0)


def _repeats(number: Float32s) -> npt.NDArray[np.bool_]:
    """Whether a number of an action, (n,), has a value that is drawn again and again."""
    _, value_of, counts = np.unique(number, return_inverse=True, return_counts=True)
    return np.asarray(counts[value_of] > FEW)


def _check_whole(whole: Float32s, shares: Floats, distribution: OfPoints) -> None:
    """Compare the shares of actions that are drawn again and again with their probabilities."""
    there = distribution(whole)
    stated = np.exp(there.log_density(whole))
    error = CERTAIN * np.sqrt((shares * (1.0 - shares) + 1.0 / DRAWS) / DRAWS)
    wrong = ~(np.abs(stated - shares) <= error)
    assert not wrong.any(), (
        f"log_density gives {whole[wrong][0]} the probability {stated[wrong][0]:.4f}, but its share of "
        f"{DRAWS} draws was {shares[wrong][0]:.4f}"
    )
    _check_atoms(there, whole, np.ones(3, dtype=np.bool_))


def _check_box(
    actions: Float32s, is_of_pattern: npt.NDArray[np.bool_], pattern: Float32s, distribution: OfPoints
) -> None:
    """Compare the share of a box with the integral of the density over it.

    In the actions of a pattern some numbers are fixed. The box has the middle half of each of the others, as
    the first half of the draws tells; the second half is counted.
    """
    first, second = actions[: DRAWS // 2], actions[DRAWS // 2 :]
    of_pattern = first[is_of_pattern[: DRAWS // 2]]
    free = pattern == FREE
    if len(of_pattern) < FEW:
        return
    low, high = np.quantile(of_pattern[:, free].astype(np.float64), [0.25, 0.75], axis=0)
    inside = ((second[:, free] > low) & (second[:, free] < high)).all(axis=1)
    share = (is_of_pattern[DRAWS // 2 :] & inside).mean()
    points = np.tile(pattern, (POINTS, 1))
    points[:, free] = np.random.default_rng(3).uniform(low, high, (POINTS, free.sum()))
    there = distribution(points)
    stated = np.prod(high - low) * np.exp(there.log_density(points))
    error = np.sqrt((share * (1.0 - share) + 1.0 / DRAWS) / len(second) + stated.var() / POINTS)
    box = [f"{a:.3g} to {b:.3g}" for a, b in zip(low, high, strict=True)]
    numbers = [box.pop(0) if is_free else f"{x:.3g}" for x, is_free in zip(pattern, free, strict=True)]
    assert abs(stated.mean() - share) <= CERTAIN * error, (
        f"log_density gives actions in [{', '.join(numbers)}] the probability {stated.mean():.4f}, but their "
        f"share of {len(second)} draws was {share:.4f}"
    )
    _check_atoms(there, points, ~free)


def _check_atoms(distribution: Distribution, actions: Float32s, expected: npt.NDArray[np.bool_]) -> None:
    """Compare `atoms` with which numbers of these actions are drawn again and again."""
    atoms = distribution.atoms(actions)
    wrong = (atoms != expected).any(axis=1)
    assert not wrong.any(), (
        f"atoms gives {atoms[wrong][0].tolist()} at {actions[wrong][0]}, expected {expected.tolist()}: true "
        "for each number that is drawn again and again, and for no other"
    )


def _same(a: npt.ArrayLike, b: npt.ArrayLike) -> bool:
    return np.array_equal(np.asarray(a), np.asarray(b), equal_nan=True)
