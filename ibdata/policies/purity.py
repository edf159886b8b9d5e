"""Whether a policy is a function of what it is given: checked before a run, and by `check_policy`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from ibdata.errors import PolicyError
from ibdata.policies.base import OBSERVATION, Float32s, Floats, Observed, Policy
from ibdata.policies.checked import act, ask, raise_placed

EPISODES, STEPS = 32, 2
NEAR = 1e-3  # of the actions of objects: their last bits may depend on the number of episodes
FLIPPED = 0.1  # share of the actions that may be others, such as those on the edge between two

DRAWS = "if it draws random numbers, write a class with act(history, u), which takes them from u"
SECRET = (
    f"found other actions when the same was asked again, expected equal ones; {DRAWS}; if it remembers, it "
    "must begin anew in reset(n)"
)
MIXED = (
    "found other actions for half of the episodes in another order, expected that the actions of an episode "
    f"depend on nothing in the others; {DRAWS}; parts such as BatchNorm must not train"
)


def refuse_impure(policy: Policy, columns: int = len(OBSERVATION), *, exact: bool) -> None:
    """Raise PolicyError for a policy whose actions depend on more than what it is given.

    It plays two steps of a few episodes, the same again, and half of them in another order. Where it need not
    be `exact`, as for the code of users, the last bits may depend on the other episodes.
    """
    history, everyone = histories(EPISODES, policy.needs.history, columns), np.arange(EPISODES)
    expected = _actions(policy, history, everyone)
    if not np.array_equal(_actions(policy, history, everyone), expected):
        raise PolicyError(f"policy {policy.label}: {SECRET}")
    near, flipped = (0.0, 0.0) if exact else (NEAR, FLIPPED)
    rows = everyone[-2::-2]
    far = np.abs(_actions(policy, history, rows) - expected[:, rows]).max(axis=2) > near
    if far.mean() > flipped:
        raise PolicyError(f"policy {policy.label}: {MIXED}")


def _actions(policy: Policy, history: Float32s, rows: npt.NDArray[np.int64]) -> Float32s:
    """The actions (steps, rows, 3) in some episodes."""
    return np.stack([actions for _, actions in played(policy, history, STEPS, rows)])


def played(
    policy: Policy, history: Float32s, steps: int, rows: npt.NDArray[np.int64] | None = None
) -> Iterator[tuple[Observed, Float32s]]:
    """Yield what a policy is given at each step of some episodes, and its actions, clipped and rounded.

    Episode i first sees row i of the history (n, history, columns), and at each step the row before.
    """
    rows, needs = np.arange(len(history)) if rows is None else rows, policy.needs
    actions_before = np.zeros((len(rows), needs.history, 3), dtype=np.float32)
    memory = np.zeros((len(rows), needs.memory))
    drawn = draws(len(history), needs.episode_draws, 1)[rows]
    for t in range(steps):
        u = draws(len(history), needs.draws, 10 * t)[rows]
        seen, step = np.roll(history, t, axis=0)[rows], np.full(len(rows), t)
        observed = Observed(seen, actions_before, step, u, drawn, memory)
        actions, memory = decided(policy, observed)
        yield observed, actions
        actions_before = np.concatenate([actions[:, None], actions_before], axis=1)[:, : needs.history]


def decided(policy: Policy, observed: Observed) -> tuple[Float32s, Floats]:
    """The actions of a policy, clipped and rounded, float32 (n, 3), and its memory (n, memory)."""
    given, out = observed.apply(np.copy), np.empty((len(observed.step), 3), dtype=np.float32)
    try:
        distribution, memory = ask(policy, given)
        act(distribution, given.draws, out)
    except BaseException as error:
        raise_placed(error, policy.label, observed)
    return out, memory.copy()


def histories(n: int, length: int, columns: int = len(OBSERVATION)) -> Float32s:
    """Random observations, float32 (n, length, columns); a quarter of them at the bounds or in the middle."""
    history = np.random.default_rng(0).uniform(0.0, 100.0, (n, length, columns))
    history[::4] = np.round(history[::4] / 50.0) * 50.0
    return history.astype(np.float32)


def draws(n: int, count: int, seed: int) -> Floats:
    """Uniform numbers (n, count), some replaced by the smallest or the largest possible one."""
    u = np.random.default_rng(seed).random((n, count))
    few, many = u[: n // 4], u[n // 4 : n // 2]
    few[few < 0.5], many[many > 0.5] = 2.0**-53, 1.0 - 2.0**-53
    return u
