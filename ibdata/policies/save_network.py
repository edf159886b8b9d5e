"""Writing the weights of a trained network to a file that `kind: network` reads.

Nothing is imported from the library that trained it: its objects are read by the names of their parts.
"""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.arguments import public
from ibdata.errors import UsageError, notice
from ibdata.policies.actors import Actor, actor_of, numbers
from ibdata.policies.base import SETPOINT
from ibdata.policies.libraries import environment_note, lacks_environment
from ibdata.policies.scaling import far_notes
from ibdata.policies.weights_file import ACTIONS, COLUMNS, LAYOUT, Weights, written
from ibdata.system.files import write
from ibdata.system.part import refusals

ACTIVATIONS = {"ReLU": "relu", "Tanh": "tanh"}
KNOWN = "a Stable-Baselines3 or d3rlpy algorithm, or a torch Sequential of Linear, ReLU and Tanh"
# The actions of the file and of the model are compared at so many scaled inputs, drawn from N(0, 4²).
INPUTS, DEVIATION, TOLERANCE = 256, 4.0, 1e-3


@public
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
        UsageError: The model has another form, other numbers of inputs and outputs, or other actions than its
            layers alone give; a wrapper of its environment changes observations or actions; or a model of
            Stable-Baselines3 has no environment, and mean and std are not given.
    """
    note = environment_note(model)
    if mean is std is None and lacks_environment(model):
        raise UsageError(
            "model: found no environment, which keeps VecNormalize, expected one (model.set_env), or mean "
            "and std, zeros and ones if it was trained on observations as they are"
        )
    try:
        actor = actor_of(model)
        tensors, activation = _tensors(actor)
    except UsageError:
        raise
    except (AttributeError, TypeError, ValueError) as error:
        raise UsageError(f"model: found {type(model).__name__} ({error}), expected {KNOWN}") from None
    chosen = {"mean": mean, "std": std, "clip": clip}
    scaling = {"mean": np.zeros(COLUMNS), "std": np.ones(COLUMNS), **actor.scaling}
    scaling |= {key: value for key, value in chosen.items() if value is not None}
    metadata = {
        "layout": LAYOUT,
        "frames": str(history),
        **{key: json.dumps(_plain(key, value)) for key, value in scaling.items()},
        "activation": activation,
        "squash": actor.squash,
        "provenance": provenance,
    }
    if actor.log_std is not None:
        low, high = actor.bounds
        metadata |= {"log_std": "clamp", "log_std_low": repr(float(low)), "log_std_high": repr(float(high))}
    data = written(tensors, metadata)
    try:
        weights = Weights(data)
    except ValueError as error:
        raise UsageError(f"model: {error}") from None
    _refuse_other_actions(model, actor, weights)
    target = Path(os.path.expanduser(path)).absolute()
    with refusals(target):
        write(target.parent, target.name, data)
    if note is not None and mean is std is None:
        notice(f"{target.name}: {note}, or pass mean and std")
    beside = weights.mean[SETPOINT] + (1.0 if weights.mean[SETPOINT] < 50.0 else -1.0)
    for said in far_notes({"mean": weights.mean, "std": weights.std}, [beside]):
        notice(f"{target.name}: {said}")
    return weights.sha256


def _refuse_other_actions(model: Any, actor: Actor, weights: Weights) -> None:
    """Raise UsageError if a model's own actions are not those of the weights."""
    drawn = DEVIATION * np.random.default_rng(0).standard_normal((INPUTS, len(weights.mean)))
    inputs = np.clip(drawn, -weights.clip, weights.clip).astype(np.float32)
    outputs = weights.outputs(inputs, is_scaled=True)[:, :ACTIONS].astype(np.float64)
    expected = np.tanh(outputs) if actor.squash == "tanh" else np.clip(outputs, -1.0, 1.0)
    try:
        actions = np.clip(np.asarray(actor.actions(inputs), dtype=np.float64), -1.0, 1.0)
        off = float(np.abs(actions - expected).max())
    except Exception as error:
        raise UsageError(f"model: its actions could not be compared ({error}); expected {KNOWN}") from None
    if not off <= TOLERANCE:
        raise UsageError(
            f"model: found {type(model).__name__}, whose actions are up to {off:.2g} from those of its "
            f"layers alone; expected {KNOWN}, which does nothing else"
        )


def _tensors(actor: Actor) -> tuple[dict[str, npt.NDArray[np.float32]], str]:
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


def _plain(option: str, value: npt.ArrayLike) -> Any:
    """A number, or a list of numbers, of an option."""
    try:
        return np.asarray(value, dtype=np.float64).tolist()
    except (TypeError, ValueError):
        raise UsageError(f"{option}: found {value!r}, expected numbers") from None


def _of_linear(name: str, part: Any) -> dict[str, npt.NDArray[np.float32]]:
    weight = numbers(part.weight)
    bias = np.zeros(len(weight), dtype=np.float32) if part.bias is None else numbers(part.bias)
    return {f"{name}.weight": weight, f"{name}.bias": bias}
