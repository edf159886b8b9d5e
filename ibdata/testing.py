"""Checks to be called in the tests of a policy."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.evaluation.policies import loaded, policy_of
from ibdata.policies import OBSERVATION, Policy
from ibdata.policies.actions import applied
from ibdata.policies.adapter import Adapter
from ibdata.policies.base import Floats, History
from ibdata.policies.checked import CheckedPolicy
from ibdata.policies.given import Given

ROWS = 256
LATER = 5  # a step at which a policy that depends on earlier ones is checked again
REPEATS = 2000  # draws at one history, to compare the share of each action with its probability
CERTAIN = 6.0  # standard errors
WORDS = {"observations": "history", "uniforms": "random numbers"}  # of the short forms, act and log_prob


def check_policy(policy: Any, histories: History | None = None, history: int = 1) -> None:
    """Check that a policy returns valid actions and densities and is a pure function.

    The checks are:

    - Actions are finite numbers of shape (n, 3); the memory has the shape (n, memory_size).
    - The same inputs give the same outputs: in a batch, alone, in a second call, and after other episodes.
    - Neither the inputs nor the arrays that earlier calls returned are changed.
    - Log densities are float64 (n,): finite at the policy's own actions, or NaN everywhere; never +inf. In a
      policy that is made of others, they may be NaN in some episodes.
    - If an action is drawn repeatedly, its share of the draws agrees with its probability.

    A policy that may depend on earlier steps is checked at the first step of 256 episodes and at the sixth.
    An object with `reset`, or with a `predict` that takes a state, is checked at the first step.

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
    with loaded([policy]):
        for given in _questions(policy, histories):
            actions = _check_decisions(policy, given)
            _check_densities(policy, given, actions)
            for row in range(0, len(histories), max(1, len(histories) // 8)):
                _check_atoms(policy, _rows(given, [row]))
        _check_order(policy, histories)


def _histories(length: int) -> History:
    """Random observations, float32 (256, length, 6); a quarter of them are at the bounds or in the middle."""
    random = np.random.default_rng(0)
    history = random.uniform(0.0, 100.0, (ROWS, length, len(OBSERVATION)))
    history[::4] = np.round(history[::4] / 50.0) * 50.0
    return history.astype(np.float32)


def _draws(n: int, count: int, seed: int = 0) -> Floats:
    """Uniform numbers (n, count), some replaced by the smallest or the largest possible one."""
    u = np.random.default_rng(seed).random((n, count))
    few, many = u[: n // 4], u[n // 4 : n // 2]
    few[few < 0.5], many[many > 0.5] = 2.0**-53, 1.0 - 2.0**-53
    return u


def _questions(policy: Policy, histories: History) -> Iterator[Given]:
    """What the policy is given at step 0 and, if it may depend on earlier steps, at a later step.

    An object that remembers more than its memory can be asked in any order at step 0 only.
    """
    by_block = any(isinstance(each, Adapter) and each.way.may_remember for each in policy.everywhere())
    played = _played(policy, histories, 1 if policy.is_short or by_block else LATER + 1)
    yield from (given for given, _ in played if given.step[0] in (0, LATER))


def _played(
    policy: Policy, histories: History, steps: int, seed: int = 0
) -> Iterator[tuple[Given, npt.NDArray[np.float32]]]:
    """Yield what the policy is given at each step of episodes, and its actions. The histories are rotated."""
    n, length = histories.shape[:2]
    done, memory = np.zeros((n, length, 3), np.float32), np.zeros((n, policy.memory_size))
    drawn = _draws(n, policy.uniforms_per_episode, 10 * seed + 1)
    for t in range(steps):
        u = _draws(n, policy.uniforms_per_step, 10 * (seed + t))
        given = Given(np.roll(histories, t, axis=0), done, np.full(n, t), u, drawn, memory)
        actions, memory = _decided(policy, given)
        yield given, actions
        done = np.concatenate([actions[:, None], done], axis=1)[:, :length]


def _rows(given: Given, rows: Any) -> Given:
    return given.apply(lambda x: x[rows])


def _copy(given: Given) -> Given:
    return given.apply(np.copy)


def _decided(policy: Policy, given: Given) -> tuple[npt.NDArray[np.float32], Floats]:
    """The actions, clipped and rounded, float32 (n, 3), and the memory."""
    n = len(given.step)
    out = np.empty((n, 3), dtype=np.float32)
    _, memory = CheckedPolicy(policy, policy.label, 0, n).decide(_copy(given), out)
    return out, memory.copy()


def _log_density(policy: Policy, given: Given, action: npt.NDArray[np.float32]) -> Floats:
    checked = CheckedPolicy(policy, policy.label, 0, len(action))
    return checked.log_density(_copy(given), action.copy())


def _check_decisions(policy: Policy, given: Given) -> npt.NDArray[np.float32]:
    act = "act" if type(policy).decide is Policy.decide else "decide"
    actions, memory = _decided(policy, given)  # first, because it tells what a policy answers wrongly
    seen = _copy(given)
    answer = [np.asarray(x) for x in policy.decide(seen)]
    kept = [x.copy() for x in answer]
    _refuse_changes(act, given, seen)
    _decided(policy, _rows(given, slice(None, None, -1))._replace(uniforms=1.0 - given.uniforms))
    assert all(map(_same, answer, kept)), (
        f"a later call of {act} changed the array that an earlier one returned"
    )
    again, remembered = _decided(policy, given)
    assert _same(again, actions), f"{act} gave other actions for the same inputs"
    assert _same(remembered, memory), f"{act} gave another memory for the same inputs"
    for i in range(len(actions)):
        alone, own = _decided(policy, _rows(given, [i]))
        found = f"{act} gave {actions[i]} in a batch, {alone[0]} alone, at row {i}"
        assert _same(alone[0], actions[i]), found
        assert _same(own[0], memory[i]), f"{act} gave another memory in a batch than alone, at row {i}"
    return actions


def _refuse_changes(act: str, given: Given, seen: Given) -> None:
    """Raise AssertionError if a copy of what a policy is given is no longer equal to it."""
    for name in Given._fields:
        what = WORDS.get(name, name) if act in ("act", "log_prob") else name
        assert _same(getattr(given, name), getattr(seen, name)), f"{act} changed the {what} that it was given"


def _check_densities(policy: Policy, given: Given, action: npt.NDArray[np.float32]) -> None:
    log_prob = "log_prob" if type(policy).log_density is Policy.log_density else "log_density"
    seen, taken = _copy(given), action.copy()
    found = np.asarray(policy.log_density(seen, taken)).dtype
    assert found == np.float64, f"{log_prob} must return float64"
    density = _log_density(policy, given, action)
    _refuse_changes(log_prob, given, seen)
    at_once = policy.decide_with_density(_copy(given))[1]
    same = at_once is None or _same(at_once, density)
    assert same, f"decide_with_density gave other densities than {log_prob}"
    assert _same(taken, action), f"{log_prob} changed the actions that it was given"
    unknown = np.isnan(density)
    known = np.isfinite(density)
    valid = unknown.all() or known.all() or (bool(policy.inner) and (known | unknown).all())
    assert valid, f"{log_prob} must be finite at the policy's own actions"
    same = _same(_log_density(policy, given, action), density)
    assert same, f"{log_prob} gave other values for equal inputs"
    other_draws = given._replace(uniforms=1.0 - given.uniforms)
    same = _same(_log_density(policy, other_draws, action), density)
    assert same, f"{log_prob} depends on the random numbers of its own step"
    for i in range(len(action)):
        alone = _log_density(policy, _rows(given, [i]), action[i : i + 1])[0]
        text = f"{log_prob} gave {density[i]} in a batch, {alone} alone, at row {i}"
        assert _same(alone, density[i]), text
    others = applied(np.random.default_rng(1).uniform(-1.25, 1.25, action.shape))
    elsewhere = _log_density(policy, given, others)
    wrong = np.where(unknown, ~np.isnan(elsewhere), ~(elsewhere < np.inf))
    expected = "a number below inf, or nan as at the policy's own action"
    text = f"{log_prob} is {elsewhere[wrong][:1]} at {others[wrong][:1]}, expected {expected}"
    assert not wrong.any(), text


def _check_atoms(policy: Policy, one: Given) -> None:
    """Compare the share of each repeated action with the probability that its log density gives it."""
    u = np.random.default_rng(2).random((REPEATS, policy.uniforms_per_step))
    many = _rows(one, np.zeros(REPEATS, dtype=np.int64))._replace(uniforms=u)
    actions, counts = np.unique(_decided(policy, many)[0], axis=0, return_counts=True)
    actions, shares = actions[counts > REPEATS // 100], counts[counts > REPEATS // 100] / REPEATS
    if not len(actions):
        return
    said = np.exp(_log_density(policy, _rows(many, slice(len(actions))), actions))
    error = CERTAIN * np.sqrt((shares * (1.0 - shares) + 1.0 / REPEATS) / REPEATS)
    wrong = np.abs(said - shares) > error  # False where the density is NaN
    assert not wrong.any(), (
        f"log_prob gives {actions[wrong][0]} the probability {said[wrong][0]:.4f}, but its share of "
        f"{REPEATS} draws was {shares[wrong][0]:.4f}"
    )


def _check_order(policy: Policy, histories: History) -> None:
    """Compare episodes before and after others, which must leave no trace."""
    few = histories[:8]
    before = [actions for _, actions in _played(policy, few, LATER + 1)]
    list(_played(policy, few[::-1].copy(), LATER, seed=1))
    after = [actions for _, actions in _played(policy, few, LATER + 1)]
    same = all(map(_same, before, after))
    assert same, "decide gave other actions in episodes after others than before them"


def _same(a: npt.ArrayLike, b: npt.ArrayLike) -> bool:
    return np.array_equal(np.asarray(a), np.asarray(b), equal_nan=True)
