"""Checks to be called in the tests of a policy."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.evaluation.policies import policy_of
from ibdata.policies import OBSERVATION, Policy
from ibdata.policies.actions import applied
from ibdata.policies.base import Floats, History
from ibdata.policies.checked import CheckedPolicy

ROWS = 256
REPEATS = 2000  # draws at one history, to compare the share of each action with its probability
CERTAIN = 6.0  # standard errors


def check_policy(policy: Any, histories: History | None = None, history: int = 1) -> None:
    """Check that a policy returns valid actions and densities and is a pure function.

    The checks are:

    - Actions are finite numbers of shape (n, 3).
    - The same inputs give the same outputs: in a batch, alone, and in a second call.
    - Neither the inputs nor the arrays that earlier calls returned are changed.
    - Log densities are float64 (n,): finite at the policy's own actions, or NaN everywhere; never +inf.
    - If an action is drawn repeatedly, its share of the draws agrees with its probability.

    Args:
        policy: a `Policy`, or anything else that `ibdata.evaluate` takes.
        histories: observations to check it on, float32 (n, history_length, 6); by default 256 random ones.
        history: the number of observations passed to an object without `history_length`.

    Raises:
        AssertionError: a check failed; the message says which.
        PolicyError: the policy raised an exception, or returned no numbers of the right shape.
    """
    policy = policy_of(policy, history)
    histories = _histories(policy.history_length) if histories is None else histories
    u = _draws(len(histories), policy.uniforms_per_step)
    actions = _check_actions(policy, histories, u)
    _check_densities(policy, histories, actions)
    for row in range(0, len(histories), max(1, len(histories) // 8)):
        _check_atoms(policy, histories[row : row + 1])


def _histories(length: int) -> History:
    """Random observations, float32 (256, length, 6); a quarter of them are at the bounds or in the middle."""
    random = np.random.default_rng(0)
    history = random.uniform(0.0, 100.0, (ROWS, length, len(OBSERVATION)))
    history[::4] = np.round(history[::4] / 50.0) * 50.0
    return history.astype(np.float32)


def _draws(n: int, count: int) -> Floats:
    """Uniform numbers (n, count), some replaced by the smallest or the largest possible one."""
    u = np.random.default_rng(0).random((n, count))
    few, many = u[: n // 4], u[n // 4 : n // 2]
    few[few < 0.5], many[many > 0.5] = 2.0**-53, 1.0 - 2.0**-53
    return u


def _act(policy: Policy, history: History, u: Floats) -> npt.NDArray[np.float32]:
    """The actions, clipped and rounded, float32 (n, 3)."""
    out = np.empty((len(history), 3), dtype=np.float32)
    CheckedPolicy(policy, policy.label, 0, len(history)).act(history.copy(), u.copy(), out, 0)
    return out


def _log_prob(policy: Policy, history: History, action: npt.NDArray[np.float32]) -> Floats:
    return CheckedPolicy(policy, policy.label, 0, len(history)).log_prob(history.copy(), action.copy(), 0)


def _check_actions(policy: Policy, history: History, u: Floats) -> npt.NDArray[np.float32]:
    actions = _act(policy, history, u)
    seen, drawn = history.copy(), u.copy()
    answer = np.asarray(policy.act(seen, drawn))
    kept = answer.copy()
    _act(policy, history[::-1].copy(), 1.0 - u)
    assert _same(seen, history), "act changed the history that it was given"
    assert _same(drawn, u), "act changed the random numbers that it was given"
    assert _same(answer, kept), "a later call of act changed the array that an earlier one returned"
    assert _same(_act(policy, history, u), actions), "act gave other actions for the same inputs"
    for i in range(len(history)):
        alone = _act(policy, history[i : i + 1], u[i : i + 1])
        assert _same(alone[0], actions[i]), f"act gave {actions[i]} in a batch, {alone[0]} alone, at row {i}"
    return actions


def _check_densities(policy: Policy, history: History, action: npt.NDArray[np.float32]) -> None:
    seen, given = history.copy(), action.copy()
    assert np.asarray(policy.log_prob(seen, given)).dtype == np.float64, "log_prob must return float64"
    density = _log_prob(policy, history, action)
    assert _same(seen, history), "log_prob changed the history that it was given"
    assert _same(given, action), "log_prob changed the actions that it was given"
    unknown = np.isnan(density).all()
    assert unknown or np.isfinite(density).all(), "log_prob must be finite at the policy's own actions"
    assert _same(_log_prob(policy, history, action), density), "log_prob gave other values for equal inputs"
    for i in range(len(history)):
        alone = _log_prob(policy, history[i : i + 1], action[i : i + 1])[0]
        assert _same(alone, density[i]), f"log_prob gave {density[i]} in a batch, {alone} alone, at row {i}"
    others = applied(np.random.default_rng(1).uniform(-1.25, 1.25, action.shape))
    elsewhere = _log_prob(policy, history, others)
    wrong = ~np.isnan(elsewhere) if unknown else ~(elsewhere < np.inf)
    expected = "nan, as at the policy's own actions" if unknown else "a number below inf"
    assert not wrong.any(), f"log_prob is {elsewhere[wrong][:1]} at {others[wrong][:1]}, expected {expected}"


def _check_atoms(policy: Policy, one: History) -> None:
    """Compare the share of each repeated action with the probability that `log_prob` gives it."""
    u = np.random.default_rng(2).random((REPEATS, policy.uniforms_per_step))
    actions, counts = np.unique(_act(policy, np.repeat(one, REPEATS, axis=0), u), axis=0, return_counts=True)
    actions, shares = actions[counts > REPEATS // 100], counts[counts > REPEATS // 100] / REPEATS
    said = np.exp(_log_prob(policy, np.repeat(one, len(actions), axis=0), actions))
    error = CERTAIN * np.sqrt(shares * (1.0 - shares) / REPEATS) + 1e-6
    wrong = np.abs(said - shares) > error  # False where the density is NaN
    assert not wrong.any(), (
        f"log_prob gives {actions[wrong][0]} the probability {said[wrong][0]:.4f}, but its share of "
        f"{REPEATS} draws was {shares[wrong][0]:.4f}"
    )


def _same(a: npt.ArrayLike, b: npt.ArrayLike) -> bool:
    return np.array_equal(np.asarray(a), np.asarray(b), equal_nan=True)
