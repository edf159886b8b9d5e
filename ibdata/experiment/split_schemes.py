"""Schemes to split a dataset by setpoint, episode or policy. Each returns splits by name."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

from ibdata._numerics.naming import counted, exact
from ibdata.errors import UsageError
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fields import EpisodeRange, Split

Splits = dict[str, Split]
FRACTION_NAMES = {2: ("train", "test"), 3: ("train", "validation", "test")}
# Groups of splits that belong together. New splits of a group do not fit older ones of that group.
TOGETHER = ({"source", "target", "target-rest", "near", "far"}, set(FRACTION_NAMES[3]))


def transfer(
    spec: DatasetSpec,
    source: Sequence[float] = (),
    target: Sequence[float] = (),
    shots: int | None = None,
    transitions: int | None = None,
) -> Splits:
    """`source` and `target`, the latter with the first episodes of each cell that a budget allows.

    The budget is in episodes (shots) or rows (transitions); the other episodes are `target-rest`. Hein et al.
    2017 suggest a transfer from p = 50 to p = 75 and give no sizes.
    """
    known = setpoints(spec)
    _refuse_unknown([*source, *target], known)
    if shared := set(source) & set(target):
        names = ", ".join(exact(setpoint) for setpoint in sorted(shared))
        raise UsageError(f"split: found {names} as source and target, expected different setpoints")
    if not source or not target:
        raise UsageError(f"split: found no {'target' if source else 'source'}, expected setpoints for both")
    sources, targets = sorted(set(source)), sorted(set(target))
    counts = {
        experiment.episodes
        for experiment in spec.experiments
        if any(cell.setpoint in targets for cell in experiment.cells)
    }
    fewest, last = min(counts), max(counts) - 1
    budget = _budget(spec, shots, transitions)
    if budget is not None and budget > fewest:
        raise UsageError(
            f"split: found a budget of {counted(budget, 'episode')}, expected at most {fewest:,}, the "
            "episodes of each policy at a target setpoint"
        )
    if budget is None or budget > last:
        return {"source": Split(setpoint=sources), "target": Split(setpoint=targets)}
    return {
        "source": Split(setpoint=sources),
        "target": Split(setpoint=targets, episodes=budget),
        "target-rest": Split(setpoint=targets, episodes=EpisodeRange(start=budget, stop=last)),
    }


def _budget(spec: DatasetSpec, shots: int | None, transitions: int | None) -> int | None:
    """The number of episodes of each cell that the budget allows; None for all."""
    if shots is not None and transitions is not None:
        raise UsageError("split: found shots and transitions, expected one of them")
    if transitions is None:
        if shots is not None and shots < 1:
            raise UsageError(f"split: found {counted(shots, 'shot')}, expected at least 1")
        return shots
    lengths = {experiment.steps for experiment in spec.experiments}
    if len(lengths) > 1:
        raise UsageError("split: found episodes of several lengths, expected shots in place of transitions")
    length = lengths.pop()
    if transitions < length:
        raise UsageError(
            f"split: found {counted(transitions, 'transition')}, expected at least {length:,}, those of an "
            "episode"
        )
    return transitions // length


def leave_one_out(spec: DatasetSpec) -> Splits:
    """Splits for every setpoint p: `test-p` with the episodes at p, and `train-p` with all others."""
    known = setpoints(spec)
    if len(known) < 2:
        raise UsageError("split: found one setpoint, expected at least 2 to leave one out")
    folds: Splits = {}
    for test in known:
        train = [setpoint for setpoint in known if setpoint != test]
        name = exact(test).replace(".", "_")
        folds[f"train-{name}"] = Split(setpoint=train, overlap=True)
        folds[f"test-{name}"] = Split(setpoint=[test], overlap=True)
    return folds


def interpolation(spec: DatasetSpec) -> Splits:
    """`train` and `test` by setpoint: the test has every second one between the lowest and the highest."""
    return _held_out(spec, outer=False)


def extrapolation(spec: DatasetSpec) -> Splits:
    """`train` and `test` by setpoint: the test has the lowest and the highest."""
    return _held_out(spec, outer=True)


def _held_out(spec: DatasetSpec, outer: bool) -> Splits:
    """`train` and `test`; the test has the outer setpoints, or every second inner one."""
    known = setpoints(spec)
    if len(known) < 3:
        raise UsageError(
            f"split: found {counted(len(known), 'setpoint')}, expected at least 3 to hold some out"
        )
    test = [known[0], known[-1]] if outer else known[1:-1:2]
    train = [setpoint for setpoint in known if setpoint not in test]
    return {"train": Split(setpoint=train), "test": Split(setpoint=test)}


def distance(spec: DatasetSpec, source: Sequence[float] = (), within: float | None = None) -> Splits:
    """`source`, `near` (other setpoints at most `within` from the nearest of the source) and `far`."""
    if not source or within is None:
        raise UsageError("split: the scheme distance needs both source and within")
    known = setpoints(spec)
    _refuse_unknown(source, known)
    candidates = [setpoint for setpoint in known if setpoint not in source]
    near = [setpoint for setpoint in candidates if min(abs(setpoint - p) for p in source) <= within]
    far = sorted(set(candidates) - set(near))
    if not near or not far:
        raise UsageError(
            f"split: found {counted(len(near), 'setpoint')} within {exact(within)} of the source and "
            f"{len(far)} beyond, expected some of both"
        )
    return {
        "source": Split(setpoint=sorted(set(source))),
        "near": Split(setpoint=near),
        "far": Split(setpoint=far),
    }


def by_episode(spec: DatasetSpec, fractions: Sequence[float] = (0.8, 0.1, 0.1)) -> Splits:
    """`train`, perhaps `validation`, and `test`, from the first to the last episodes of every cell.

    The episodes of a cell are independent and identically distributed, so they need no shuffling.
    """
    names = FRACTION_NAMES.get(len(fractions))
    if names is None or min(fractions) <= 0 or not math.isclose(sum(fractions), 1.0, abs_tol=1e-9):
        numbers = ", ".join(f"{fraction:.15g}" for fraction in fractions)
        raise UsageError(f"split: found fractions {numbers}, expected 2 or 3 above 0 that sum to 1")
    counts = {experiment.episodes for experiment in spec.experiments}
    if len(counts) > 1:
        raise UsageError("split: found cells of several sizes, expected the same number of episodes in each")
    n = counts.pop()
    bounds = [round(n * sum(fractions[:i])) for i in range(len(names))] + [n]
    if any(low >= high for low, high in pairwise(bounds)):
        raise UsageError(
            f"split: found {counted(n, 'episode')} in each cell, expected enough for every fraction"
        )
    return {
        name: Split(episodes=EpisodeRange(start=low, stop=high - 1))
        for name, (low, high) in zip(names, pairwise(bounds), strict=True)
    }


def by_policy(spec: DatasetSpec) -> Splits:
    """A split for each policy, named by its label."""
    if len(spec.labels) < 2:
        raise UsageError("split: found one policy, expected at least 2")
    return {label: Split(policy=label) for label in spec.labels}


def setpoints(spec: DatasetSpec) -> list[float]:
    """The setpoints of a dataset in ascending order."""
    return sorted({cell.setpoint for experiment in spec.experiments for cell in experiment.cells})


def _refuse_unknown(given: Sequence[float], known: Sequence[float]) -> None:
    """Raise UsageError if a dataset lacks one of the given setpoints."""
    for setpoint in given:
        if setpoint not in known:
            names = ", ".join(map(exact, known))
            raise UsageError(f"split: found setpoint {exact(setpoint)}, expected one of {names}")


# By the name of the scheme; `episode` and `policy` have one each, named as they are.
SCHEMES: Mapping[str, Callable[..., Splits]] = {
    "transfer": transfer,
    "leave-one-out": leave_one_out,
    "interpolation": interpolation,
    "extrapolation": extrapolation,
    "distance": distance,
    "episode": by_episode,
    "policy": by_policy,
}
