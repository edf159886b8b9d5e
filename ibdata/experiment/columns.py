"""The columns of a dataset, derived from the table of variables: names, order, meaning, units and bounds."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.experiment import Experiment
from ibdata.policies import OBSERVATION
from ibdata.simulation.variables import hidden, record_rows
from ibdata.variables import VARIABLES, of_role


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


def columns(experiment: Experiment) -> list[Column]:
    """The columns of an experiment's dataset, in their order."""
    dtype = experiment.output.dtype
    chosen = experiment.output.latent
    latent = hidden(experiment.drifting) if chosen else ()
    derived = of_role("derived") if chosen == "full" else ()

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
        *of("next_latent_", "next_latent", latent if chosen == "next" else (), ", at t + 1", True),
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
