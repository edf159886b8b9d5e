"""The actors of models that other libraries have trained, read by the names of their parts."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ibdata.errors import UsageError
from ibdata.policies.libraries import evaluating
from ibdata.policies.scaling import scaling_of

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
