"""The columns of a dataset, derived from the table of variables: names, order, meaning, units and bounds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.dynamics import State
from ibdata.experiment import Experiment
from ibdata.policies import OBSERVATION
from ibdata.variables import FLOATS, INTEGERS, VARIABLES, of_role, variable_of
from ibdata.views.options import ViewOptions

Table = npt.NDArray[np.floating[Any]]  # (columns, rows), float32 or float64


class Column(NamedTuple):
    """A column of a dataset."""

    name: str
    role: str
    dtype: str
    unit: str
    low: float | None
    high: float | None
    description: str
    variable: str | None = None  # the variable of the state that it holds
    later: bool = False  # the value at t + 1, not at t

    def form(self) -> dict[str, Any]:
        """The column as a dataset's files describe it."""
        described = self._asdict()
        del described["variable"], described["later"]
        return described


def latent_variables(experiment: Experiment) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The hidden variables and the derived values that an experiment's dataset holds."""
    latent = experiment.output.latent
    return (
        hidden(experiment.drifting) if latent else (),
        of_role("derived") if latent == "full" else (),
    )


def hidden(drifting: bool) -> tuple[str, ...]:
    """The variables of the Markov state that are not observed."""
    return of_role("latent", "drift") if drifting else of_role("latent")


def columns(experiment: Experiment) -> list[Column]:
    """The columns of an experiment's dataset, in their order."""
    dtype = experiment.output.dtype
    latent, derived = latent_variables(experiment)

    def of(prefix: str, role: str, names: tuple[str, ...], when: str, later: bool) -> list[Column]:
        return [
            Column(f"{prefix}{x}", role, dtype, v.unit, v.low, v.high, f"{v.meaning}{when}", x, later)
            for x in names
            for v in (VARIABLES[x],)
        ]

    return [
        Column("episode", "index", "int64", "1", 0, None, "running number of the episode"),
        Column("step", "index", "int32", "1", 0, None, "step t within the episode"),
        *of("obs_", "observation", OBSERVATION, ", at t", False),
        *(
            Column(f"act_{x}", "action", dtype, "1", -1, 1, f"proposed change of {x}, at t (always float32)")
            for x in ("velocity", "gain", "shift")
        ),
        *of("", "reward", ("reward",), "", True),
        Column("terminated", "flag", "bool", "1", 0, 1, "always false: the benchmark never ends by itself"),
        Column("truncated", "flag", "bool", "1", 0, 1, "true on the last row of an episode"),
        *of("next_obs_", "next_observation", OBSERVATION, ", at t + 1", True),
        *of("latent_", "latent", (*latent, *derived), ", at t", False),
        *(
            of("next_latent_", "next_latent", latent, ", at t + 1", True)
            if experiment.output.latent == "next"
            else []
        ),
        Column("policy", "policy", "string", "1", None, None, "label of the behaviour policy"),
        Column(
            "action_log_prob", "log_prob", dtype, "1", None, None,
            "log density of the action: Lebesgue measure on (-1, 1) plus unit masses at ±1 and at a base "
            "policy's own action",
        ),
    ]  # fmt: skip


class Layout(NamedTuple):
    """The mapping of a rollout's record to float columns."""

    names: tuple[str, ...]  # of the float columns
    rows: npt.NDArray[np.int64]  # the variables of the record, see `kernel.simulate`
    sources: npt.NDArray[np.int64]  # triples (variable of the record, column, 1 if it is taken at t + 1)
    first_action: int
    log_prob: int


def layout(experiment: Experiment) -> Layout:
    """The float columns of an experiment's dataset and where their values come from."""
    floats = [c for c in columns(experiment) if c.dtype == experiment.output.dtype]
    names = tuple(c.name for c in floats)
    recorded = list(dict.fromkeys(c.variable for c in floats if c.variable is not None))
    return Layout(
        names,
        record_rows(recorded),
        np.array([(recorded.index(c.variable), i, c.later) for i, c in enumerate(floats) if c.variable]),
        names.index("act_velocity"),
        names.index("action_log_prob"),
    )


def observed_rows(view: ViewOptions, drifting: bool) -> npt.NDArray[np.int64]:
    """The rows, see `record_rows`, of the variables that a view observes."""
    return record_rows([variable_of(name) for name in view.columns(drifting)])


def values_of(state: State, rows: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
    """The values of variables in a state of n lanes, (n, rows), as a dataset holds them."""
    values: npt.NDArray[np.float32] = (np.concatenate(state)[rows].T + 0.0).astype(np.float32)
    return values


def record_rows(names: Sequence[str]) -> npt.NDArray[np.int64]:
    """The rows of variables in a state's floats followed by its integers."""
    below = (*FLOATS, *INTEGERS)
    return np.array([below.index(name) for name in names])
