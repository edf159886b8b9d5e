"""Writing the weights of a trained network to a file that `kind: network` reads.

Nothing is imported from the library that trained it: its objects are read by the names of their parts.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.errors import UsageError
from ibdata.policies.safetensors import written
from ibdata.policies.weights_file import COLUMNS, LAYOUT, denormal, kept
from ibdata.system.atomic_files import write
from ibdata.system.guard import refusals

ACTIVATIONS = {"ReLU": "relu", "Tanh": "tanh"}
IGNORED = ("Flatten", "Identity", "Dropout")  # they change nothing in a trained network that sees vectors
SAC_BOUNDS = (-20.0, 2.0)  # to which Stable-Baselines3 clamps log standard deviations
KNOWN = "a Stable-Baselines3 or d3rlpy algorithm, or a torch Sequential of Linear, ReLU and Tanh"


class _Actor(NamedTuple):
    """An actor: its hidden layers and what follows them."""

    hidden: list[Any]  # modules
    mean: Any  # a Linear
    squash: str
    log_std: Any = None  # a Linear, or numbers (3,)
    bounds: tuple[float, float] = SAC_BOUNDS
    scaling: Mapping[str, Any] = {}  # mean, std and clip, if the library scales observations itself


def save_network(
    path: str | os.PathLike[str],
    model: Any,
    *,
    mean: npt.ArrayLike | None = None,
    std: npt.ArrayLike | None = None,
    clip: float | None = None,
    history: int = 1,
    provenance: str = "",
) -> str:
    """Write the actor of a trained model to a file of weights, for `kind: network` and `kind: sampled`.

    The network sees clip((o - mean) / std), where o are the latest observations, newest first, flattened to
    (6 · history,) as in `ibdata.environment` and in exports.

    Args:
        path: The file, such as actor.safetensors. An existing one is replaced.
        model: SAC, TD3 or PPO of Stable-Baselines3, an algorithm of d3rlpy with an actor, or a
            `torch.nn.Sequential` of Linear, ReLU and Tanh with 3 outputs, the means. If its last module is
            Tanh, actions are its outputs; otherwise they are the outputs clipped to [-1, 1].
        mean: Subtracted from the observations: 6 numbers, or 6 · history. By default what a VecNormalize or a
            StandardObservationScaler of the model subtracts, else 0.
        std: The divisors of the observations; by default as for the mean, else 1.
        clip: The largest absolute value of an input; by default that of VecNormalize, else none.
        history: The number of observations that the network sees.
        provenance: A text about the origin of the weights, which is kept in the file.

    Returns:
        The SHA-256 of the file, which identifies the policy.

    Raises:
        UsageError: The model has another form, or other numbers of inputs and outputs.
    """
    try:
        actor = _actor(model)
        tensors, activation = _tensors(actor)
    except AttributeError as error:
        raise UsageError(f"model: found {type(model).__name__} ({error}), expected {KNOWN}") from None
    given = {"mean": mean, "std": std, "clip": clip}
    scaling = {"mean": np.zeros(COLUMNS), "std": np.ones(COLUMNS), **actor.scaling}
    scaling |= {key: value for key, value in given.items() if value is not None}
    metadata = {
        "layout": LAYOUT,
        "frames": str(history),
        **{key: json.dumps(np.asarray(value, dtype=np.float64).tolist()) for key, value in scaling.items()},
        "activation": activation,
        "squash": actor.squash,
        "provenance": provenance,
    }
    if actor.log_std is not None:
        low, high = actor.bounds
        metadata |= {"log_std": "clamp", "log_std_low": repr(float(low)), "log_std_high": repr(float(high))}
    data = written(tensors, metadata)
    try:
        weights = kept(data)
    except ValueError as error:
        raise UsageError(f"model: {error}") from None
    target = Path(path).absolute()
    with refusals(target):
        write(target.parent, target.name, data)
    return weights.sha256


def _actor(model: Any) -> _Actor:
    """The actor of a model. Raises AttributeError if it is none that is known."""
    if hasattr(model, "impl"):
        return _of_d3rlpy(model)
    if hasattr(model, "get_vec_normalize_env"):
        return _of_stable_baselines(model)
    *hidden, last = _modules(model)
    tanh = type(last).__name__ == "Tanh"
    *hidden, last = hidden if tanh else [*hidden, last]
    return _Actor(hidden, last, "tanh" if tanh else "clip")


def _of_stable_baselines(model: Any) -> _Actor:
    _refuse_other_bounds(model.action_space.low, model.action_space.high)
    if getattr(model, "use_sde", False):
        raise UsageError("model: found use_sde=True, whose noise depends on earlier steps; expected False")
    found, scaling = model.get_vec_normalize_env(), {}
    if found is not None and found.norm_obs:
        std = np.sqrt(found.obs_rms.var + found.epsilon)
        scaling = {"mean": found.obs_rms.mean.ravel(), "std": std.ravel(), "clip": found.clip_obs}
    policy = model.policy
    if not hasattr(policy, "actor"):  # PPO
        extractor, hidden = policy.pi_features_extractor, policy.mlp_extractor.policy_net
        mean, squash, log_std, bounds = policy.action_net, "clip", _numbers(policy.log_std), (-20.0, 20.0)
    elif hasattr(policy.actor, "latent_pi"):  # SAC
        extractor, hidden = policy.actor.features_extractor, policy.actor.latent_pi
        mean, squash, log_std, bounds = policy.actor.mu, "tanh", policy.actor.log_std, SAC_BOUNDS
    else:  # TD3
        return _actor(policy.actor.mu)._replace(scaling=scaling)
    modules = [*_modules(extractor), *_modules(hidden)]
    return _Actor(modules, mean, squash, log_std, bounds, scaling)


def _of_d3rlpy(model: Any) -> _Actor:
    if model.impl is None:
        raise UsageError("model: found an algorithm of d3rlpy that is not built, expected a trained one")
    if (scaler := model.config.action_scaler) is not None:
        _refuse_other_bounds(scaler.minimum, scaler.maximum)
    scaling = {}
    if (scaler := model.config.observation_scaler) is not None:
        scaling = {"mean": scaler.mean, "std": scaler.std + scaler.eps}
    policy = model.impl.policy
    hidden = _modules(policy._encoder)
    if hasattr(policy, "_fc"):  # deterministic
        return _Actor(hidden, policy._fc, "tanh", scaling=scaling)
    # With a parameter (IQL, AWAC), the distribution that was trained is not that of a draw before the tanh.
    log_std = None if policy._use_std_parameter else policy._logstd
    return _Actor(hidden, policy._mu, "tanh", log_std, (policy._min_logstd, policy._max_logstd), scaling)


def _refuse_other_bounds(low: Any, high: Any) -> None:
    if not (np.all(np.asarray(low) == -1.0) and np.all(np.asarray(high) == 1.0)):
        raise UsageError(f"model: found actions from {low} to {high}, expected -1 to 1")


def _modules(module: Any) -> list[Any]:
    """The innermost modules of a torch module, in order, without those that change nothing."""
    every = (part for _, part in module.named_modules(remove_duplicate=False))  # one ReLU may occur twice
    inner = [part for part in every if not list(part.children())]
    return [part for part in inner if type(part).__name__ not in IGNORED]


def _numbers(parameter: Any) -> npt.NDArray[np.float32]:
    """The numbers of a parameter; 0 in place of denormal ones, which some machines take for 0."""
    numbers = np.asarray(parameter.detach().cpu().numpy(), dtype=np.float32)
    return np.where(denormal(numbers), np.float32(0.0), numbers)


def _tensors(actor: _Actor) -> tuple[dict[str, npt.NDArray[np.float32]], str]:
    """The tensors of a file of weights, and the activation of the hidden layers."""
    linear, activations = actor.hidden[::2], [type(part).__name__ for part in actor.hidden[1::2]]
    if len(actor.hidden) % 2 or len(set(activations)) > 1 or not set(activations) <= set(ACTIVATIONS):
        names = ", ".join(type(part).__name__ for part in [*actor.hidden, actor.mean])
        raise UsageError(f"model: found {names}, expected Linear and ReLU, or Linear and Tanh, in turn")
    tensors: dict[str, npt.NDArray[np.float32]] = {}
    for i, part in enumerate(linear):
        tensors |= _of_linear(f"layers.{i}", part)
    tensors |= _of_linear("mean", actor.mean)
    if isinstance(actor.log_std, np.ndarray):
        tensors["log_std.bias"] = actor.log_std.reshape(-1)
    elif actor.log_std is not None:
        tensors |= _of_linear("log_std", actor.log_std)
    return tensors, ACTIVATIONS[activations[0]] if activations else "relu"


def _of_linear(name: str, part: Any) -> dict[str, npt.NDArray[np.float32]]:
    weight = _numbers(part.weight)
    bias = np.zeros(len(weight), dtype=np.float32) if part.bias is None else _numbers(part.bias)
    return {f"{name}.weight": weight, f"{name}.bias": bias}
