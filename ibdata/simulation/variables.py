"""The columns of a dataset: their names, order, meaning, units and bounds, for every experiment."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.experiment import Experiment
from ibdata.policies import OBSERVATION

Table = npt.NDArray[np.floating[Any]]  # (columns, rows), float32 or float64

ACTION = ("velocity", "gain", "shift")
LATENT = (*(f"theta_{lag}" for lag in range(1, 10)), "domain", "response", "direction", "mu_v", "mu_g")
DRIFT = ("drift_rate", "drift_left")
DERIVED = (
    "convolved_cost",
    "penalty",
    "expected_consumption",
    "effective_shift",
    "effective_velocity",
    "effective_gain",
    "alpha",
    "basic_fatigue",
)


class Variable(NamedTuple):
    """A variable of the benchmark: unit, lowest and highest value (None: unbounded), meaning."""

    unit: str
    low: float | None
    high: float | None
    description: str


class Column(NamedTuple):
    """A column of a dataset."""

    name: str
    role: str
    dtype: str
    unit: str
    low: float | None
    high: float | None
    description: str


VARIABLES: dict[str, Variable] = {
    "setpoint": Variable("1", 0, 100, "setpoint p, which no action changes"),
    "velocity": Variable("1", 0, 100, "velocity v"),
    "gain": Variable("1", 0, 100, "gain g"),
    "shift": Variable("1", 0, 100, "shift h"),
    "fatigue": Variable("cost", 0, 300, "fatigue f"),
    "consumption": Variable("cost", None, None, "consumption c, with its noise"),
    "reward": Variable("cost", None, None, "reward -c - 3f of the next observation"),
    **{
        f"theta_{lag}": Variable("cost", 0, 4915, f"operational cost θ, {lag} step{'s'[: lag > 1]} ago")
        for lag in range(1, 10)
    },
    "domain": Variable("1", -1, 1, "domain δ of the mis-calibration, -1 or 1"),
    "response": Variable("1", -1, 1, "response ψ of the mis-calibration, -1 or 1"),
    "direction": Variable("1", -6, 6, "direction φ of the mis-calibration, a whole number"),
    "mu_v": Variable("1", 0, 5, "latent μᵛ of the fatigue (velocity)"),
    "mu_g": Variable("1", 0, 5, "latent μᵍ of the fatigue (gain)"),
    "drift_rate": Variable("1/step", -100, 100, "rate b of the moving setpoint"),
    "drift_left": Variable("steps", -1, None, "steps left of the moving setpoint's segment"),
    "convolved_cost": Variable("cost", 0, 4915, "convolved operational cost θᶜ"),
    "penalty": Variable("1", -1.001, 1.24, "mis-calibration penalty m"),
    "expected_consumption": Variable("cost", None, None, "consumption without noise ĉ"),
    "effective_shift": Variable("1", -1.5, 1.5, "effective shift hᵉ"),
    "effective_velocity": Variable("1", 0, 1, "effective velocity vᵉ"),
    "effective_gain": Variable("1", 0, 1, "effective gain gᵉ"),
    "alpha": Variable("1", 0, 1, "amplification α of the fatigue"),
    "basic_fatigue": Variable("cost", 0, 300, "basic fatigue f_b"),
}


def latent_variables(experiment: Experiment) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The hidden variables and the derived values that an experiment's dataset holds."""
    latent = experiment.output.latent
    hidden = LATENT + (DRIFT if experiment.drifting else ())
    return (hidden if latent else ()), (DERIVED if latent == "full" else ())


def columns(experiment: Experiment) -> list[Column]:
    """The columns of an experiment's dataset, in their order."""
    dtype = experiment.output.dtype
    hidden, derived = latent_variables(experiment)

    def of(prefix: str, role: str, names: tuple[str, ...], when: str) -> list[Column]:
        return [
            Column(f"{prefix}{x}", role, dtype, v.unit, v.low, v.high, f"{v.description}{when}")
            for x in names
            for v in (VARIABLES[x],)
        ]

    return [
        Column("episode", "index", "int64", "1", 0, None, "running number of the episode"),
        Column("step", "index", "int32", "1", 0, None, "step t within the episode"),
        *of("obs_", "observation", OBSERVATION, " at t"),
        *(
            Column(f"act_{x}", "action", dtype, "1", -1, 1, f"proposed change of {x} at t, float32")
            for x in ACTION
        ),
        *of("", "reward", ("reward",), ""),
        Column("terminated", "flag", "bool", "1", 0, 1, "always false: the benchmark never ends by itself"),
        Column("truncated", "flag", "bool", "1", 0, 1, "true on the last row of an episode"),
        *of("next_obs_", "next_observation", OBSERVATION, " at t + 1"),
        *of("latent_", "latent", (*hidden, *derived), ", at t"),
        *(
            of("next_latent_", "next_latent", hidden, ", at t + 1")
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
    """How a rollout's record becomes float columns: pairs (variable of the record, float column)."""

    names: tuple[str, ...]  # of the float columns
    recorded: tuple[str, ...]  # variables of the record, see `kernel.record_state`
    at_t: npt.NDArray[np.int64]  # taken at t
    at_t_plus_1: npt.NDArray[np.int64]  # taken at t + 1
    first_action: int
    log_prob: int


def layout(experiment: Experiment) -> Layout:
    """The float columns of an experiment's dataset and where their values come from."""
    hidden, derived = latent_variables(experiment)
    recorded = (*OBSERVATION, "reward", *hidden, *derived)
    floats = [c for c in columns(experiment) if c.dtype == experiment.output.dtype]
    names = tuple(c.name for c in floats)
    sources = [
        (recorded.index(c.name.removeprefix("next_").removeprefix("obs_").removeprefix("latent_")), i, c.role)
        for i, c in enumerate(floats)
        if c.role not in ("action", "log_prob")
    ]
    later = ("reward", "next_observation", "next_latent")
    return Layout(
        names,
        recorded,
        np.array([(variable, i) for variable, i, role in sources if role not in later]),
        np.array([(variable, i) for variable, i, role in sources if role in later]),
        names.index("act_velocity"),
        names.index("action_log_prob"),
    )
