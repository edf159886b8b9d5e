"""Whether the data of one policy can evaluate another one, and the ratios of their densities."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from ibdata._numerics.arrays import Bools, Float32s, Floats, Ints
from ibdata._numerics.random import Purpose
from ibdata._simulation.episodes import Episodes, draw_uniforms
from ibdata._simulation.replay import replay
from ibdata.errors import UsageError
from ibdata.evaluation.states import Replayable
from ibdata.experiment import Experiment
from ibdata.plan.rollout import PART_ROWS, episodes_of
from ibdata.policies import Policy
from ibdata.policies.distributions import Distribution, applied
from ibdata.policies.user_object import UserObject

RARE_EPISODES = 0.05  # the share of the target's episodes that may have a point mass which is rare in data
NEVER_EPISODES = 0.001  # the share that may have an action which the data never have
LOG_NEVER = -1e9  # for the log of a density of 0, finite so that sums of it are numbers


class Recorded(NamedTuple):
    """Recorded episodes."""

    observations: Float32s  # (n, steps, 6)
    actions: Float32s  # (n, steps, 3)


class Part(NamedTuple):
    """Episodes of an experiment with the same policy."""

    experiment: Experiment
    numbers: Ints  # of the episodes in the experiment
    positions: Ints  # of the episodes among all

    @property
    def behaviour(self) -> Policy:
        """The policy."""
        policy: Policy = self.experiment.cell_of(int(self.numbers[0])).policy
        return policy


def parts_by_policy(source: Replayable, episodes: Ints, steps: int) -> Iterator[Part]:
    """Divide episodes (n,) into parts of bounded memory, those of a policy alike in size."""
    most = max(1, PART_ROWS // steps)
    for experiment, positions, numbers in source.by_experiment(episodes):
        per_policy = experiment.episodes_per_policy
        for policy in np.unique(numbers // per_policy):
            same = np.flatnonzero(numbers // per_policy == policy)
            for some in np.array_split(same, -(-len(same) // most)):
                yield Part(experiment, numbers[some], positions[some])


def recorded_in(source: Replayable, episodes: Ints, steps: int) -> tuple[Recorded, Floats, Floats]:
    """What was seen and done in the first steps of episodes, and the rewards and log densities (n, steps)."""
    info = source.stored.info
    observed, acted = info.names("observation"), info.names("action")
    names, counts = [*observed, *acted, "reward", "action_log_prob"], np.full(len(episodes), steps)
    *values, reward, log_prob = source.columns(names, episodes, counts, np.dtype(np.float64))
    rows = np.stack(values, axis=2).astype(np.float32)
    return Recorded(rows[..., : len(observed)], rows[..., len(observed) :]), reward, log_prob


class Ratios(NamedTuple):
    """Logarithms of the ratios of the densities of target and behaviour, each (episodes, steps)."""

    recorded: Floats  # at the recorded actions; -inf where the ratio is 0
    drawn: Floats  # at actions that the target draws at the same observations


def refuse_remembered_draws(target: Policy) -> None:
    """Raise UsageError for a target that remembers random numbers, because no data have these numbers."""
    for policy in target.everywhere(Policy):
        needs = getattr(policy, "own_needs", policy.needs)  # without those of a base
        is_object_that_remembers = isinstance(policy, UserObject) and policy.adapter.remembers
        if (needs.memory or is_object_that_remembers) and (needs.draws or policy.needs.episode_draws):
            raise UsageError(
                f"policy {target.label}: found {policy.kind}, which has a memory and random numbers, "
                "expected only one of them: no data have numbers that it may remember; let a base remember, "
                "and {kind: gaussian, base: …} draw"
            )


def log_ratios(
    part: Part, behaviour: Policy, recorded: Recorded, log_prob: Floats, target: Policy, rows: int
) -> Ratios:
    """The ratios of the densities in episodes with one policy, the behaviour.

    Where only one of the two has a point mass at a number of an action, the ratio is 0.

    Args:
        part: the episodes.
        behaviour: their policy, which is loaded.
        recorded: what was seen and done in them.
        log_prob: the recorded log densities (n, steps).
        target: the policy to be evaluated.
        rows: how many rows the whole estimate is made of.

    Returns:
        Ratios (n, steps).

    Raises:
        UsageError: a density is not known, or the target takes actions that the behaviour never or hardly
            ever takes.
        PolicyError: the target failed, or returned no valid density.
    """
    episodes = episodes_of(part.experiment, part.numbers)
    _refuse_unknown(episodes.label, log_prob)
    of_target, actions = _of_target(episodes.played_by(target), recorded)
    _refuse_unknown(target.label, of_target.recorded)
    ratio = of_target.recorded - log_prob
    if target.is_same(behaviour):
        return Ratios(ratio, np.zeros_like(ratio))
    acting = episodes.played_by(behaviour, label=episodes.label)
    of_behaviour = _Densities(*replay(acting, *recorded, _densities, recorded.actions, actions))
    never = (of_target.drawn_atoms & ~of_behaviour.drawn_atoms).any(axis=2) | (of_behaviour.drawn == -np.inf)
    drawn = of_target.drawn - np.where(never, LOG_NEVER, of_behaviour.drawn)
    rare = of_target.drawn_atoms.any(axis=2) & (drawn > np.log(rows))
    _refuse_lack(target.label, episodes.label, actions, never, rare, rows)
    return Ratios(np.where((of_target.atoms == of_behaviour.atoms).all(axis=2), ratio, -np.inf), drawn)


def _refuse_lack(
    target: str, behaviour: str, actions: Float32s, never: Bools, rare: Bools, rows: int
) -> None:
    """Raise UsageError if the behaviour cannot take, or hardly ever takes, too many actions of the target.

    A point mass is rare if the target takes it more than `rows` times as often: so many rows have it less
    than once.
    """
    lacking = never | rare
    if never.any(axis=1).mean() <= NEVER_EPISODES and lacking.any(axis=1).mean() <= RARE_EPISODES:
        return
    episode, step = np.argwhere(lacking)[0]
    example = f"such as {actions[episode, step].tolist()} at step {step}"
    raise UsageError(
        f"policy {target}: found that {lacking.mean():.2%} of its actions are taken by {behaviour}, the "
        f"policy of the data, less than once in {rows:,} rows, {example}; expected data of a policy that "
        f"can take every action of {target}"
    )


class _Densities(NamedTuple):
    """Log densities (n, steps) of a policy, and where it has point masses (n, steps, 3)."""

    recorded: Floats  # of the recorded actions
    atoms: Bools
    drawn: Floats  # of the actions that the target draws
    drawn_atoms: Bools


def _of_target(episodes: Episodes, recorded: Recorded) -> tuple[_Densities, Float32s]:
    """What the target says of recorded actions, and of those (n, steps, 3) that it draws there."""
    steps, count, purpose = recorded.actions.shape[1], episodes.policy.needs.draws, Purpose.TRIAL
    draws = draw_uniforms(episodes.draw, episodes.lanes, purpose, 0, steps, count).swapaxes(0, 1)

    def densities_and_draws(distribution: Distribution, actions: Float32s, u: Floats) -> tuple[Any, ...]:
        drawn = applied(distribution.sample(u))
        return *_densities(distribution, actions, drawn), drawn

    *densities, drawn = replay(episodes, *recorded, densities_and_draws, recorded.actions, draws)
    return _Densities(*densities), drawn


def _densities(distribution: Distribution, recorded: Float32s, drawn: Float32s) -> _Densities:
    """What a distribution says of recorded and drawn actions."""
    return _Densities(
        distribution.log_density(recorded),
        distribution.atoms(recorded),
        distribution.log_density(drawn),
        distribution.atoms(drawn),
    )


def _refuse_unknown(label: str, log_density: Floats) -> None:
    if np.isnan(log_density).any():
        raise UsageError(
            f"policy {label}: found no log density, expected a policy with one; yours has one if decide "
            "returns a distribution, such as Decision(ClippedNormal(mean, sd), memory); see "
            "the page 'Custom policies'"
        )
