"""Policies that a user gives as a kind, a block, a file, or any object that acts."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import ConfigDict

from ibdata.errors import ConfigError, UsageError, suggestion
from ibdata.experiment import validated
from ibdata.experiment.code_record import provenance, refuse_mixed, refuse_two
from ibdata.experiment.custom_code import customs_in
from ibdata.experiment.fresh_modules import imported_anew
from ibdata.experiment.messages import shown
from ibdata.experiment.plain import plain
from ibdata.experiment.yaml import Document, StrictYamlError
from ibdata.policies import POLICIES, Policy
from ibdata.policies.adapter import Adapter
from ibdata.policies.code_places import looking_here
from ibdata.policies.ways import WAYS, can_act


class Acting(Adapter):
    """A policy made of an object. Its random numbers depend on the name of its class or function."""

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


def policies_of(
    given: Any, history: int | Mapping[str, int] = 1, allow_code: bool = False
) -> dict[str, Policy]:
    """Return the policies that a user gave, by their labels. Of equal labels, the later ones get -2, -3, …

    Args:
        given: what `policy_of` takes, a mapping of labels to that, or a list of both.
        history: as in `policy_of`, for all policies or by label.
        allow_code: as in `policy_of`.

    Raises:
        UsageError, ConfigError: as `policy_of`; or a label, or a key of history, is not valid.
    """
    history = plain(history)
    lengths, common = (history, 1) if isinstance(history, Mapping) else ({}, history)
    for name, length in {"": common, **lengths}.items():
        if isinstance(length, bool) or not isinstance(length, int) or length < 1:
            where = f"history: {name}" if name else "history"
            raise UsageError(f"{where}: found {length!r}, expected a whole number of at least 1")
    found: dict[str, Policy] = {}
    taking: list[str] = []  # the labels of policies without a number of observations of their own
    for label, each in _labelled(given):
        policy = policy_of(each, common, allow_code)
        own, name, count = label or policy.label, label or policy.label, 1
        while name in found:
            count += 1
            name = f"{own}-{count}"
        if isinstance(policy, Acting) and not hasattr(policy.target, "history_length"):
            taking.append(name)
            policy = policy.model_copy(update={"history": lengths.get(name, policy.history)})
        found[name] = policy
    refuse_unused(common, found.values())
    for name in lengths.keys() - taking:
        one = f"one of {', '.join(taking)}" if taking else "no label"
        raise UsageError(f"history: found {name!r}, expected {one}: any other policy sets its own number")
    return found


def refuse_unused(history: int, policies: Iterable[Policy]) -> None:
    """Raise UsageError for a number of observations where no object is among the policies."""
    if history != 1 and not any(isinstance(policy, Acting) for policy in policies):
        raise UsageError(
            f"history: found {history}, but no object that could see so many observations: policies of "
            "ibdata set their own number; leave it out, or give a function, a module or an object"
        )


def _labelled(given: Any) -> Iterator[tuple[str | None, Any]]:
    """Yield each policy with the label that the user gave it, or None."""
    for each in given if isinstance(given, list | tuple) else [given]:
        if not isinstance(each, Mapping) or "kind" in each:
            yield None, each
            continue
        for label, policy in each.items():
            if not (isinstance(label, str) and label.strip() and label.isprintable()):
                raise UsageError(f"policy: found the label {label!r}, expected a name")
            yield label, policy


def policy_of(given: Any, history: int = 1, allow_code: bool = False) -> Policy:
    """Return the policy that a user gave.

    Args:
        given: a `Policy`, a kind such as "safe", a block (mapping, YAML text or file), or an object that
            `Adapter` takes.
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
    if isinstance(given, type):
        raise UsageError(f"policy: found the class {given.__name__}, expected an object: {given.__name__}(…)")
    if can_act(given):
        name = getattr(given, "__name__", type(given).__name__).lower()
        name = re.sub("[^a-z0-9]", "-", name).strip("-")[:64]
        return Acting(target=given, history=history, name=name or "object")
    raise UsageError(f"policy: found {shown(given)}, expected {WAYS}")


def _named(given: str | os.PathLike[str], allow_code: bool) -> Policy:
    text = os.fspath(given)
    if text in POLICIES:
        return _block({"kind": text}, f"policy {text}")
    if os.path.isfile(text):
        place, source, folder = text, Path(text).read_bytes(), Path(text).parent
    elif "{" in text or ":" in text:
        place, source, folder = "policy", text.encode(), None
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
    if folder is not None and not allow_code and any(customs_in(policy)):
        raise UsageError(
            f"{place}: found a custom policy, which is code that would run; --allow-code if you trust it"
        )
    for custom in customs_in(policy):
        custom.look_beside(folder)
    return policy


@contextmanager
def loaded(policies: Iterable[Policy]) -> Iterator[None]:
    """A context in which custom policies do what their files hold now.

    Raises UsageError if two of their modules have the same name.
    """
    own = [custom for policy in policies for custom in customs_in(policy)]
    if not own:  # else the check at the end would look at what the script and other threads import
        yield
        return
    with looking_here(), imported_anew(own):
        refuse_two(own)
        for custom in own:
            custom.load()
        provenance(own)  # refuses bytecode of other code
        yield
        refuse_mixed(own)


def _block(block: dict[str, Any], place: str, folder: Path | None = None) -> Policy:
    """The policy of a block in a file of this folder. The lines of a ConfigError begin with the place."""
    try:
        return validated({"name": "x", "setpoints": 0, "policies": [block]}, folder).policies[0]
    except ConfigError as error:
        problems = [problem.removeprefix("policies.0.") for problem in error.problems]
        raise ConfigError(
            [f"{place}: {problem.removeprefix('policies.0: ')}" for problem in problems]
        ) from None
