"""Writing the weights of a trained network to a file that `kind: network` reads.

Nothing is imported from the library that trained it: its objects are read by the names of their parts.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import public
from ibdata._system.files import write
from ibdata._system.part import refusing_system_errors
from ibdata.errors import UsageError, notice
from ibdata.policies.libraries import environment_note, evaluating, lacks_environment, scaling_of
from ibdata.policies.weights_file import ACTION_COUNT, COLUMNS, NETWORK_LAYOUT, Weights, written

IGNORED = ("Flatten", "Identity", "Dropout")  # they change nothing in a trained network that sees vectors
DRAWN_BEFORE_TANH = ("SAC", "CQL", "CalQL")  # algorithms of d3rlpy
SAC_BOUNDS = (-20.0, 2.0)  # to which Stable-Baselines3 clamps log standard deviations


class Actor(NamedTuple):
    """An actor: its hidden layers and what follows them."""

    hidden: list[Any]  # modules
    mean: Any  # a Linear
    squash: str
    actions: Callable[[npt.NDArray[np.float32]], Any]  # (n, 3), of the model, for scaled inputs (n, k)
    log_std: Any = None  # a Linear, or numbers (3,)
    bounds: tuple[float, float] = SAC_BOUNDS
    scaling: Mapping[str, Any] = {}  # mean, std and clip, if the library scales observations itself


def actor_of(model: Any) -> Actor:
    """The actor of a model. Raises AttributeError if it is none that is known."""
    if hasattr(model, "impl"):
        return _of_d3rlpy(model)
    if hasattr(model, "get_vec_normalize_env"):
        return _of_stable_baselines(model)
    *hidden, last = _modules(model)
    tanh = type(last).__name__ == "Tanh"
    *hidden, last = hidden if tanh else [*hidden, last]

    def actions(inputs: npt.NDArray[np.float32]) -> Any:
        with evaluating(model):
            return model(last.weight.new_tensor(inputs)).detach().cpu().numpy()

    return Actor(hidden, last, "tanh" if tanh else "clip", actions)


def _of_stable_baselines(model: Any) -> Actor:
    _refuse_other_bounds(model.action_space.low, model.action_space.high)
    if getattr(model, "use_sde", False):
        raise UsageError("model: found use_sde=True, whose noise depends on earlier steps; expected False")

    def actions(inputs: npt.NDArray[np.float32]) -> Any:
        seen = inputs.reshape(len(inputs), *model.observation_space.shape)
        return model.predict(seen, deterministic=True)[0]

    policy = model.policy
    if not hasattr(policy, "actor"):  # PPO
        extractor, hidden = policy.pi_features_extractor, policy.mlp_extractor.policy_net
        mean, squash, log_std, bounds = policy.action_net, "clip", numbers(policy.log_std), (-20.0, 20.0)
    elif hasattr(policy.actor, "latent_pi"):  # SAC
        extractor, hidden = policy.actor.features_extractor, policy.actor.latent_pi
        mean, squash, log_std, bounds = policy.actor.mu, "tanh", policy.actor.log_std, SAC_BOUNDS
    else:  # TD3
        extractor, (*hidden, mean, _) = policy.actor.features_extractor, policy.actor.mu
        squash, log_std, bounds = "tanh", None, SAC_BOUNDS
    modules = [*_modules(extractor), *(part for layer in hidden for part in _modules(layer))]
    return Actor(modules, mean, squash, actions, log_std, bounds, scaling_of(model))


def _of_d3rlpy(model: Any) -> Actor:
    if model.impl is None:
        raise UsageError("model: found an algorithm of d3rlpy that is not built, expected a trained one")
    if (scaler := model.config.action_scaler) is not None:
        _refuse_other_bounds(scaler.minimum, scaler.maximum)
    policy, scaling = model.impl.policy, scaling_of(model)
    hidden = _modules(policy._encoder)

    def actions(inputs: npt.NDArray[np.float32]) -> Any:  # what `predict` calls on scaled observations
        return model.impl.predict_best_action(hidden[0].weight.new_tensor(inputs)).detach().cpu().numpy()

    if hasattr(policy, "_fc"):  # deterministic
        return Actor(hidden, policy._fc, "tanh", actions, scaling=scaling)
    # Others, such as IQL, AWAC and BC, were not trained with the distribution of a draw before the tanh.
    log_std = policy._logstd if type(model).__name__ in DRAWN_BEFORE_TANH else None
    return Actor(
        hidden, policy._mu, "tanh", actions, log_std, (policy._min_logstd, policy._max_logstd), scaling
    )


def _refuse_other_bounds(low: Any, high: Any) -> None:
    if not (np.all(np.asarray(low) == -1.0) and np.all(np.asarray(high) == 1.0)):
        raise UsageError(f"model: found actions from {low} to {high}, expected -1 to 1")


def _modules(module: Any) -> list[Any]:
    """The innermost modules of a torch module, in order, without those that change nothing."""
    every = (part for _, part in module.named_modules(remove_duplicate=False))  # one ReLU may occur twice
    inner = [part for part in every if not list(part.children())]
    return [part for part in inner if type(part).__name__ not in IGNORED]


def numbers(parameter: Any) -> npt.NDArray[np.float32]:
    """The numbers of a parameter."""
    return np.asarray(parameter.detach().cpu().numpy(), dtype=np.float32)


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
        "layout": NETWORK_LAYOUT,
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
    with refusing_system_errors(target):
        write(target.parent, target.name, data)
    if note is not None and mean is std is None:
        notice(f"{target.name}: {note}, or pass mean and std")
    return weights.sha256


def _refuse_other_actions(model: Any, actor: Actor, weights: Weights) -> None:
    """Raise UsageError if a model's own actions are not those of the weights."""
    drawn = DEVIATION * np.random.default_rng(0).standard_normal((INPUTS, len(weights.mean)))
    inputs = np.clip(drawn, -weights.clip, weights.clip).astype(np.float32)
    outputs = weights.outputs(inputs, is_scaled=True)[:, :ACTION_COUNT].astype(np.float64)
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
