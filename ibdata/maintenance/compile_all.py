"""Compiling ahead all that ibdata may need, so that no later process waits for it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ibdata.arguments import public
from ibdata.environment.settings import settings
from ibdata.environment.simulation import Lane, Simulation
from ibdata.errors import IbdataError
from ibdata.experiment import Experiment, load, shipped
from ibdata.generation.record import known_answer, warm_up
from ibdata.numerics.random import Purpose, Raw
from ibdata.policies import POLICIES
from ibdata.simulation.episodes import Ints
from ibdata.system.cache_folders import cache_folders

# Options that change which functions an experiment needs.
VARIATIONS = (
    ("setpoints=drifting", "start={burn_in: [1, 2]}", "output.latent=full", "output.dtype=float64"),
    ("output.latent=next", "start=uniform"),
    ("output.latent=false",),
)
# Policies around others, which need options.
AROUND = (
    "{kind: epsilon_greedy, base: bad, epsilon: 0.2}",
    "{kind: gaussian, base: optimized, scale: 0.1}",
    "{kind: sticky, base: random, kappa: 0.5}",
    "{kind: schedule, stages: [{base: optimized, steps: 2, epsilon: [1.0, 0.5]}]}",
)


class Compiled(NamedTuple):
    """The folder with the machine code, and the seconds that it took to compile what was missing."""

    folder: Path
    seconds: float


@public
def compile_all() -> Compiled:
    """Compile the simulator for every policy and option, and for the environments.

    Raises:
        IbdataError: There is no folder in which later processes would find the machine code.
    """
    start = time.perf_counter()
    if not cache_folders().lasting:
        raise IbdataError(
            "no cache folder can be written to, so nothing would be kept; set IBDATA_CACHE_DIR to one"
        )
    for experiment in _experiments():
        warm_up(experiment)
    known_answer("datasets that it makes will say reproducible: false")
    for setpoint in (50.0, "drifting"):
        for form in ("default", {"burn_in": [1, 2]}):
            _play(Simulation(settings(setpoint=setpoint, start=form), 2))
            lane = Lane(settings(setpoint=setpoint, start=form))
            _play(lane)
            lane.move((0.0, 0.0, 0.0), np.zeros(lane.draws, dtype=np.uint64))
    return Compiled(Path(cache_folders().folders[-1]), time.perf_counter() - start)


def _experiments() -> Iterator[Experiment]:
    """The shipped experiments, except those with code of others, and one for every policy and variation."""
    for name in shipped():
        experiment = load(name, ["episodes=1", "splits={}"])
        if not any(part.code_target for policy in experiment.policies for part in policy.everywhere()):
            yield experiment
    options = {kind: policy.model_fields.values() for kind, policy in POLICIES.items()}
    alone = [kind for kind, own in options.items() if not any(option.is_required() for option in own)]
    for block in (*alone, *AROUND):
        yield load("random", [f"policies=[{block}]"])
    yield from (load("random", variation) for variation in VARIATIONS)


def _play(simulation: Simulation) -> None:
    """Begin episodes and make a step: in all lanes, then in one."""
    for which in (simulation.everyone, simulation.everyone[:1]):
        simulation.reset(which, _zeros)
        simulation.step(which, np.zeros((len(which), 3), dtype=np.float32), _zeros)


def _zeros(lanes: Ints, purpose: Purpose, step: int, steps: int, slots: int) -> Raw:
    return np.zeros((steps, slots, len(lanes)), dtype=np.uint64)
