"""How policies scale observations, and at which setpoints they cannot act because training saw others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from ibdata._numerics.naming import exact
from ibdata.policies.base import OBSERVATION, SETPOINT, Policy
from ibdata.policies.checked import EPISODES, histories, played
from ibdata.policies.libraries import owner_of
from ibdata.policies.network import Network
from ibdata.policies.user_object import UserObject

FAR = 10.0  # standard deviations of the setpoints in training; one in 100 episodes is no farther
MOST = 90  # of the 101 whole setpoints; a policy that acts alike at fewer of them saturates there
FEW = 4  # observations, of which some differ in the actions unless these depend on the setpoint alone


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


def setpoint_notes(
    policy: Policy, setpoints: Sequence[float], columns: int = len(OBSERVATION), at: int = SETPOINT
) -> Iterator[str]:
    """What says that a policy, whose objects are loaded, was trained at other setpoints, in lines.

    It sees so many columns of an observation, of which one has the setpoint.
    """
    parts = list(policy.everywhere(Policy))
    far = [note for scaling in _scalings(parts) for note in far_notes(scaling, setpoints, columns, at)]
    yield from far
    alike = [] if far else [p for p in setpoints if _acts_alike(policy, p, EPISODES, columns, at)]
    if alike and MOST <= sum(_acts_alike(policy, p, FEW, columns, at) for p in range(101)) < 101:
        yield (
            f"at setpoint {', '.join(map(exact, alike))} its actions depend on nothing else that it sees, at "
            "others they do: perhaps it scales observations by what it saw in training, at others"
        )
    for user_object in policy.everywhere(UserObject):
        user_object.adapter.clipped[:] = 0  # what was asked here is made up


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


def _scalings(parts: Sequence[Policy]) -> Iterator[dict[str, Any]]:
    """The scalings of the networks and models among policies."""
    for part in parts:
        if isinstance(part, Network):
            yield {"mean": part.weights.mean, "std": part.weights.std}
        elif isinstance(part, UserObject):
            with suppress(AttributeError, TypeError):  # of another scaler, or one that is not fitted
                if scaling := scaling_of(owner_of(part.adapter.target)):
                    yield scaling


def _acts_alike(policy: Policy, setpoint: float, n: int, columns: int, at: int) -> bool:
    """Whether a policy acts in the same way on n random observations at a setpoint."""
    seen = histories(n, policy.needs.history, columns)
    seen[:, :, at] = setpoint
    [(_, actions)] = played(policy, seen, 1)
    return bool((actions == actions[0]).all())
