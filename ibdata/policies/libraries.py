"""What objects of Stable-Baselines3 and torch need around a call; neither library is imported."""

from __future__ import annotations

import sys
from collections.abc import Callable
from contextlib import suppress
from functools import wraps
from itertools import chain
from typing import Any

from ibdata.errors import UsageError
from ibdata.policies.base import Float32s


def is_torch_module(target: Any) -> bool:
    """Whether an object is a `torch.nn.Module`. Where torch is not imported, there are no modules."""
    return isinstance(target, getattr(sys.modules.get("torch.nn"), "Module", ()))


def module_call(module: Any) -> Callable[[Float32s], Any]:
    """The call of a torch module, which leaves the modes of its parts as they were."""
    torch = sys.modules["torch"]

    def call(observations: Float32s) -> Any:
        training = [part for part in module.modules() if part.training]
        tensor = next(chain(module.parameters(), module.buffers()), None)
        device = "cpu" if tensor is None else tensor.device
        module.train(False)
        try:
            with torch.no_grad():
                return module(torch.from_numpy(observations).to(device))
        finally:
            for part in training:
                part.training = True

    return call


def normalized(model: Any, call: Callable[..., Any]) -> Callable[..., Any]:
    """The call on observations that go through the VecNormalize of a model of SB3 first, if it has one."""
    if not callable(getattr(model, "get_vec_normalize_env", None)):
        return call
    refuse_frame_stack(model)
    env = model.get_vec_normalize_env()
    if env is None or not env.norm_obs:
        return call

    @wraps(call)  # it has the same keywords
    def scaled(observations: Float32s, **options: Any) -> Any:
        return call(env.normalize_obs(observations), **options)

    return scaled


def refuse_frame_stack(model: Any) -> None:
    """Raise UsageError if the environment of a model of SB3 puts the oldest observation first."""
    env: Any = getattr(model, "get_env", lambda: None)()
    wrappers = []
    stack = getattr(sys.modules.get("gymnasium.wrappers"), "FrameStackObservation", None)
    with suppress(OSError, EOFError):  # the processes of the environment have ended
        if stack and hasattr(env, "env_is_wrapped") and any(env.env_is_wrapped(stack)):
            wrappers.append("FrameStackObservation")
    while env is not None:
        wrappers.append(type(env).__name__)
        env = getattr(env, "__dict__", {}).get("venv")
    for name in {"VecFrameStack", "FrameStackObservation"} & set(wrappers):
        raise UsageError(
            f"model: found {name}, which puts the oldest observation first, expected the newest first; train "
            "on an environment with the option history"
        )
