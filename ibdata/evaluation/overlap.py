"""Whether the data of one policy can evaluate another one, and the ratios of their densities."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ibdata.errors import UsageError
from ibdata.experiment import Experiment
from ibdata.policies import Policy
from ibdata.policies.support import INSIDE, Support, missing
from ibdata.simulation.episodes import Float32s, Floats
from ibdata.simulation.replay import measured

Supports = tuple[Support, ...] | None  # of a policy at a step


def check_support(behaviour: Policy, target: Policy, steps: int) -> list[str]:
    """Check that the behaviour can take every action of the target.

    A policy can always be evaluated on its own data. Supports are compared as the policies declare them, so a
    pair is refused even if the policies happen to agree in the states of a dataset.

    Args:
        behaviour: the policy of the data.
        target: the policy to be evaluated.
        steps: the steps of an episode.

    Returns:
        A line if a support is not known, and so was not checked; else nothing.

    Raises:
        UsageError: the behaviour lacks a part of the target's support, or the target remembers random
            numbers.
    """
    if target.form() == behaviour.form():
        return []
    for policy in (behaviour, target):
        _refuse_mixed_measure(policy)
    for policy in target.everywhere():
        own_memory = policy.memory_size - sum(inner.memory_size for inner in policy.inner)
        own_draws = policy.uniforms_per_step - sum(inner.uniforms_per_step for inner in policy.inner)
        if own_memory > 0 and (own_draws > 0 or policy.uniforms_per_episode > 0):
            raise UsageError(
                f"policy {target.label}: found {policy.kind}, which remembers its random numbers, expected a "
                "policy whose memory follows from observations, because no data have these numbers"
            )
    unknown: set[str] = set()
    first: dict[tuple[Supports, Supports], int] = {}  # of steps with equal supports
    for t in range(steps):
        first.setdefault((behaviour.supports(t), target.supports(t)), t)
    for now, t in first.items():
        when = f" at step {t}" if len(first) > 1 else ""
        for policy, supports in zip((behaviour, target), now, strict=True):
            if supports is None:
                unknown.add(policy.label)
        for wanted in now[1] or ():
            for had in now[0] or ():
                if (lost := missing(had, wanted)) is not None:
                    raise UsageError(
                        f"policy {target.label}: found {lost}{when}, where the data of {behaviour.label} "
                        f"have none, expected data of a policy that can take every action of {target.label}"
                    )
    return [f"support not checked: {label} does not declare its support" for label in sorted(unknown)]


def log_ratios(
    experiment: Experiment,
    first: int,
    stop: int,
    observations: Float32s,
    actions: Float32s,
    log_prob: Floats,
    target: Policy,
) -> Floats:
    """The logarithms of the ratios of the densities of the target and of the behaviour.

    Where the measures of the two densities have unit masses at different numbers of an action, the target
    takes this action with the probability 0 although its density is positive, and the ratio is 0. So it is
    at ±1 where the target declares a density on (-1, 1) and nothing else.

    Args:
        experiment: the experiment.
        first: the first episode.
        stop: the episode after the last; all have the same policy.
        observations: the recorded observations, float32 (episodes, steps, 6).
        actions: the recorded actions, float32 (episodes, steps, 3).
        log_prob: the recorded log densities (episodes, steps).
        target: the policy to be evaluated; its support is that of the behaviour, or a part of it.

    Returns:
        Float64 (episodes, steps), -inf where the ratio is 0.

    Raises:
        UsageError: a density is not known.
        PolicyError: the target failed, or returned no valid density.
    """
    _refuse_unknown(experiment.cells[first // experiment.episodes].label, log_prob)
    wanted = measured(experiment, first, stop, observations, actions, target)
    had = measured(experiment, first, stop, observations, actions)
    _refuse_unknown(target.label, wanted.log_density)
    possible = (wanted.atoms == had.atoms).all(axis=2)
    possible &= ~((np.abs(actions) == 1.0) & _only_inside(target, actions.shape[1])).any(axis=2)
    return np.where(possible, wanted.log_density - log_prob, -np.inf)


def _only_inside(policy: Policy, steps: int) -> npt.NDArray[np.bool_]:
    """Whether a policy declares nothing but a density on (-1, 1), by step and component: (steps, 3)."""
    declared = [policy.supports(t) or () for t in range(steps)]
    strata = [[stratum for support in supports for stratum in support] for supports in declared]
    return np.array([[bool(now) and all(s[j] == INSIDE for s in now) for j in range(3)] for now in strata])


def _refuse_mixed_measure(policy: Policy) -> None:
    """Raise UsageError for a density that is wrong where only some numbers of an action are the base's."""
    for outer in policy.everywhere():
        if getattr(outer, "explores", False) and any(
            getattr(inner, "per_dimension", False) for inner in outer.everywhere()
        ):
            raise UsageError(
                f"policy {policy.label}: found a schedule with epsilon around a policy with per_dimension, "
                "expected one without the other: its density is wrong where only some numbers of an action "
                "are the base's"
            )


def _refuse_unknown(label: str, log_density: Floats) -> None:
    if np.isnan(log_density).any():
        raise UsageError(f"policy {label}: found no log density, expected a policy with a known density")
