"""What objects of Stable-Baselines3, d3rlpy and torch need around a call; no library is imported."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from itertools import chain
from typing import Any

import numpy as np

from ibdata._numerics.arrays import Float32s
from ibdata._numerics.naming import exact
from ibdata.errors import UsageError
from ibdata.policies.base import OBSERVATION, SETPOINT
from ibdata.views.options import PLAIN, ViewOptions

# Layers of an environment that leave observations and actions as they are, or that `normalized` applies, by
# package and class. Observations are flat, so FlattenObservation is among them.
HARMLESS = {
    "gymnasium": [
        "Autoreset",
        "ClipReward",
        "FlattenObservation",
        "HumanRendering",
        "NormalizeReward",
        "OrderEnforcing",
        "PassiveEnvChecker",
        "RecordEpisodeStatistics",
        "RecordVideo",
        "RenderCollection",
        "TimeLimit",
        "TransformReward",
    ],
    "stable_baselines3": [
        "DummyVecEnv",
        "Monitor",
        "SubprocVecEnv",
        "VecCheckNan",
        "VecMonitor",
        "VecNormalize",
        "VecVideoRecorder",
    ],
}
FAR = 10.0  # standard deviations of the setpoints in training; one in 100 episodes is no farther
OWN = ("IndustrialBenchmarkEnv", "IndustrialBenchmarkVecEnv")
STACKS = ("FrameStackObservation", "VecFrameStack")
UNCHANGED = (
    "has no environment, so it is given observations as they are; if it was trained with VecNormalize or "
    "another wrapper, give"
)

Layer = tuple[str, str]  # the package, which is empty for a layer in another process, and the class


def is_torch_module(target: Any) -> bool:
    """Whether an object is a `torch.nn.Module`. Where torch is not imported, there are no modules."""
    return isinstance(target, getattr(sys.modules.get("torch.nn"), "Module", ()))


def module_call(module: Any) -> Callable[[Float32s], Any]:
    """The call of a torch module, which leaves the modes of its parts as they were."""
    torch = sys.modules["torch"]

    def call(observations: Float32s) -> Any:
        tensor = next(chain(module.parameters(), module.buffers()), None)
        device = "cpu" if tensor is None else tensor.device
        with evaluating(module), torch.no_grad():
            return module(torch.from_numpy(observations).to(device))

    return call


@contextmanager
def evaluating(module: Any) -> Iterator[None]:
    """A context in which a torch module is in evaluation mode, for instance without dropout."""
    training = [part for part in module.modules() if part.training]
    module.train(False)
    try:
        yield
    finally:
        for part in training:
            part.training = True


def normalized(target: Any, call: Callable[..., Any]) -> Callable[..., Any]:
    """The call on observations that go through the VecNormalize of a model of SB3 first, if it has one.

    Raises UsageError for a model in an environment with other wrappers, see `environment_note`.
    """
    environment_note(target)
    model = _model_of(target)
    env = None if model is None else model.get_vec_normalize_env()
    if env is None or not env.norm_obs:
        return call

    @wraps(call)  # it has the same keywords
    def scaled(observations: Float32s, **options: Any) -> Any:
        return call(env.normalize_obs(observations), **options)

    return scaled


def environment_note(target: Any, view: ViewOptions = PLAIN) -> str | None:
    """What to say if a model of SB3 was not trained in an environment of ibdata with this view.

    Raises UsageError if its environment has a wrapper that may change observations or actions.
    """
    model = _model_of(target)
    if model is None:
        policy = getattr(sys.modules.get("stable_baselines3.common.policies"), "BasePolicy", ())
        return f"a policy {UNCHANGED} the model that it is of" if isinstance(target, policy) else None
    env = model.get_env()
    if env is None:
        return f"the model {UNCHANGED} the model with its environment (model.set_env)"
    wrappers, innermost = _layers(env)
    for package, name in wrappers:
        _refuse_unknown(package, name)
    if not innermost:
        return (
            "the processes of the model's environment have ended; what wrappers in them did is not done here"
        )
    foreign = [name for package, name in innermost if package not in ("", "ibdata") or name not in OWN]
    if foreign:
        return (
            f"the model's environment is {foreign[0]}, not ibdata's; what it does to numbers is not done here"
        )
    [seen] = env.get_attr("view", [0])
    if (seen.frame(True), seen.imperfections) == (view.frame(True), view.imperfections):
        return None
    return "the model was trained with another view than it is given here; evaluate takes the option view"


def lacks_environment(target: Any) -> bool:
    """Whether an object is a model of SB3 without an environment, so that its VecNormalize is not known."""
    model = _model_of(target)
    return model is not None and model.get_env() is None


def _refuse_unknown(package: str, name: str) -> None:
    """Raise UsageError for a wrapper that may change observations or actions."""
    if name in STACKS:
        raise UsageError(
            f"model: found {name}, which puts the oldest observation first, expected the newest first; train "
            "on an environment with the option history"
        )
    known = HARMLESS.get(package, []) if package else chain(*HARMLESS.values())
    if name not in known:
        raise UsageError(
            f"model: found the wrapper {name}, which may change observations or actions, expected none but "
            "VecNormalize; train with that, or with the option view of ibdata's environment, or give a "
            "function that does what the wrapper does and calls model.predict"
        )


def owner_of(target: Any) -> Any:
    """The object whose method another one is, perhaps with arguments; else that one."""
    method = getattr(target, "func", target)
    return getattr(method, "__self__", method)


def _model_of(target: Any) -> Any:
    """The model of SB3 that an object is, or whose method it is; else None."""
    model = owner_of(target)
    return model if callable(getattr(model, "get_vec_normalize_env", None)) else None


def _layers(env: Any) -> tuple[list[Layer], list[Layer]]:
    """All wrappers of an environment of SB3, and the innermost environments; none if they have ended."""
    *wrappers, innermost = _nested(env, "venv")
    while "venv" in vars(env):
        env = env.venv
    if hasattr(env, "envs"):
        lanes = [_nested(lane, "env") for lane in env.envs]
    elif hasattr(env, "remotes"):  # a text such as <Monitor<TimeLimit<Env<id>>>> comes from each process
        try:
            texts = env.env_method("__str__")
        except (OSError, EOFError):
            return [*wrappers, innermost], []
        lanes = [[("", name) for name in re.findall(r"<(\w+)(?=[< ])", text)] for text in texts]
    else:
        return wrappers, [innermost]
    return [*wrappers, innermost, *chain(*(lane[:-1] for lane in lanes))], [lane[-1] for lane in lanes]


def _nested(env: Any, inner: str) -> list[Layer]:
    """The layers of an environment, outermost first, each of which holds the next as this attribute."""
    layers = []
    while env is not None:
        layers.append((type(env).__module__.partition(".")[0], type(env).__name__))
        env = vars(env).get(inner)
    return layers


def scaling_of(model: Any) -> dict[str, Any]:
    """The mean and std, and perhaps clip, by which a model of SB3 or d3rlpy scales observations, if any."""
    if hasattr(model, "get_vec_normalize_env"):
        env = model.get_vec_normalize_env()
        if env is None or not env.norm_obs:
            return {}
        std = np.sqrt(env.obs_rms.var + env.epsilon)
        return {"mean": env.obs_rms.mean.ravel(), "std": std.ravel(), "clip": env.clip_obs}
    scaler = getattr(getattr(model, "config", None), "observation_scaler", None)
    return {} if scaler is None else {"mean": scaler.mean, "std": scaler.std + scaler.eps}


def far_notes(
    scaling: dict[str, Any], setpoints: Sequence[float], columns: int = len(OBSERVATION), at: int = SETPOINT
) -> Iterator[str]:
    """A line if setpoints are many standard deviations from the mean in a scaling."""
    mean, std = (np.ravel(scaling[name])[at::columns] for name in ("mean", "std"))
    off = (np.abs(np.array(setpoints)[:, None] - mean) / std).max(axis=1)
    far = [exact(p) for p, size in zip(setpoints, off, strict=True) if size > FAR]
    if far:
        yield (
            f"setpoint {', '.join(far)}: up to {off.max():.3g} standard deviations from {exact(mean[0])}, "
            "the mean in its scaling of observations: it was trained at other setpoints"
        )
