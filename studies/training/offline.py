"""Offline algorithms of d3rlpy on the rows of a dataset, under the protocol of docs/baselines.md."""

from __future__ import annotations

import copy
import dataclasses
import importlib.metadata
import time
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import d3rlpy
import numpy as np
import numpy.typing as npt
import torch
from d3rlpy.dataset import TransitionMiniBatch
from d3rlpy.models.encoders import VectorEncoderFactory
from d3rlpy.preprocessing import StandardObservationScaler

import ibdata
from ibdata.exporters._source import Source
from ibdata.exporters.d3rlpy import episode
from ibdata.policies import Needs
from ibdata.views.options import view_options

HISTORY, REWARD_SCALE, DISCOUNT = 30, 0.01, 0.97
STEPS, BATCH, HIDDEN = 15_000, 256, (64, 64)
FINE_TUNING = 3  # so many times fewer steps than the training before
PART = 65_536  # rows of which moments are computed at once
CONSTANT = 1e-4  # the greatest deviation of what is constant but for rounding
UNSEEN = 1e30  # what is divided by it is lost in any sum; a network cannot be saved with infinity
# d3rlpy's default, 40,000 steps, is longer than the training here.
OWN: dict[str, dict[str, Any]] = {
    "bear": {"warmup_steps": STEPS // 10},
    # The penalty's weight is alpha · conservative_weight; without learning, alpha stays 1.
    "cql-50": {"initial_alpha": 1.0, "alpha_learning_rate": 0.0, "conservative_weight": 50.0},
}
CONFIGS = {
    "bc": "BC",
    "td3+bc": "TD3PlusBC",
    "iql": "IQL",
    "cql": "CQL",
    "cql-50": "CQL",
    "bcq": "BCQ",
    "bear": "BEAR",
}
Floats = npt.NDArray[np.float64]
Float32s = npt.NDArray[np.float32]


class Rows(NamedTuple):
    """All episodes in d3rlpy's form, one after another; each ends with a row that is no transition."""

    observations: Float32s  # (m, 6 · history)
    actions: Float32s  # (m, 3)
    rewards: Float32s  # (m, 1)
    transitions: npt.NDArray[np.int64]  # (n,), the rows that are transitions

    def batch(self, at: npt.NDArray[np.int64]) -> TransitionMiniBatch:
        """The transitions in some rows. The next observation and action are in the row after each."""
        never = np.zeros((len(at), 1), np.float32)
        return TransitionMiniBatch(
            observations=self.observations[at],
            actions=self.actions[at],
            rewards=self.rewards[at],
            next_observations=self.observations[at + 1],
            next_actions=self.actions[at + 1],
            terminals=never,  # the Industrial Benchmark never ends by itself
            intervals=never + 1,
            transitions=[],
        )

    def first(self, episodes: int) -> Rows:
        """The first episodes."""
        ends = np.setdiff1d(np.arange(len(self.actions)), self.transitions)
        stop = ends[episodes - 1] + 1
        kept = self.transitions[self.transitions < stop]
        return Rows(self.observations[:stop], self.actions[:stop], self.rewards[:stop], kept)

    def moments(self) -> tuple[Floats, Floats]:
        """The mean and the standard deviation of each column of the observations of all transitions."""
        n = len(self.transitions)
        parts = [self.transitions[i : i + PART] for i in range(0, n, PART)]
        mean = np.sum([self.observations[p].sum(axis=0, dtype=np.float64) for p in parts], axis=0) / n
        squares = [((self.observations[p] - mean) ** 2).sum(axis=0) for p in parts]
        return mean, np.sqrt(np.sum(squares, axis=0) / n)


def joined(parts: Sequence[Rows]) -> Rows:
    """The episodes of all parts."""
    starts = np.cumsum([0, *(len(part.actions) for part in parts)])
    transitions = [start + part.transitions for start, part in zip(starts, parts, strict=False)]
    return Rows(
        np.concatenate([part.observations for part in parts]),
        np.concatenate([part.actions for part in parts]),
        np.concatenate([part.rewards for part in parts]),
        np.concatenate(transitions),
    )


def rows_of(dataset: ibdata.Dataset, history: int = HISTORY, **conditions: Any) -> Rows:
    """The rows of a dataset under some conditions, with stacked observations and scaled rewards."""
    options = view_options(reward_scale=REWARD_SCALE)
    source = Source(dataset.select(**conditions), history=history, options=options)
    size = source.rows + source.episodes
    observations = np.empty((size, 6 * history), np.float32)
    actions, rewards = np.empty((size, 3), np.float32), np.empty((size, 1), np.float32)
    transitions = np.ones(size, bool)
    stop = 0
    for block in source.episode_blocks():
        arrays = episode(block)
        start, stop = stop, stop + len(arrays["actions"])
        observations[start:stop] = arrays["observations"]
        actions[start:stop] = arrays["actions"]
        rewards[start:stop] = arrays["rewards"]
        transitions[stop - 1] = False
    return Rows(observations, actions, rewards, np.flatnonzero(transitions))


def config_of(algorithm: str, **changes: Any) -> Any:
    """The configuration of an algorithm: d3rlpy's, except for what the protocol sets."""
    kind = getattr(d3rlpy.algos, f"{CONFIGS[algorithm]}Config")
    names = {field.name for field in dataclasses.fields(kind)}
    encoders = {
        name: VectorEncoderFactory(list(HIDDEN)) for name in names if name.endswith("encoder_factory")
    }
    discount = {"gamma": DISCOUNT} if "gamma" in names else {}
    return kind(batch_size=BATCH, **discount, **encoders, **OWN.get(algorithm, {}), **changes)


class Drawing:
    """A policy that draws actions and takes the best one, with random numbers that ibdata gives it."""

    needs = Needs(history=HISTORY, draws=1)

    def __init__(self, learned: Any) -> None:
        self.learned = learned

    def act(self, history: Floats, u: Floats) -> Float32s:
        """Actions (n, 3) for observations (n, HISTORY, 6); a uniform number each is the seed of the draws."""
        actions = []
        for one, uniform in zip(history.astype(np.float32).reshape(len(history), -1), u[:, 0], strict=True):
            torch.manual_seed(int(uniform * 2**53))
            actions.append(self.learned.predict(one[None])[0])
        return np.array(actions)


def policy_of(algorithm: str, learned: Any) -> Any:
    """The policy of an algorithm, as `ibdata.evaluate` takes it with history=HISTORY."""
    return Drawing(learned) if algorithm in ("bcq", "bear") else learned


def hyperparameters(config: Any) -> dict[str, Any]:
    """The protocol, and all numbers and texts of a configuration."""
    plain = {name: value for name, value in vars(config).items() if type(value) in (int, float, str)}
    protocol = {"history": HISTORY, "reward_scale": REWARD_SCALE, "hidden_units": list(HIDDEN)}
    return {**protocol, **plain}


def seen_spread(std: Floats, blind: bool = False) -> Floats:
    """What observations are divided by, which hides what is constant in the data, or all setpoints."""
    spread = np.where(std > CONSTANT, std, UNSEEN)
    if blind:
        spread[::6] = UNSEEN
    return spread


def train(
    algorithm: str,
    rows: Rows,
    seed: int,
    steps: int = STEPS,
    after: Callable[[int, Any], None] | None = None,
    before: Any = None,
    blind: bool = False,
) -> tuple[Any, dict[str, Any]]:
    """Train an algorithm. Return its last policy, and the fields of a baseline that describe the training.

    One thread of torch and one seed of all random numbers, so that a run does not depend on those before it.
    `after` is called with the number of steps so far and the policy, after each of them. `before` is a policy
    from which the training goes on, by fewer steps; a `blind` policy does not see the setpoint.
    """
    torch.set_num_threads(1)
    d3rlpy.seed(seed)
    mean, std = rows.moments()
    scaler = StandardObservationScaler(mean=mean, std=seen_spread(std, blind))
    config = config_of(algorithm, observation_scaler=scaler)
    if before is None:
        learned = config.create()
        learned.create_impl((rows.observations.shape[1],), 3)
    else:
        learned, steps = copy.deepcopy(before), steps // FINE_TUNING
    draws = np.random.default_rng(seed)
    wall, cpu = time.perf_counter(), time.process_time()
    for step in range(steps):
        at = rows.transitions[draws.integers(len(rows.transitions), size=BATCH)]
        learned.update(rows.batch(at))
        if after is not None:
            after(step + 1, learned)
    return learned, {
        "training_steps": steps,
        **spent(wall, cpu),
        "hyperparameters": hyperparameters(config),
        "versions": versions("d3rlpy", "torch", "numpy"),
    }


def spent(wall: float, cpu: float) -> dict[str, float]:
    """The seconds since a training began."""
    return {
        "seconds": round(time.perf_counter() - wall, 1),
        "cpu_seconds": round(time.process_time() - cpu, 1),
    }


def versions(*libraries: str) -> dict[str, str]:
    """The versions of ibdata and of the libraries that trained a policy."""
    return {"ibdata": ibdata.__version__, **{name: importlib.metadata.version(name) for name in libraries}}
