"""Actor networks as policies: the mean action, and draws from the network's own distribution."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import AfterValidator, Field, PrivateAttr, ValidationInfo, model_validator
from pydantic.functional_validators import ModelWrapValidatorHandler

from ibdata._numerics.arrays import Bools, Float32s, Floats
from ibdata._numerics.compiled import compiled
from ibdata._numerics.exact import LOG_SQRT_2PI, exp, log, log_cdf, tanh
from ibdata._numerics.random import standard_normal
from ibdata.errors import Problems
from ibdata.policies.base import Decision, Deterministic, Needs, Observed
from ibdata.policies.compound import Unnamed, Wrapper
from ibdata.policies.distributions import CLIP_EDGE, Certain, Distribution, applied
from ibdata.policies.weights_file import SHA256, Weights, weights_at

# From this tanh on, the action is ±1: closer to ±1, float32 is too coarse for the density of a random one.
TANH_EDGE = 1.0 - 2.0**-20


class Network(Deterministic):
    """Takes the mean action of an actor network, such as one trained by SAC, TD3 or PPO.

    The page "Learned policies" describes the file of weights, and `ibdata.save_network` writes it. Its
    SHA-256 identifies the policy; a dataset carries a copy of it.
    """

    kind: Literal["network"] = "network"
    file: str = Field(description="path of the weights relative to the YAML file, or a shipped name")
    sha256: Annotated[str, Field(pattern=SHA256)] | None = Field(
        default=None, description="SHA-256 of the file; by default that of the file that is found"
    )

    _weights: Weights = PrivateAttr()

    @model_validator(mode="wrap")
    @classmethod
    def _found(cls, data: Any, handler: ModelWrapValidatorHandler[Network], info: ValidationInfo) -> Network:
        """Keep the weights, and put their name in every dataset and their SHA-256 in place of a path."""
        file, sha256 = (data.get("file"), data.get("sha256")) if isinstance(data, dict) else (None, None)
        if not isinstance(file, str) or not isinstance(sha256, str | None):
            return handler(data)
        context = info.context or {}
        try:
            weights = weights_at(file, sha256, context.get("folder"), context.get("weights", {}))
        except ValueError as error:
            raise Problems([(("file",), str(error))]) from None
        policy = handler({**data, "file": weights.name, "sha256": weights.sha256})
        policy._weights = weights
        return policy

    @property
    def weights(self) -> Weights:
        """The weights."""
        return self._weights

    @property
    def checked_with(self) -> dict[str, Any]:
        """Its weights, so that a copy needs no file."""
        return {"weights": {self.sha256: self.weights}}

    @property
    def needs(self) -> Needs:
        """As many observations as its file says."""
        return Needs(history=self.weights.metadata.frames)

    def options(self) -> dict[str, Any]:
        """The options, without the SHA-256, which is that of the file and changes with it."""
        return {name: option for name, option in super().options().items() if name != "sha256"}

    def form(self) -> dict[str, Any]:
        """The kind and the SHA-256 of the weights, wherever they came from."""
        return {"kind": self.kind, "sha256": self.sha256}

    def decide(self, observed: Observed) -> Decision:
        outputs = self.weights.outputs(observed.observations.reshape(len(observed.step), -1))
        return Decision(_actions(outputs, self.weights.metadata.squash == "tanh"), observed.memory)


@compiled
def squashed(x: float, by_tanh: bool) -> float:
    """The component of an action that a number x of the network stands for, clipped by the caller."""
    if not by_tanh:
        return x
    y = tanh(x)
    return 1.0 if y >= TANH_EDGE else -1.0 if y <= -TANH_EDGE else y


@compiled
def _actions(outputs: Float32s, by_tanh: bool) -> Floats:
    action = np.empty((outputs.shape[0], 3))
    for i in range(action.shape[0]):
        for j in range(3):
            action[i, j] = squashed(np.float64(outputs[i, j]), by_tanh)
    return action


ATANH_OF_EDGE = float.fromhex("0x1.d1cb7dea86bcap+2")
COARSE = 2.0**-6  # standard deviations between neighbouring float32 actions from which rounding matters
LEAST = 1e-300  # a smaller probability is lost in the difference of two others


def _with_deviation(base: Network) -> Network:
    if not base.weights.has_log_std:
        raise ValueError("found weights without log_std, with which only kind: network works")
    return base


class Sampled(Wrapper):
    """Draws from the network's own distribution at a share of the steps, else takes the mean action.

    The network gives means m and log standard deviations log s; a draw is tanh(m + s z) with z ~ N(0, 1) or,
    if its file says so, m + s z clipped to [-1, 1]. The offline data of NeoRL (Qin et al. 2021, arXiv
    2102.00714) were made in this way, with a share of 0.2.
    """

    own_needs: ClassVar[Needs] = Needs(history=0, draws=4)  # one that decides, three for the draw

    kind: Literal["sampled"] = "sampled"
    base: Annotated[Network, Unnamed, AfterValidator(_with_deviation)] = Field(description="a network")
    share: Annotated[float, Field(gt=0.0, le=1.0, strict=True, allow_inf_nan=False)] = Field(
        description="probability of a draw at each step, above 0 and at most 1"
    )

    def decide(self, observed: Observed) -> Decision:
        weights = self.base.weights
        outputs = weights.outputs(observed.observations.reshape(len(observed.step), -1)).astype(np.float64)
        of = weights.metadata
        _bound(outputs, of.log_std == "tanh", of.log_std_low, of.log_std_high)
        return Decision(SquashedNormal(outputs, self.share, of.squash == "tanh"), observed.memory)


class SquashedNormal(Distribution):
    """The distribution of `Sampled`: a draw with a probability, else the whole mean action.

    A draw has atoms at ±1. Where float32 is coarse, its density is the mean over the numbers that are rounded
    to the same action.

    Args:
        outputs: means and log standard deviations before the squash, (n, 6).
        share: the probability of a draw.
        by_tanh: whether numbers are squashed by tanh, else clipped.
    """

    draws = 4

    def __init__(self, outputs: Floats, share: float, by_tanh: bool) -> None:
        self.outputs, self.share, self.by_tanh = outputs, share, by_tanh

    def sample(self, u: Floats) -> Floats:
        return _drawn(self.outputs, u, self.share, self.by_tanh)

    def log_density(self, action: Float32s) -> Floats:
        return _log_densities(self.outputs, self._means(), action, self.share, self.by_tanh)

    def atoms(self, action: Float32s) -> Bools:
        edges = super().atoms(action)
        return edges if self.share == 1.0 else edges | Certain(self._means()).atoms(action)

    def _means(self) -> Float32s:
        """The mean actions (n, 3)."""
        return applied(_drawn(self.outputs, np.ones((len(self.outputs), 4)), 0.0, self.by_tanh))


@compiled
def _bound(outputs: Floats, by_tanh: bool, low: float, high: float) -> None:
    """Bound the log standard deviations, in place: clamp them, or put their tanh onto the interval."""
    for i in range(outputs.shape[0]):
        for j in range(3, 6):
            x = outputs[i, j]
            if by_tanh:
                outputs[i, j] = low + 0.5 * (high - low) * (tanh(x) + 1.0)
            else:
                outputs[i, j] = low if x < low else high if x > high else x


@compiled
def _drawn(outputs: Floats, u: Floats, share: float, by_tanh: bool) -> Floats:
    action = np.empty((outputs.shape[0], 3))
    for i in range(action.shape[0]):
        for j in range(3):
            x = outputs[i, j]
            if u[i, 0] < share:
                x += exp(outputs[i, 3 + j]) * standard_normal(u[i, 1 + j])
            action[i, j] = squashed(x, by_tanh)
    return action


@compiled
def _log_densities(outputs: Floats, mean: Float32s, action: Float32s, share: float, by_tanh: bool) -> Floats:
    out = np.empty(action.shape[0])
    log_kept = log(1.0 - share) if share < 1.0 else 0.0
    for i in range(out.shape[0]):
        same = share < 1.0  # otherwise the mean action has no mass of its own
        for j in range(3):
            same = same and action[i, j] == mean[i, j]
        if same and share * _largest_mass(outputs, action, i, by_tanh) < 2.0**-55 * (1.0 - share):
            out[i] = log_kept  # as the formula below gives it, only faster
            continue
        density = width = 0.0  # logarithms; the width of the numbers that are rounded to this very action
        for j in range(3):
            low, high = rounded_to(action[i, j], by_tanh)
            density += log_component(action[i, j], low, high, outputs[i, j], outputs[i, 3 + j], by_tanh)
            width += log(high - low) if high > low else 0.0
        out[i] = log(1.0 - share + share * exp(density + width)) if same else log(share) + density
    return out


@compiled
def _largest_mass(outputs: Floats, action: Float32s, i: int, by_tanh: bool) -> float:
    """A bound of the probability that a draw is the action i: the width times the top of the density."""
    bound = 1.0
    for j in range(3):
        a = np.float64(action[i, j])
        if abs(a) < 1.0:
            low, high = rounded_to(action[i, j], by_tanh)
            slope = 1.0 - max(low * low, high * high) if by_tanh else 1.0
            bound *= min(1.0, (high - low) * exp(-outputs[i, 3 + j]) / slope)
    return bound


@compiled
def rounded_to(action: np.float32, by_tanh: bool) -> tuple[float, float]:
    """The numbers, low to high, that are played as a float32 action inside (-1, 1); none if low >= high.

    >>> low, high = rounded_to(np.float32(0.5), True)
    >>> (high - 0.5, 0.5 - low) == (2.0**-25, 2.0**-26)
    True
    """
    bits = np.float32(abs(action)).view(np.int32)
    a, after = np.float64(abs(action)), np.float64(np.int32(bits + 1).view(np.float32))
    before = np.float64(np.int32(bits - 1).view(np.float32)) if bits > 0 else -after
    low, high = 0.5 * (a + before), min(0.5 * (a + after), TANH_EDGE if by_tanh else CLIP_EDGE)
    return (low, high) if action >= 0.0 else (-high, -low)


@compiled
def log_component(
    action: np.float32, low: float, high: float, mean: float, log_std: float, by_tanh: bool
) -> float:
    """Log density of a draw at one number of an action, or the log of its mass if that is ±1.

    The numbers from low to high are played as this one, see `rounded_to`. Mean and standard deviation are
    those before the squash.
    """
    std, a, edge = exp(log_std), np.float64(action), ATANH_OF_EDGE if by_tanh else CLIP_EDGE
    if abs(a) == 1.0:
        return log_cdf((a * mean - edge) / std)
    if low >= high:
        return -np.inf
    z = (_before(a, by_tanh) - mean) / std
    slope = 1.0 - a * a if by_tanh else 1.0
    log_here = -0.5 * z * z - LOG_SQRT_2PI - log_std - log(slope)
    if high - low < COARSE * slope * std:
        return log_here
    below, above = (_before(low, by_tanh) - mean) / std, (_before(high, by_tanh) - mean) / std
    if below > 0.0:  # the smaller tail, of which a difference is exact
        below, above = -above, -below
    mass = exp(log_cdf(above)) - exp(log_cdf(below))
    return log(mass) - log(high - low) if mass > LEAST else log_here


@compiled
def _before(action: float, by_tanh: bool) -> float:
    """The number before the squash."""
    return 0.5 * log((1.0 + action) / (1.0 - action)) if by_tanh else action
