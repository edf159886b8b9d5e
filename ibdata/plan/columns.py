"""The columns of a dataset, derived from the table of variables: names, order, meaning, units and bounds."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata._simulation.episodes import hidden_variables, record_rows
from ibdata.experiment import Experiment
from ibdata.policies import OBSERVATION
from ibdata.views.variables import VARIABLES, of_role


class Column(NamedTuple):
    """A column of a dataset."""

    name: str
    role: str
    dtype: str
    unit: str
    low: float | None
    high: float | None
    description: str
    variable: str | None = None  # the variable of the state in this column
    later: bool = False  # whether the value is that at t + 1


def columns(experiment: Experiment) -> list[Column]:
    """The columns of an experiment's dataset, in their order."""
    dtype = experiment.output.dtype
    option = experiment.output.latent
    latent = hidden_variables(experiment.drifting) if option else ()
    derived = of_role("derived") if option == "full" else ()

    def state_columns(
        prefix: str, role: str, names: tuple[str, ...], when: str, later: bool
    ) -> Iterator[Column]:
        for name in names:
            variable = VARIABLES[name]
            meaning = f"{variable.meaning}{when}"
            bounds = variable.low, variable.high
            yield Column(f"{prefix}{name}", role, dtype, variable.unit, *bounds, meaning, name, later)

    def action_columns(prefix: str, role: str, meaning: str) -> Iterator[Column]:
        for setting in ("velocity", "gain", "shift"):
            what = f"{meaning} {setting}, at t (always float32)"
            yield Column(f"{prefix}{setting}", role, dtype, "1", -1, 1, what)

    answers = experiment.output.expert_action
    return [
        Column("episode", "index", "int64", "1", 0, None, "running number of the episode"),
        Column("step", "index", "int32", "1", 0, None, "step t within the episode"),
        *state_columns("obs_", "observation", OBSERVATION, ", at t", False),
        *action_columns("act_", "action", "proposed change of"),
        *state_columns("", "reward", ("reward",), "", True),
        Column("terminated", "flag", "bool", "1", 0, 1, "always false: the benchmark never ends by itself"),
        Column("truncated", "flag", "bool", "1", 0, 1, "true on the last row of an episode"),
        *state_columns("next_obs_", "next_observation", OBSERVATION, ", at t + 1", True),
        *state_columns("latent_", "latent", (*latent, *derived), ", at t", False),
        *state_columns("next_latent_", "next_latent", latent if option == "next" else (), ", at t + 1", True),
        Column("policy", "policy", "string", "1", None, None, "label of the behaviour policy"),
        Column(
            "action_log_prob", "log_prob", dtype, "1", None, None,
            "log density of the action: Lebesgue measure on (-1, 1) plus unit masses at ±1 and at a base "
            "policy's own action",
        ),
        *(action_columns("expert_act_", "expert_action", "the expert's change of") if answers else ()),
    ]  # fmt: skip


class Layout(NamedTuple):
    """How the record of a rollout fills the float columns."""

    names: tuple[str, ...]  # of the float columns
    rows: npt.NDArray[np.int64]  # the variables of the record, see `kernel.simulate`
    sources: npt.NDArray[np.int64]  # triples (variable of the record, column, 1 if it is taken at t + 1)
    first_action: int
    log_prob: int  # what stands after it is not recorded


def layout(experiment: Experiment) -> Layout:
    """The float columns of an experiment's dataset and where their values come from."""
    floats = [column for column in columns(experiment) if column.dtype == experiment.output.dtype]
    names = tuple(column.name for column in floats)
    recorded = list(dict.fromkeys(column.variable for column in floats if column.variable is not None))
    sources = [(recorded.index(c.variable), i, c.later) for i, c in enumerate(floats) if c.variable]
    ends = names.index("act_velocity"), names.index("action_log_prob")
    return Layout(names, record_rows(recorded), np.array(sources), *ends)
