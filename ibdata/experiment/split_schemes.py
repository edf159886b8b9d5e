"""Schemes to split a dataset by setpoint, episode or policy. Each returns splits by name."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

from ibdata.errors import UsageError, suggestion
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fields import EpisodeRange, Split
from ibdata.numerics.naming import counted, exact

Splits = dict[str, Split]
FRACTION_NAMES = {2: ("train", "test"), 3: ("train", "validation", "test")}
# Splits that are made together: where some of a group are made, earlier ones of the others do not fit them.
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
    for p in [*source, *target]:
        _refuse_unknown(p, known)
    both = set(source) & set(target)
    if both or not source or not target:
        if not both:
            raise UsageError(
                f"split: found no {'target' if source else 'source'}, expected setpoints for both"
            )
        found = ", ".join(exact(p) for p in sorted(both))
        raise UsageError(f"split: found {found} as source and target, expected different setpoints")
    here, there = sorted(set(source)), sorted(set(target))
    counts = {e.episodes for e in spec.experiments if any(cell.setpoint in there for cell in e.cells)}
    fewest, last = min(counts), max(counts) - 1
    k = _budget(spec, shots, transitions)
    if k is not None and k > fewest:
        raise UsageError(
            f"split: found a budget of {counted(k, 'episode')}, expected at most {fewest:,}, the "
            "episodes of each policy at a target setpoint"
        )
    if k is None or k > last:
        return {"source": Split(setpoint=here), "target": Split(setpoint=there)}
    return {
        "source": Split(setpoint=here),
        "target": Split(setpoint=there, episodes=k),
        "target-rest": Split(setpoint=there, episodes=EpisodeRange(start=k, stop=last)),
    }


def _budget(spec: DatasetSpec, shots: int | None, transitions: int | None) -> int | None:
    """The number of episodes of a cell in the budget; None for all."""
    if shots is not None and transitions is not None:
        raise UsageError("split: found --shots and --transitions, expected one of them")
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
    for p in known:
        others = [q for q in known if q != p]
        folds[f"train-{_named(p)}"] = Split(setpoint=others, overlap=True)
        folds[f"test-{_named(p)}"] = Split(setpoint=[p], overlap=True)
    return folds


def interpolation(spec: DatasetSpec) -> Splits:
    """`train` and `test` by setpoint: the test has every second one between the lowest and the highest."""
    return _held_out(spec, outer=False)


def extrapolation(spec: DatasetSpec) -> Splits:
    """`train` and `test` by setpoint: the test has the lowest and the highest."""
    return _held_out(spec, outer=True)


def _held_out(spec: DatasetSpec, outer: bool) -> Splits:
    known = setpoints(spec)
    if len(known) < 3:
        raise UsageError(
            f"split: found {counted(len(known), 'setpoint')}, expected at least 3 to hold some out"
        )
    test = [known[0], known[-1]] if outer else known[1:-1:2]
    return {"train": Split(setpoint=[p for p in known if p not in test]), "test": Split(setpoint=test)}


def distance(spec: DatasetSpec, source: Sequence[float] = (), within: float | None = None) -> Splits:
    """`source`, `near` (other setpoints at most `within` from the nearest of the source) and `far`."""
    if not source or within is None:
        raise UsageError("split: the scheme distance needs both --source and --within")
    known = setpoints(spec)
    for p in source:
        _refuse_unknown(p, known)
    others = [p for p in known if p not in source]
    near = [p for p in others if min(abs(p - q) for q in source) <= within]
    far = sorted({*others} - {*near})
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
        found = ", ".join(f"{x:.15g}" for x in fractions)
        raise UsageError(f"split: found fractions {found}, expected 2 or 3 above 0 that sum to 1")
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


def _named(p: float) -> str:
    return exact(p).replace(".", "_")


def _refuse_unknown(p: float, known: Sequence[float]) -> None:
    if p not in known:
        name, names = exact(p), [exact(q) for q in known]
        raise UsageError(
            f"split: found setpoint {name}, expected one of {', '.join(names)}{suggestion(name, names)}"
        )


# By scheme, or by the property where that has but one scheme.
SCHEMES: Mapping[str, Callable[..., Splits]] = {
    "transfer": transfer,
    "leave-one-out": leave_one_out,
    "interpolation": interpolation,
    "extrapolation": extrapolation,
    "distance": distance,
    "episode": by_episode,
    "policy": by_policy,
}
