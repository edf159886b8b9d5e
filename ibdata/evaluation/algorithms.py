"""Algorithms, which are several trained policies each, as lines of a table beside policies that are known."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from ibdata._numerics.arrays import Floats
from ibdata._numerics.confidence import MeanEstimate, mean_estimate, t_quantile
from ibdata.dataset.reference_returns import HUNDRED
from ibdata.dataset.tabular import Number, Table

BEHAVIOUR = "behaviour"
ENDS = ("lowest", "highest")
YOURS, KNOWN = "yours", "known"  # sources of lines


class LineReturns(NamedTuple):
    """The returns of the policies of a line: one for each training, or one that is known."""

    label: str
    source: str  # `YOURS`, `KNOWN`, or the part of the set on which it was trained
    is_trained: bool
    returns: Floats  # (trainings, setpoints, episodes); no training if all failed

    def at(self, columns: Sequence[int]) -> LineReturns:
        """The returns at some of the setpoints."""
        return self._replace(returns=self.returns[:, columns])

    @property
    def means(self) -> Floats:
        """The mean return of each training."""
        return np.array(
            [math.fsum(values) / values.size for values in self.returns.reshape(len(self.returns), -1)]
        )


class Algorithm(NamedTuple):
    """A line of the table: an algorithm, which has one policy for each training, or a known policy.

    A number is None where it is not known. One training says nothing of others, so it has no interval.

    Attributes:
        algorithm: the label, which is printed as "label".
        source: "yours", "known", or the part of the set on which ibdata's own were trained.
        setpoint: the setpoint; None for all setpoints.
        seeds: the number of trainings; None for a policy that is not trained.
        mean_return: the mean of the mean returns of the trainings, which is printed as "mean".
        half_width: half the width of the 95 % interval of `mean_return`, for new trainings and new episodes.
        lowest: the lowest mean return of a training.
        highest: the highest mean return of a training.
        spread: the standard deviation of the mean returns of the trainings.
        standard_error: that of `mean_return` over the episodes, for these trainings ("error").
        score: the mean score of the trainings, as of `Result`.
        above_behaviour: `mean_return` minus that of the behaviour, in the same episodes ("- behaviour").
        behaviour_half_width: half the width of the 95 % interval of `above_behaviour`.
        above_optimized: `mean_return` minus that of `optimized`, in the same episodes ("- optimized").
        optimized_half_width: half the width of the 95 % interval of `above_optimized`.
    """

    algorithm: str
    source: str
    setpoint: float | None
    seeds: int | None
    mean_return: float | None
    half_width: float | None
    lowest: float | None
    highest: float | None
    spread: float | None
    standard_error: float | None
    score: float | None
    above_behaviour: float | None
    behaviour_half_width: float | None
    above_optimized: float | None
    optimized_half_width: float | None


class Difference(NamedTuple):
    """The returns of a policy minus those of another one, in the same episodes.

    Attributes:
        policy: the label of the policy, which is printed as "label" where algorithms are compared.
        minus: the label of the other policy.
        setpoint: the setpoint; None for all setpoints.
        mean_difference: the mean return of `policy` minus that of `minus`, which is printed as "difference";
            above 0, `policy` is better.
        standard_error: that of `mean_difference` over the episodes, which are paired, for these trainings.
        interval: the 95 % interval of `mean_difference` for new episodes. Where algorithms are compared, it
            is for new trainings too, and None for a label of one training.
    """

    policy: str
    minus: str
    setpoint: float | None
    mean_difference: float
    standard_error: float | None
    interval: tuple[float, float] | None


def estimated(
    policy: LineReturns, minus: LineReturns | None = None, of_algorithms: bool = True
) -> MeanEstimate:
    """The mean return of a line, or its difference from another, with the error over the episodes.

    The interval is for new trainings and new episodes (MOVER, Zou & Donner 2008): the squares of the
    half-widths over the episodes, and over the trainings of each line, add up. A line of one training has
    none, unless it stands for this policy and not for its algorithm.
    """
    lines = [policy, *([minus] if minus else [])]
    over_trainings = [line.returns.mean(axis=0) for line in lines]
    values = over_trainings[0] - (over_trainings[1] if minus else 0.0)
    mean, error, interval = mean_estimate(list(values))
    if interval is None or (of_algorithms and any(x.is_trained and len(x.returns) == 1 for x in lines)):
        return MeanEstimate(mean, error, None)
    halves = [
        t_quantile(len(line.returns) - 1) * float(line.means.std(ddof=1)) / math.sqrt(len(line.returns))
        for line in lines
        if len(line.returns) > 1
    ]
    if not halves:
        return MeanEstimate(mean, error, interval)
    half = math.hypot(interval[1] - mean, *halves)
    return MeanEstimate(mean, error, (mean - half, mean + half))


def columns_by_setpoint(setpoints: Sequence[float]) -> Iterator[tuple[float | None, list[int]]]:
    """Each setpoint with its column and, if there are several, all of them (None)."""
    yield from ((setpoint, [column]) for column, setpoint in enumerate(setpoints))
    if len(setpoints) > 1:
        yield None, list(range(len(setpoints)))


def algorithms_of(
    groups: Sequence[LineReturns], setpoints: Sequence[float], scores: Sequence[Mapping[float | None, Any]]
) -> list[Algorithm]:
    """The lines of all groups, at each setpoint and, if there are several, over all.

    The scores of each group are by setpoint. Differences are from the known policies of these labels.
    """
    known = {group.label: group for group in groups if group.source == KNOWN}
    lines = []
    for group, by_setpoint in zip(groups, scores, strict=True):
        seeds = len(group.returns) if group.is_trained else None
        for setpoint, columns in columns_by_setpoint(setpoints):
            name = group.label, group.source, setpoint, seeds
            if not len(group.returns):
                lines.append(Algorithm(*name, *[None] * 11))
                continue
            part = group.at(columns)
            differences: list[float | None] = []
            for label in (BEHAVIOUR, HUNDRED):
                reference = known.get(label) if group is not known.get(label) else None
                found = estimated(part, reference.at(columns)) if reference else None
                differences += [found.mean, _half(found)] if found else [None, None]
            found, means = estimated(part), part.means
            spread = float(means.std(ddof=1)) if len(means) > 1 else None
            ends = float(means.min()), float(means.max())
            numbers = found.mean, _half(found), *ends, spread, found.standard_error, by_setpoint[setpoint]
            lines.append(Algorithm(*name, *numbers, *differences))
    return lines


def _half(found: MeanEstimate) -> float | None:
    return None if found.interval is None else (found.interval[1] - found.interval[0]) / 2.0


CLAIM = (
    "± is half a 95 % interval for new trainings and new episodes. One seed has none: it speaks of its "
    "network, not of the algorithm"
)
DIGITS = 4  # of the largest number of a column
NARROW = 7  # columns for which a terminal has room
HEADINGS = {YOURS: "yours", KNOWN: "known policies"}


def printed(lines: Sequence[Algorithm], wide: bool) -> Table:
    """The lines over all setpoints, those of each source below a heading; not `wide` has room in a paper."""
    lines = [line for line in lines if line.setpoint == lines[-1].setpoint]
    of = dict(zip(Algorithm._fields, map(list, zip(*lines, strict=True)), strict=True))
    decimals = _decimals(of["mean_return"])
    lowest, highest = ([x if n else None for x, n in zip(of[end], of["seeds"], strict=True)] for end in ENDS)
    columns = {
        "label": of["algorithm"],
        "seeds": of["seeds"],
        "mean": _around(of["mean_return"], of["half_width"]),
        "lowest": _rounded(lowest, decimals),
        "highest": _rounded(highest, decimals),
        "score": _rounded(of["score"], 1),
        "- behaviour": _around(of["above_behaviour"], of["behaviour_half_width"]),
        "- optimized": _around(of["above_optimized"], of["optimized_half_width"]),
        "spread": _rounded(of["spread"], decimals),
        "error": _rounded(of["standard_error"], decimals),
    }
    if not any(columns["- behaviour"]):
        del columns["- behaviour"]
    names = list(columns) if wide else list(columns)[:NARROW]
    rows: list[Any] = []
    cells = zip(of["source"], zip(*(columns[name] for name in names), strict=True), strict=True)
    for source, of_source in groupby(cells, lambda pair: str(pair[0])):
        rows += [HEADINGS.get(source, f"trained on {source}"), *(row for _, row in of_source)]
    return Table(names, rows, most=None)


def differences_printed(differences: Sequence[Difference]) -> Table:
    """Differences of labels over all setpoints, with half the width of their intervals."""
    differences = [x for x in differences if x.setpoint == differences[-1].setpoint]
    halves = [x.interval and (x.interval[1] - x.interval[0]) / 2.0 for x in differences]
    around = _around([x.mean_difference for x in differences], halves)
    rows = [[x.policy, x.minus, text] for x, text in zip(differences, around, strict=True)]
    return Table(["label", "minus", "difference"], rows, most=None)


def _decimals(numbers: Sequence[float | None]) -> int:
    largest = max((abs(x) for x in numbers if x), default=1.0)
    return max(0, DIGITS - 1 - math.floor(math.log10(largest)))


def _rounded(numbers: Sequence[float | None], decimals: int) -> list[Number | None]:
    return [None if x is None else Number(f"{round(x, decimals) + 0.0:.{decimals}f}") for x in numbers]


def _around(numbers: Sequence[float | None], halves: Sequence[float | None]) -> list[Number | None]:
    """Numbers with half the width of their intervals, or a dash where there is none."""
    decimals = _decimals(numbers)
    widths = [x or Number("–") for x in _rounded(halves, decimals)]
    longest = max(map(len, widths), default=0)
    texts = zip(_rounded(numbers, decimals), widths, strict=True)
    return [text and Number(f"{text} ± {width.rjust(longest)}") for text, width in texts]
