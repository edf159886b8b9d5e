"""An actor network as a policy."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PrivateAttr, ValidationInfo, model_validator
from pydantic.functional_validators import ModelWrapValidatorHandler

from ibdata.errors import Problems
from ibdata.numerics.compiled import compiled
from ibdata.numerics.exact import tanh
from ibdata.policies.base import Decision, Deterministic, Float32s, Floats, Needs, Observed
from ibdata.policies.weights_file import SHA256, Weights, find

# From this tanh on, the action is ±1: closer to ±1, float32 is too coarse for the density of a random one.
TANH_EDGE = 1.0 - 2.0**-20


class Network(Deterministic):
    """Takes the mean action of an actor network, such as one trained by SAC, TD3 or PPO.

    docs/networks.md describes the file of weights, and `ibdata.save_network` writes it. Its SHA-256
    identifies the policy; a dataset carries a copy of it.
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
            weights = find(file, sha256, context.get("folder"), context.get("weights", {}))
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
    def context(self) -> dict[str, Any]:
        """Its weights, so that a copy needs no file."""
        return {"weights": {self.sha256: self.weights}}

    @property
    def needs(self) -> Needs:
        """As many observations as its file says."""
        return Needs(history=self.weights.metadata.frames)

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
