"""Ways to split a dataset: by setpoint, for transfer; by episode; by policy. Each gives named conditions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

from ibdata.errors import UsageError
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fields import EpisodeRange, Split
from ibdata.experiment.messages import suggestion
from ibdata.numerics.naming import exact

Splits = dict[str, Split]
FRACTION_NAMES = {2: ("train", "test"), 3: ("train", "validation", "test")}


def transfer(
    spec: DatasetSpec,
    source: Sequence[float],
    target: Sequence[float],
    shots: int | None = None,
    transitions: int | None = None,
) -> Splits:
    """`source`: all episodes at those setpoints; `target`: those at others, or the first few of each cell.

    shots is a number of episodes, transitions one of rows, of which whole episodes are taken; what a budget
    leaves at the target setpoints is `target-rest`. Hein et al. 2017 sketch p = 50 to p = 75; the sizes
    are our own.
    """
    known = setpoints(spec)
    for p in [*source, *target]:
        _refuse_unknown(p, known)
    both = set(source) & set(target)
    if both or not source or not target:
        found = ", ".join(exact(p) for p in sorted(both)) or "none"
        raise UsageError(f"split: found {found} as source and target, expected different setpoints for both")
    here, there = sorted(set(source)), sorted(set(target))
    fewest = min(experiment.episodes for experiment in spec.experiments)
    k = _budget(spec, shots, transitions)
    last = max(experiment.episodes for experiment in spec.experiments) - 1
    if k is not None and k > fewest:
        raise UsageError(f"split: found a budget of {k} episodes, expected at most the {fewest} of a cell")
    if k is None or k > last:
        return {"source": Split(setpoint=here), "target": Split(setpoint=there)}
    return {
        "source": Split(setpoint=here),
        "target": Split(setpoint=there, episodes=k),
        "target-rest": Split(setpoint=there, episodes=EpisodeRange(start=k, stop=last)),
    }


def _budget(spec: DatasetSpec, shots: int | None, transitions: int | None) -> int | None:
    """Episodes of a cell that the budget allows."""
    if shots is not None and transitions is not None:
        raise UsageError("split: found shots and transitions, expected one of them")
    if transitions is None:
        if shots is not None and shots < 1:
            raise UsageError(f"split: found {shots} shots, expected at least 1")
        return shots
    steps = {experiment.steps for experiment in spec.experiments}
    if len(steps) > 1:
        raise UsageError("split: found episodes of several lengths, expected shots in place of transitions")
    k = transitions // steps.pop()
    if k < 1:
        raise UsageError(f"split: found {transitions} transitions, expected at least an episode of them")
    return k


def leave_one_out(spec: DatasetSpec) -> Splits:
    """For every setpoint p: `test-p`, the episodes there, and `train-p`, all others."""
    known = setpoints(spec)
    if len(known) < 2:
        raise UsageError("split: found one setpoint, expected at least 2 to leave one out")
    folds: Splits = {}
    for p in known:
        others = [q for q in known if q != p]
        folds[f"train-{_named(p)}"] = Split(setpoint=others, overlap=True)
        folds[f"test-{_named(p)}"] = Split(setpoint=[p], overlap=True)
    return folds


def held_out(spec: DatasetSpec, extrapolate: bool) -> Splits:
    """`train` and `test` by setpoint: every second inner one held out, or the lowest and the highest."""
    known = setpoints(spec)
    if len(known) < 3:
        raise UsageError(f"split: found {len(known)} setpoints, expected at least 3 to hold some out")
    test = {known[0], known[-1]} if extrapolate else {*known[1:-1:2]}
    return {
        "train": Split(setpoint=[p for p in known if p not in test]),
        "test": Split(setpoint=sorted(test)),
    }


def by_distance(spec: DatasetSpec, source: Sequence[float], within: float) -> Splits:
    """`source`, and of the other setpoints `near`, at most `within` from the nearest source, and `far`."""
    known = setpoints(spec)
    for p in source:
        _refuse_unknown(p, known)
    others = [p for p in known if p not in source]
    near = [p for p in others if min(abs(p - q) for q in source) <= within]
    far = sorted({*others} - {*near})
    if not near or not far:
        raise UsageError(
            f"split: found {len(near)} setpoints within {exact(within)} of the source and {len(far)} beyond, "
            "expected some of both"
        )
    return {
        "source": Split(setpoint=sorted(set(source))),
        "near": Split(setpoint=near),
        "far": Split(setpoint=far),
    }


def by_episode(spec: DatasetSpec, fractions: Sequence[float]) -> Splits:
    """`train`, (`validation`,) `test`: the first, (next,) last episodes of every cell.

    Episodes of a cell are independent and alike, so their order is as good as any, and stays the same when
    the dataset grows.
    """
    names = FRACTION_NAMES.get(len(fractions))
    if names is None or min(fractions) <= 0 or not math.isclose(sum(fractions), 1.0, abs_tol=1e-9):
        found = ", ".join(f"{x:.15g}" for x in fractions)
        raise UsageError(f"split: found fractions {found}, expected 2 or 3 above 0 that sum to 1")
    counts = {experiment.episodes for experiment in spec.experiments}
    if len(counts) > 1:
        raise UsageError("split: found cells of several sizes, expected as many episodes in each")
    n = counts.pop()
    bounds = [round(n * sum(fractions[:i])) for i in range(len(names))] + [n]
    if any(low >= high for low, high in pairwise(bounds)):
        raise UsageError(f"split: found {n} episodes in each cell, expected enough for every fraction")
    return {
        name: Split(episodes=EpisodeRange(start=low, stop=high - 1))
        for name, (low, high) in zip(names, pairwise(bounds), strict=True)
    }


def by_policy(spec: DatasetSpec) -> Splits:
    """A split for each policy, of its label."""
    if len(spec.labels) < 2:
        raise UsageError("split: found one policy, expected at least 2")
    return {label: Split(policy=label) for label in spec.labels}


def setpoints(spec: DatasetSpec) -> list[float]:
    """The setpoints of a dataset, in order of size."""
    return sorted({cell.setpoint for experiment in spec.experiments for cell in experiment.cells})


def _named(p: float) -> str:
    return exact(p).replace(".", "_")


def _refuse_unknown(p: float, known: Sequence[float]) -> None:
    if p not in known:
        name, names = exact(p), [exact(q) for q in known]
        raise UsageError(
            f"split: found setpoint {name}, expected one of {', '.join(names)}{suggestion(name, names)}"
        )
