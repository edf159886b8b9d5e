"""What a policy answers, checked; and whether it is a function of what it is given."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import suppress
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Bools, Float32s, Floats, Ints
from ibdata.errors import IbdataError, PolicyError, excerpt
from ibdata.policies.base import OBSERVATION, Observed, Policy, is_deterministic
from ibdata.policies.code import error_line
from ibdata.policies.distributions import (
    NUMBERED,
    Certain,
    Distribution,
    Unknown,
    clip_and_round,
    is_discrete,
    of_discrete,
    read_only,
)

NOBODY = np.empty(0, dtype=np.int64)  # the numbers of episodes that are made up


class AnswerError(Exception):
    """A policy returned no valid answer, or the code of a user failed. The message names no place."""

    def __init__(self, message: str, row: int = 0) -> None:
        super().__init__(message)
        self.row = row  # about which it was asked


def actions(answer: Any, n: int) -> Floats:
    """The actions (n, 3) of an answer, which may also be the discrete ones (n,) of the environment."""
    if _is_plain(answer, (n, 3)):
        return np.asarray(answer)
    answer = _plain(answer)
    with suppress(TypeError, ValueError):  # what is no array is refused below
        whole = np.asarray(answer)
        if is_discrete(whole) and len(whole) == n:
            answer = of_discrete(whole)
            if answer is None:
                raise AnswerError(f"found {excerpt(whole.tolist())}, expected discrete actions {NUMBERED}")
    return numbers(answer, (n, 3), "actions")


def _is_plain(answer: Any, shape: tuple[int, ...]) -> bool:
    """Whether an answer is an array of that shape and nothing else, as those of ibdata's own policies are."""
    return type(answer) is np.ndarray and answer.dtype == np.float64 and answer.shape == shape


def _plain(answer: Any) -> Any:
    """A tensor of torch, or an array with masked values, as an array; anything else as it is."""
    tensor: Any = getattr(sys.modules.get("torch"), "Tensor", ())
    if isinstance(answer, tensor):
        answer = (answer.double() if answer.is_floating_point() else answer).numpy(force=True)
    if isinstance(answer, np.ma.MaskedArray):
        answer = np.ma.filled(answer.astype(np.float64), np.nan)
    return answer


def numbers(answer: Any, shape: tuple[int, ...], what: str) -> Floats:
    """An answer as an array of that shape, also a tensor of torch; masked values are NaN."""
    if _is_plain(answer, shape):
        return np.asarray(answer)
    answer = _plain(answer)
    try:
        if np.iscomplexobj(answer):
            raise TypeError
        array = np.asarray(answer, dtype=np.float64)
    except (TypeError, ValueError):
        raise AnswerError(f"found {excerpt(answer)}, expected {what} of shape {shape}") from None
    if array.shape != shape:
        shown = excerpt(answer) if array.ndim == 0 else f"{what} of shape {array.shape}"
        raise AnswerError(f"found {shown}, expected {what} of shape {shape}")
    return array


def decision(answer: Any) -> tuple[Any, Any]:
    """The two parts of a `Decision`. Raises AnswerError if the answer is none."""
    if not (isinstance(answer, tuple) and len(answer) == 2):
        expected = "a Decision of a distribution or actions, and memory"
        raise AnswerError(f"found {type(answer).__name__}, expected {expected}")
    return answer


class OfUser(Distribution):
    """A distribution of a user's class, whose answers are checked. It cannot change the actions it is given.

    All methods raise AnswerError for what is no answer; errors of the user's code are passed on.
    """

    def __init__(self, distribution: Distribution) -> None:
        self.distribution, self.draws = distribution, distribution.draws

    def sample(self, u: Floats) -> Floats:
        actions = self.distribution.sample(np.ascontiguousarray(u[:, : self.draws]))
        return numbers(actions, (len(u), 3), "actions")

    def log_density(self, action: Float32s) -> Floats:
        density = numbers(self.distribution.log_density(read_only(action)), action.shape[:1], "log densities")
        if (density == np.inf).any():
            raise AnswerError(f"found the log density inf at {action[density == np.inf][0]}, expected less")
        return density

    def atoms(self, action: Float32s) -> Bools:
        atoms = np.asarray(self.distribution.atoms(read_only(action)))
        if atoms.dtype != np.bool_ or atoms.shape != action.shape:
            shape_found, expected = (
                f"atoms of {atoms.dtype} and shape {atoms.shape}",
                f"bool and {action.shape}",
            )
            raise AnswerError(f"found {shape_found}, expected {expected}")
        return atoms


def ask(policy: Policy, observed: Observed) -> tuple[Distribution, Floats]:
    """The distribution of a policy's action, and its memory (n, memory) for the next step, both checked.

    Plain actions are certain if the policy is deterministic, else their density is unknown. Raises
    AnswerError for what is no `Decision`, and for a distribution that takes more random numbers than the
    policy needs.
    """
    action, memory = decision(policy.decide(observed))
    kept = numbers(memory, observed.memory.shape, "memory") if observed.memory.size else observed.memory
    if not isinstance(action, Distribution):
        plain = actions(action, len(observed.step))
        return (Certain if is_deterministic(policy) else Unknown)(plain), kept
    if action.draws > observed.draws.shape[1]:
        raise AnswerError(
            f"found a {type(action).__name__} and needs.draws {observed.draws.shape[1]}, expected at "
            f"least {action.draws}, the random numbers that it takes"
        )
    is_own = type(action).__module__.startswith("ibdata.")
    return (action if is_own else OfUser(action)), kept


def act(distribution: Distribution, u: Floats, out: Float32s, log_density: Floats | None = None) -> int:
    """Draw actions by random numbers u (n, k), and write them, clipped and rounded, into out (n, 3).

    Their log densities are written into an array (n,) if one is given. Returns the number of actions that
    were clipped. Raises AnswerError for actions that are not finite numbers.
    """
    proposed = numbers(distribution.sample(u), out.shape, "actions")
    clipped = int(clip_and_round(proposed, out))
    if clipped < 0:
        row = -1 - clipped
        raise AnswerError(f"found action {proposed[row]}, expected finite numbers", row)
    if log_density is not None:  # an action of which the policy is certain has the probability 1
        log_density[:] = 0.0 if isinstance(distribution, Certain) else distribution.log_density(out)
    return clipped


def raise_placed(error: BaseException, label: str, observed: Observed, episodes: Ints = NOBODY) -> NoReturn:
    """Raise an error of a policy, which must not end the run, as PolicyError that names episode and step.

    Errors of ibdata are raised as they are. A policy that sees and remembers nothing may act for several
    steps at once: the rows are then those of all episodes (n,) at one step after another.
    """
    if isinstance(error, IbdataError | KeyboardInterrupt):
        raise error
    line, row = (str(error), error.row) if isinstance(error, AnswerError) else (error_line(error), 0)
    where = f"episode {episodes[row % len(episodes)]}" if len(episodes) else "asked about random observations"
    step = observed.step[row] if len(observed.step) else 0
    raise PolicyError(f"policy {label}: {where}: step {step}: {line}") from error


TRIED_EPISODES, TRIED_STEPS = 32, 2
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
    history, everyone = histories(TRIED_EPISODES, policy.needs.history, columns), np.arange(TRIED_EPISODES)
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
    return np.stack([actions for _, actions in played(policy, history, TRIED_STEPS, rows)])


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
