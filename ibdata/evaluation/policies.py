"""Policies that a user gives as a kind, a block, a file, or any object that acts."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pydantic import ConfigDict

from ibdata.errors import ConfigError, UsageError
from ibdata.experiment import validated
from ibdata.experiment.custom_code import customs_in
from ibdata.experiment.messages import shown, suggestion
from ibdata.experiment.yaml import Document, StrictYamlError
from ibdata.policies import POLICIES, Policy
from ibdata.policies.custom import Adapter


class Acting(Adapter):
    """A policy made of any object that acts. Its random numbers depend on the name of the object's class."""

    model_config = ConfigDict(arbitrary_types_allowed=True)

    kind: str = "object"
    target: Any
    history: int

    @property
    def adapted(self) -> Any:
        """The object."""
        return self.target

    @property
    def history_length(self) -> int:  # type: ignore[override]  # read from instances only
        """The object's own `history_length` if it has one, else the number asked for."""
        return int(getattr(self.target, "history_length", self.history))

    @property
    def uniforms_per_step(self) -> int:  # type: ignore[override]  # read from instances only
        """The object's own `uniforms_per_step` if it has one, else 0."""
        return int(getattr(self.target, "uniforms_per_step", 0))

    def form(self) -> dict[str, Any]:
        """The kind and the name, because nothing else is known."""
        return {"kind": self.kind, "name": self.label}


def policy_of(given: Any, history: int = 1, allow_code: bool = False) -> Policy:
    """Return the policy that a user gave.

    Args:
        given: a `Policy`, a kind such as "safe", a block (mapping, YAML text or file), or an object with
            `act(history, u)` or `predict(observation)`.
        history: the number of observations that an object sees if it has no `history_length`.
        allow_code: whether a custom policy in a file may run; one that is given as a block always may.

    Raises:
        UsageError: given is none of these, or a file names a custom policy without allow_code.
        ConfigError: the block is not valid.
    """
    if isinstance(given, Policy):
        return given
    if isinstance(given, Mapping):
        return _block(dict(given), "policy")
    if isinstance(given, str | os.PathLike):
        return _named(given, allow_code)
    if callable(getattr(given, "act", None)) or callable(getattr(given, "predict", None)):
        name = "".join(c if c.isascii() and c.isalnum() else "-" for c in type(given).__name__.lower())
        return Acting(target=given, history=history, name=name.strip("-")[:64] or "object")
    raise UsageError(
        f"policy: found {shown(given)}, expected an object with act(history, u) or predict(observation)"
    )


def _named(given: str | os.PathLike[str], allow_code: bool) -> Policy:
    text = os.fspath(given)
    if text in POLICIES:
        return _block({"kind": text}, f"policy {text}")
    folder: Path | None = None
    if os.path.isfile(text):
        place, source, folder = text, Path(text).read_bytes(), Path(text).parent
    elif "{" in text or ":" in text:
        place, source = "policy", text.encode()
    else:
        raise UsageError(
            f"policy: found {text!r}, expected one of {', '.join(POLICIES)}, a block such as "
            f"'{{kind: safe}}', or a file with one{suggestion(text, POLICIES)}"
        )
    try:
        block = Document(source).data
    except StrictYamlError as error:
        raise ConfigError([f"{place}:{error}"]) from None
    if not isinstance(block, dict):
        raise ConfigError([f"{place}: found {shown(block)}, expected a block such as '{{kind: safe}}'"])
    policy = _block(block, place, folder)
    if place != "policy" and not allow_code and any(customs_in(policy)):
        raise UsageError(
            f"{place}: found a custom policy, which is code that would run; --allow-code "
            "(allow_code=True) if you trust it"
        )
    return policy


def _block(block: dict[str, Any], place: str, folder: Path | None = None) -> Policy:
    """The policy of a block in a file of this folder. The lines of a ConfigError begin with the place."""
    try:
        return validated({"name": "x", "setpoints": 0, "policies": [block]}, folder).policies[0]
    except ConfigError as error:
        problems = [problem.removeprefix("policies.0.") for problem in error.problems]
        raise ConfigError(
            [f"{place}: {problem.removeprefix('policies.0: ')}" for problem in problems]
        ) from None
