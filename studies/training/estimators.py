"""Target policies of studies/selection.md and estimators of their values.

A target is a network with noise, which gives it densities; the networks are checkpoints of the baselines'
training. Their values are estimated by importance sampling, fitted Q evaluation and a learned model.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import d3rlpy
import numpy as np
import numpy.typing as npt
import torch
from d3rlpy.models.encoders import VectorEncoderFactory
from d3rlpy.ope import FQE, FQEConfig
from d3rlpy.preprocessing import StandardObservationScaler
from torch.special import ndtr, ndtri

import ibdata
from ibdata._numerics.arrays import Bools, Float32s
from ibdata.dynamics.setpoint import D_G, D_H, D_V
from ibdata.evaluation.importance import Importance
from ibdata.policies import Decision, Distribution
from ibdata.policies.base import Needs, Observed, at_start
from ibdata.policies.network import Network
from ibdata.policies.weights_file import read
from training.learned_model import Model, fitted_network
from training.offline import DISCOUNT, HIDDEN, HISTORY, REWARD_SCALE, STEPS, Rows, train
from training.protocol import LITERATURE
from training.selection import Checkpoint

SEED = 0  # of the training
SCALE = 0.3  # of the noise
EDGE = 1.0 - 2.0**-24  # the greatest number below 1 of float32
LOG_SQRT_2PI = 0.5 * math.log(2.0 * math.pi)
Floats = npt.NDArray[np.float64]
HORIZON = int(LITERATURE["steps"])
DISCOUNTS = DISCOUNT ** np.arange(HORIZON)
FITS, FIT_STEPS, FIT_BATCH, LEARNING_RATE = HORIZON, 50, 100, 3e-4  # of Q
STARTS = 1000  # from which Q and the model are averaged
FRAMES, EXAMPLES = 10, 3_000_000  # of the model
STEERED, PREDICTED = slice(0, 4), slice(4, 6)  # of an observation
CHANGES = np.array([D_V, D_G, D_H])  # of velocity, gain and shift by an action of 1


class TruncatedNormal(Distribution):
    """N(mean, SCALE²) for each number of an action, truncated to (-1, 1). So no action is at ±1.

    Args:
        mean: (n, 3), before the truncation, in [-1, 1], a tensor.
    """

    draws = 3

    def __init__(self, mean: Any) -> None:
        self.mean = mean

    def sample(self, u: Floats) -> Floats:
        actions: Floats = drawn(self.mean, torch.from_numpy(u)).numpy()
        return actions

    def log_density(self, action: Float32s) -> Floats:
        density: Floats = log_density(self.mean, torch.from_numpy(action.astype(np.float64))).numpy()
        return density

    def atoms(self, action: Float32s) -> Bools:
        return np.zeros(action.shape, dtype=np.bool_)


def drawn(mean: Any, u: Any) -> Any:
    """Actions: draws of N(mean, SCALE²), truncated to (-1, 1), by the inverse of the distribution function.

    Args:
        mean: the mean actions (n, 3) before the truncation, in [-1, 1], a tensor.
        u: uniform random numbers (n, 3), a tensor.
    """
    low, high = ndtr((-1.0 - mean) / SCALE), ndtr((1.0 - mean) / SCALE)
    return (mean + SCALE * ndtri(low + (high - low) * u)).clamp(-EDGE, EDGE)


def log_density(mean: Any, action: Any) -> Any:
    """The log density (n,) of `drawn` at actions (n, 3)."""
    z = (action - mean) / SCALE
    inside = ndtr((1.0 - mean) / SCALE) - ndtr((-1.0 - mean) / SCALE)
    return (-0.5 * z**2 - math.log(SCALE) - LOG_SQRT_2PI - inside.log()).sum(1)


class Target:
    """A network with noise, as `ibdata.evaluate` and `ibdata.importance` take it."""

    needs = Needs(history=HISTORY, draws=3)

    def __init__(self, file: Path | str) -> None:
        self.network = Network(file=str(file))

    @property
    def sha256(self) -> str:
        """That of the file."""
        return str(self.network.sha256)

    def mean(self, history: Float32s) -> Any:
        """The network's actions (n, 3) for observations (n, HISTORY, 6)."""
        return torch.from_numpy(self.network.decide(at_start(history, self.network.needs)).action)

    def decide(self, observed: Observed) -> Decision:
        """The distribution of the actions."""
        return Decision(TruncatedNormal(self.mean(observed.observations)), observed.memory)


def write_checkpoints(checkpoints: list[Checkpoint], rows: Rows, folder: Path) -> None:
    """Train an algorithm as `studies/baselines` does, up to the last of some checkpoints, and write these."""
    by_steps = {checkpoint.training_steps: checkpoint for checkpoint in checkpoints}

    def keep(step: int, learned: Any) -> None:
        if one := by_steps.get(step):
            path = one.file(folder)
            path.parent.mkdir(parents=True, exist_ok=True)
            provenance = f"{one.algorithm} on {one.set}, seed {SEED}, {step} of {STEPS} steps"
            ibdata.save_network(path, learned, history=HISTORY, provenance=provenance)

    train(checkpoints[0].algorithm, rows, SEED, max(by_steps), keep)


def by_importance(start: ibdata.Dataset, target: Target) -> Importance:
    """The estimates by importance sampling, from the first HORIZON steps of the episodes of a set."""
    return ibdata.importance(start, target, discount=DISCOUNT)


def starts(rows: Rows) -> npt.NDArray[np.float32]:
    """The first stacked observations of the episodes, repeated or cut to STARTS."""
    first = rows.transitions[~np.isin(rows.transitions - 1, rows.transitions)]
    return rows.observations[np.resize(first, STARTS)]


class Adapter:
    """A target policy as d3rlpy's FQE takes it: something with an `impl`, which says the next actions."""

    def __init__(self, target: Target) -> None:
        self.impl = self
        weights = target.network.weights
        tensors, metadata = read(weights.data)
        if metadata["squash"] != "tanh" or metadata["activation"] != "relu":
            raise ValueError(f"found {metadata}, expected relu layers and a tanh at the end")
        self.scaler = StandardObservationScaler(mean=weights.mean, std=weights.std, eps=0.0)
        names = [name for name in tensors if name.startswith("layers.") and name.endswith(".weight")]
        self.layers = [
            tuple(torch.from_numpy(tensors[f"{name}.{part}"].copy()) for part in ("weight", "bias"))
            for name in [*(name.removesuffix(".weight") for name in sorted(names)), "mean"]
        ]

    def mean(self, x: Any) -> Any:
        """The network's actions (n, 3) for scaled observations (n, 6 · HISTORY)."""
        for weight, bias in self.layers[:-1]:
            x = torch.relu(torch.nn.functional.linear(x, weight, bias))
        return torch.tanh(torch.nn.functional.linear(x, *self.layers[-1]))

    def predict_best_action(self, x: Any) -> Any:
        """Draws of the target's actions (n, 3) for scaled observations (n, 6 · HISTORY)."""
        with torch.no_grad():
            mean = self.mean(x)
            return drawn(mean, torch.rand_like(mean))


def by_fqe(rows: Rows, target: Target, fits: int = FITS) -> float:
    """The mean return of a target policy, by d3rlpy's fitted Q evaluation.

    Q begins near 0 and is fitted FITS times to a reward plus the discounted Q of the fit before, so that it
    counts FITS rewards. Rewards are standardised, and the discounted sum of their mean is added again.
    """
    torch.set_num_threads(1)
    d3rlpy.seed(0)
    rewards = rows.rewards[rows.transitions].astype(np.float64)
    mean, std = float(rewards.mean()), float(rewards.std())
    scaled = rows._replace(rewards=((rows.rewards - mean) / std).astype(np.float32))
    adapter = Adapter(target)
    config = FQEConfig(
        learning_rate=LEARNING_RATE,
        batch_size=FIT_BATCH,
        gamma=DISCOUNT,
        encoder_factory=VectorEncoderFactory(list(HIDDEN)),
        target_update_interval=FIT_STEPS,
        observation_scaler=adapter.scaler,
    )
    fqe = FQE(adapter, config)
    fqe.create_impl((rows.observations.shape[1],), 3)
    draws = np.random.default_rng(0)
    for _ in range(fits * FIT_STEPS):
        at = rows.transitions[draws.integers(len(rows.transitions), size=FIT_BATCH)]
        fqe.update(scaled.batch(at))
    seen = starts(rows)
    actions = adapter.predict_best_action(adapter.scaler.transform(torch.from_numpy(seen))).numpy()
    q = fqe.predict_value(seen, actions).mean(dtype=np.float64)
    return float((std * q + mean * DISCOUNTS[:fits].sum()) / REWARD_SCALE)


def fitted_model(rows: Rows) -> Model:
    """A network that predicts fatigue and consumption, as in docs/quality.md, fitted to a whole set.

    Predictions are clipped to what occurs in the set, so that a rollout cannot diverge.
    """
    from threadpoolctl import threadpool_limits

    threadpool_limits(1)
    x = features(rows.observations[rows.transitions], rows.observations[rows.transitions + 1, STEERED])
    y = rows.observations[rows.transitions + 1, PREDICTED].astype(np.float64)
    network = fitted_network(x, y, passes=max(1, EXAMPLES // len(x)))
    low, high = y.min(axis=0), y.max(axis=0)
    return lambda x: np.clip(network(x), low, high)


def features(stacked: npt.NDArray[Any], steered: npt.NDArray[Any]) -> Floats:
    """What the model sees: FRAMES observations, and the next setpoint, velocity, gain and shift."""
    return np.concatenate([stacked[:, : 6 * FRAMES], steered], axis=1, dtype=np.float64)


def by_model(rows: Rows, target: Target, model: Model) -> float:
    """The mean return of a target policy in a learned model, from the first observations of the episodes."""
    draws = np.random.default_rng(0)
    seen = starts(rows).astype(np.float64).reshape(STARTS, HISTORY, 6)
    total = 0.0
    for discount in DISCOUNTS:
        mean = target.mean(seen.astype(np.float32))
        action = drawn(mean, torch.from_numpy(draws.random((STARTS, 3)))).numpy()
        moved = np.clip(seen[:, 0, 1:4] + CHANGES * action, 0.0, 100.0)
        steered = np.concatenate([seen[:, 0, :1], moved], axis=1)
        after = np.concatenate([steered, model(features(seen.reshape(STARTS, -1), steered))], axis=1)
        total += discount * float(np.mean(-after[:, 5] - 3.0 * after[:, 4]))
        seen = np.concatenate([after[:, None], seen[:, :-1]], axis=1)
    return total
