"""The runs of studies/prototypes, asked by set, part of the set and algorithm; and their cells in tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.confidence import MeanEstimate, mean_estimate
from ibdata.evaluation.baselines import BEHAVIOUR, NOTHING, Baseline, ModelErrors

Floats = npt.NDArray[np.float64]
Settings = dict[str, Any]


class Results:
    """All runs."""

    def __init__(self, lines: Iterable[Baseline]) -> None:
        self.groups: dict[tuple[str, str, str], list[Baseline]] = {}
        for line in lines:
            self.groups.setdefault((line.set, line.trained_on, line.algorithm), []).append(line)

    def runs(self, name: str, part: str, algorithm: str) -> list[Baseline]:
        """The runs with all seeds."""
        return self.groups.get((name, part, algorithm), [])

    def returns(self, name: str, part: str, algorithm: str, settings: Settings) -> list[Floats]:
        """The returns (setpoints, episodes) of each seed in an evaluation."""
        evaluations = [e for run in self.runs(name, part, algorithm) for e in run.evaluations]
        values = [e.values for e in evaluations if e.settings == settings]
        return [each for each in values if each is not None]

    def known(self, name: str, policy: str, settings: Settings) -> Floats:
        """The returns of a known policy in the episodes of a set, whose behaviour it may be."""
        named = self.returns(name, NOTHING, policy, settings)
        return (named or self.returns(name, NOTHING, BEHAVIOUR, settings))[0]

    def standard_errors(self, name: str, settings: Settings) -> list[float]:
        """The standard errors of all that was learned from a set, in an evaluation."""
        groups = [runs for (of, part, _), runs in self.groups.items() if of == name and part != NOTHING]
        runs = [run for group in groups for run in group]
        evaluations = [e for run in runs for e in run.evaluations if e.settings == settings]
        return [e.standard_error for e in evaluations if e.standard_error is not None]

    def errors(self, part: str, algorithm: str, setpoint: float, steps: int) -> list[ModelErrors]:
        """The errors of the models of each seed in the transfer, at a setpoint after some steps."""
        lines = [e for run in self.runs("transfer", part, algorithm) for e in run.model_errors or []]
        return [e for e in lines if (e.setpoint, e.steps) == (setpoint, steps)]


def number(value: float, digits: int = 1) -> str:
    """A number with a minus sign."""
    return f"{value:.{digits}f}".replace("-", "−")


def over_seeds(values: Sequence[float], digits: int = 1) -> str:
    """The mean over seeds, and the lowest and the highest if there are several."""
    if not values:
        return "–"
    mean = number(float(np.mean(values)), digits)
    if len(values) == 1:
        return mean
    return f"{mean} ({number(min(values), digits)} to {number(max(values), digits)})"


def means(returns: Sequence[Floats], divisor: float = 100.0) -> list[float]:
    """The mean of each seed."""
    return [float(values.mean()) / divisor for values in returns]


def with_error(returns: Floats, divisor: float = 100.0, digits: int = 2) -> str:
    """The mean over episodes with its standard error."""
    return shown(mean_estimate(list(returns / divisor)), digits)


def shown(found: MeanEstimate, digits: int = 2) -> str:
    """A mean with its standard error."""
    return f"{number(found.mean, digits)} ± {number(found.standard_error or 0.0, digits)}"


def difference(returns: Sequence[Floats], base: Floats, divisor: float = 100.0) -> MeanEstimate:
    """The mean over seeds minus a policy, paired by episodes."""
    return mean_estimate(list((np.mean(returns, axis=0) - base) / divisor))
