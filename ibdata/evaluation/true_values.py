"""The true values of states and actions: means of the returns of many episodes that branch off there."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import public
from ibdata._numerics.arrays import Float32s, Floats, Ints
from ibdata._numerics.confidence import mean_estimate
from ibdata._numerics.random import Raw, stream_key
from ibdata._simulation.carry import Carry
from ibdata._simulation.episodes import Episodes, record_rows
from ibdata._simulation.unroll import LANES, unroll
from ibdata._system.memory import refuse_too_much
from ibdata.dataset.dataset import Place, whole_dataset
from ibdata.dataset.tabular import Table, Tabular
from ibdata.errors import UsageError, excerpt
from ibdata.evaluation.play import RETURN_BYTES, checked_discount, returns_of
from ibdata.evaluation.policies import as_policy, loaded
from ibdata.evaluation.states import Replayable
from ibdata.experiment import Experiment
from ibdata.experiment.scenario import form_digest, scenario_of
from ibdata.policies import Policy
from ibdata.policies.distributions import finite_actions


def branches_at(
    seed: int,
    experiment: Experiment,
    policy: Policy,
    numbers: Ints,
    steps: Ints,
    episodes: Ints,
    carry: Carry,
) -> Episodes:
    """Episodes in which a policy acts from rows (n,) on, each with random numbers of its own.

    An address is the digest of the label "branch", which no cell and no evaluation has, and of the seed, the
    cell, the index and the step of the row; that of the policy's random numbers is also of the policy.
    """
    keys: list[Raw] = []
    policy_keys: list[Raw] = []
    for number, step in zip(numbers.tolist(), steps.tolist(), strict=True):
        form = {
            "label": "branch",
            "seed": experiment.seed,
            "cell": experiment.cell_of(number).digest.hex(),
            "index": number % experiment.episodes,
            "step": step,
        }
        keys.append(stream_key(seed, form_digest(form)))
        policy_keys.append(stream_key(seed, form_digest({**form, "policy": policy.form()})))
    return Episodes(
        experiment.scenario.world,
        policy,
        policy.label,
        keys=np.array(keys),
        policy_keys=np.array(policy_keys),
        index=np.zeros_like(numbers),
        setpoint=carry.state.setpoint,
        number=episodes,
    )


def branch_returns(
    episodes: Episodes,
    carry: Carry,
    first_step: Ints,
    first_actions: Float32s | None,
    *,
    steps: int,
    branches: int,
    discount: float,
) -> Floats:
    """The discounted returns (n, branches) of branches of so many steps.

    Args:
        episodes: an episode for each row (n,); its branches differ in their index.
        carry: where they are.
        first_step: the steps (n,) at which they are.
        first_actions: the first actions (n, 3), or None if the policy chooses them.
        steps: the number of steps of a branch.
        branches: the number of branches of each row.
        discount: the discount factor.

    Raises:
        PolicyError: the policy failed.
    """
    total = len(episodes) * branches
    out = np.empty(total)
    for start in range(0, total, LANES):
        lanes = np.arange(start, min(start + LANES, total))
        row, index = np.divmod(lanes, branches)
        blocks = unroll(
            episodes.take(row, index=index),
            carry.take(row),
            record_rows(["reward"]),
            steps,
            first_step=first_step[row],
            recorded=None if first_actions is None else first_actions[row][None],
        )
        out[lanes] = returns_of(blocks, discount).discounted
    return out.reshape(-1, branches)


class Value(NamedTuple):
    """The value of a row's state, or of an action in it.

    Attributes:
        episode: the number of the row's episode.
        step: the step of the row in its episode.
        action: the given first action; None if the policy chose it.
        value: the mean return of the branches.
        standard_error: the standard error of `value`; None for one branch.
        interval: the 95 % interval of `value`; None for one branch.
    """

    episode: int
    step: int
    action: list[float] | None
    value: float
    standard_error: float | None
    interval: tuple[float, float] | None


@dataclasses.dataclass(frozen=True, repr=False)
class TrueValues(Tabular):
    """The values of n rows, and the returns behind them.

    Attributes:
        results: a `Value` for each row.
        returns: the return of each branch (n, episodes).
    """

    results: list[Value]
    returns: Floats

    @property
    def values(self) -> Floats:
        """The values (n,)."""
        return np.array([result.value for result in self.results])

    @property
    def standard_errors(self) -> Floats:
        """Their standard errors (n,); NaN if each row has only one branch."""
        return np.array([result.standard_error for result in self.results], dtype=np.float64)

    def tables(self) -> list[Table]:
        """The results, a row each."""
        return [Table(Value._fields, self.results)]

    def plain(self) -> dict[str, Any]:
        """The results as plain data."""
        return {"results": [result._asdict() for result in self.results]}


@public
def true_values(
    ds: Place,
    rows: Any,
    policy: Any,
    actions: npt.ArrayLike | None = None,
    *,
    steps: int = 100,
    discount: float = 0.97,
    episodes: int = 100,
    seed: int = 0,
    history: int = 1,
    allow_code: bool = False,
) -> TrueValues:
    """The true values of a policy in the states behind rows of a dataset.

    From the exact state before a row's action, `episodes` branches are simulated: episodes that begin in that
    state, in which the policy acts. Their random numbers are independent of those of the dataset, of
    `evaluate` and of other rows. Those of the environment are the same for all policies and actions, and
    those of a policy for all actions, so that differences are paired, branch by branch. The same call gives
    the same bits.

        V(s) = E[Σ discountᵗ r] for t = 0 … steps - 1;    Q(s, a) is the same if the first action is a

    Args:
        ds: The dataset, or its folder or URL.
        rows: The rows as in `state_at`: `(episode, step)`, pairs of them, numbers of rows, or a table.
        policy: A policy as in `evaluate`. At the row it knows what it would know if it had watched the
            episode up to there: the observations, the actions and the step. If it has a memory or random
            numbers of the episode, they are those that it has with the dataset's own random numbers.
        actions: For Q, the first action of each row, (n, 3), clipped to [-1, 1] and rounded to float32; for
            V, None.
        steps: The number of rewards in a return.
        discount: The discount factor, in [0, 1].
        episodes: The number of branches of each row.
        seed: The seed of the branches' random numbers.
        history: As in `evaluate`.
        allow_code: Whether a custom policy that a file names may run.

    Returns:
        The value of each row with its standard error, and the returns (n, episodes) behind them.

    Raises:
        UsageError, ConfigError: An argument is invalid, or the dataset has no such row.
        DatasetError: The rows are damaged, or this ibdata cannot simulate them again.
        PolicyError: The policy failed, or returned no valid action.
    """
    discount = checked_discount(discount)
    acting, source = as_policy(policy, history, allow_code), Replayable(whole_dataset(ds).stored)
    numbers, times = source.episodes_and_steps(rows)
    first = None if actions is None else _applied(actions, len(numbers))
    refuse_too_much("episodes", RETURN_BYTES * len(numbers) * episodes)
    settings = scenario_of(steps=steps, episodes=episodes, seed=seed)
    returns = np.empty((len(numbers), settings.episodes))
    with loaded([acting]) as [acting]:
        begun = source.carries_at(numbers, times, acting)
        for experiment, positions, inner in source.by_experiment(numbers):
            carry, step = begun.take(positions), times[positions]
            returns[positions] = branch_returns(
                branches_at(settings.seed, experiment, acting, inner, step, numbers[positions], carry),
                carry,
                step,
                None if first is None else first[positions],
                steps=settings.steps,
                branches=settings.episodes,
                discount=discount,
            )
    results = [
        Value(number, time, None if first is None else first[i].tolist(), *mean_estimate([returns[i]]))
        for i, (number, time) in enumerate(zip(numbers.tolist(), times.tolist(), strict=True))
    ]
    return TrueValues(results, returns)


def _applied(actions: npt.ArrayLike, n: int) -> Float32s:
    """Actions (n, 3), clipped and rounded. Raises UsageError if they are none."""
    clipped = finite_actions(actions)
    if clipped is None or clipped.shape != (n, 3):
        raise UsageError(
            f"actions: found {excerpt(actions, 80)}, expected ({n}, 3) finite numbers: "
            "for each row the changes of velocity, gain and shift in [-1, 1]"
        )
    return clipped
