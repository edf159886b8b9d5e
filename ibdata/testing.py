"""Checks to be called in the tests of a policy."""

from __future__ import annotations

from operator import itemgetter
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.arguments import public
from ibdata.evaluation.policies import Acting, loaded, policy_of
from ibdata.policies import Observed, Policy, purity
from ibdata.policies.actions import applied
from ibdata.policies.base import Float32s, Floats
from ibdata.policies.checked import Checked
from ibdata.policies.custom import Custom
from ibdata.policies.user_object import UserObject

ROWS = 256
LATER = 5  # a step at which the policy is checked again
REPEATS = 2000  # draws in one situation, to compare the share of each action with its probability
CERTAIN = 6.0  # standard errors


@public
def check_policy(policy: Any, histories: Float32s | None = None, history: int = 1) -> None:
    """Check that a policy returns valid actions and densities and is a pure function.

    The checks are:

    - Actions are finite numbers of shape (n, 3); the memory has the shape (n, memory).
    - The same inputs give the same outputs: asked again, in another order, and without half of the episodes.
      The last bits of an object's actions may differ where the episodes are others.
    - Neither the inputs nor the arrays that earlier calls returned are changed.
    - Log densities are float64 (n,): finite at the policy's own actions, or NaN everywhere; never +inf. In a
      policy that is made of others, they may be NaN in some episodes.
    - If an action is drawn repeatedly, its share of the draws agrees with its probability.

    A policy is checked at the first step of 256 episodes and, unless it must be asked in order, at the sixth.
    `generate` and `evaluate` make the second check before they run code of a user. As they do, it says on
    stderr if a model has no environment, or if more than 20 % of an object's numbers are clipped.

    Args:
        policy: a `Policy`, or anything else that `ibdata.evaluate` takes.
        histories: observations to check it on, float32 (n, history, 6); by default 256 random ones.
        history: the number of observations passed to an object without `needs`.

    Raises:
        AssertionError: a check failed; the message says which.
        PolicyError: the policy is not pure, raised an exception, or returned no numbers of the right shape.
    """
    policy = policy_of(policy, history)
    with loaded([policy]):
        if not isinstance(policy, Acting | Custom):  # of which `loaded` makes sure
            purity.refuse_impure(policy)
        seen = purity.histories(ROWS, policy.needs.history) if histories is None else histories
        in_order = any(isinstance(each, UserObject) and each.remembers for each in policy.everywhere())
        for given, actions in list(purity.played(policy, seen, 1 if in_order else LATER + 1))[::LATER]:
            _check_decision(policy, given)
            _check_density(policy, given, actions)
            for row in range(0, len(seen), max(1, len(seen) // 8)):
                _check_atoms(policy, given.apply(itemgetter(slice(row, row + 1))))


def _check_decision(policy: Policy, given: Observed) -> None:
    if any(isinstance(each, Acting | Custom) for each in policy.everywhere()):
        return  # an object gets copies, and returns them
    seen = given.apply(np.copy)
    answer = [np.asarray(x) for x in policy.decide(seen)]
    kept = [x.copy() for x in answer]
    _refuse_changes("decide", given, seen)
    policy.decide(seen._replace(uniforms=1.0 - seen.uniforms))
    assert all(map(_same, answer, kept)), (
        "a later call of decide changed an array that an earlier one returned"
    )


def _refuse_changes(name: str, given: Observed, seen: Observed) -> None:
    """Raise AssertionError if a copy of what a policy is given is no longer equal to it."""
    for field in Observed._fields:
        same = _same(getattr(given, field), getattr(seen, field))
        assert same, f"{name} changed the {field} that it was given"


def _check_density(policy: Policy, given: Observed, action: Float32s) -> None:
    seen, same_action = given.apply(np.copy), action.copy()
    density = np.asarray(policy.log_density(seen, same_action))
    assert density.dtype == np.float64, f"log_density must return float64, found {density.dtype}"
    _refuse_changes("log_density", given, seen)
    assert _same(same_action, action), "log_density changed the actions that it was given"
    _check_values(policy, given, action, density)
    half = _log_density(policy, given.apply(lambda x: x[::2]), action[::2])
    assert np.allclose(half, density[::2], 1e-6, 1e-6, True), "log_density depends on the other episodes"
    other_draws = given._replace(uniforms=1.0 - given.uniforms)
    same = _same(_log_density(policy, other_draws, action), density)
    assert same, "log_density depends on the random numbers of its own step"


def _check_values(policy: Policy, given: Observed, action: Float32s, density: Floats) -> None:
    """Check the values at a policy's own actions and elsewhere."""
    at_once = policy.decide_with_density(given.apply(np.copy))[1]
    same = at_once is None or _same(at_once, density)
    assert same, "decide_with_density gave other densities than log_density"
    unknown, known = np.isnan(density), np.isfinite(density)
    valid = unknown.all() or known.all() or (bool(policy.inner) and (known | unknown).all())
    assert valid, "log_density must be finite at the policy's own actions"
    others = applied(np.random.default_rng(1).uniform(-1.25, 1.25, action.shape))
    elsewhere = _log_density(policy, given, others)
    wrong = np.where(unknown, ~np.isnan(elsewhere), ~(elsewhere < np.inf))
    expected = "a number below inf, or nan as at the policy's own action"
    assert not wrong.any(), (
        f"log_density is {elsewhere[wrong][:1]} at {others[wrong][:1]}, expected {expected}"
    )


def _check_atoms(policy: Policy, one: Observed) -> None:
    """Compare the share of each repeated action with the probability that its log density gives it."""
    u = np.random.default_rng(2).random((REPEATS, one.uniforms.shape[1]))
    many = one.apply(lambda x: np.repeat(x, REPEATS, axis=0))._replace(uniforms=u)
    actions, counts = np.unique(purity.decided(policy, many)[0], axis=0, return_counts=True)
    actions, shares = actions[counts > REPEATS // 100], counts[counts > REPEATS // 100] / REPEATS
    if not len(actions):
        return
    stated = np.exp(_log_density(policy, many.apply(lambda x: x[: len(actions)]), actions))
    error = CERTAIN * np.sqrt((shares * (1.0 - shares) + 1.0 / REPEATS) / REPEATS)
    wrong = np.abs(stated - shares) > error  # False where the density is NaN
    assert not wrong.any(), (
        f"log_density gives {actions[wrong][0]} the probability {stated[wrong][0]:.4f}, but its share of "
        f"{REPEATS} draws was {shares[wrong][0]:.4f}"
    )


def _log_density(policy: Policy, given: Observed, action: Float32s) -> Floats:
    checked = Checked(policy, policy.label, np.empty(0, dtype=np.int64))
    return checked.log_density(given.apply(np.copy), action.copy())


def _same(a: npt.ArrayLike, b: npt.ArrayLike) -> bool:
    return np.array_equal(np.asarray(a), np.asarray(b), equal_nan=True)
