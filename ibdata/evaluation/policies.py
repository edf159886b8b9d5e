"""Policies that a user gives as a kind, a block, a file, or any object that acts."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ibdata.errors import ConfigError, UsageError, say, suggestion
from ibdata.experiment.code import customs_in
from ibdata.experiment.messages import Problem, refusals, shown
from ibdata.experiment.yaml import Document, StrictYamlError
from ibdata.numerics.naming import unequal
from ibdata.policies import OBSERVATION, POLICIES, AnyPolicy, Policy
from ibdata.policies.base import FrozenModel, refuse_density
from ibdata.policies.code import two_places
from ibdata.policies.custom import TARGET, Custom, is_live
from ibdata.policies.purity import refuse_impure
from ibdata.policies.user_object import EXPECTED, UserObject, can_act, has_needs
from ibdata.policies.weights_file import SUFFIX
from ibdata.views.options import PLAIN, ViewOptions


def policies_of(
    given: Any, history: int | Mapping[str, int] = 1, allow_code: bool = False
) -> dict[str, Policy]:
    """Return the policies that a user gave, by their labels. Of equal labels, the later ones get -2, -3, …

    A user gives what `policy_of` takes, a mapping of labels to that, or a list of both, and the history for
    all or by label.
    """
    lengths, common = (history, 1) if isinstance(history, Mapping) else ({}, history)
    for name, length in {"": common, **lengths}.items():
        if length < 1:
            where = f"history: {name}" if name else "history"
            raise UsageError(f"{where}: found {length!r}, expected a whole number of at least 1")
    given = [(label, policy_of(policy, common, allow_code)) for label, policy in _labelled(given)]
    labels = unequal(label or policy.label for label, policy in given)
    policies = dict(zip(labels, (policy for _, policy in given), strict=True))
    taking = [label for label, policy in policies.items() if takes_history(policy)]
    for label in taking:
        length = lengths.get(label, policies[label].history)
        policies[label] = policies[label].model_copy(update={"history": length})
    refuse_unused(common, policies.values())
    for name in lengths.keys() - taking:
        one = f"one of {', '.join(taking)}" if taking else "no label"
        raise UsageError(f"history: found {name!r}, expected {one}: any other policy sets its own number")
    return policies


def refuse_unused(history: int, policies: Iterable[Policy]) -> None:
    """Raise UsageError for a number of observations that none of the policies takes."""
    if history != 1 and not any(map(takes_history, policies)):
        raise UsageError(
            f"history: found {history}, but no object that could see so many observations: policies of "
            "ibdata and objects with `needs` set their own number; leave it out, or give a function, a "
            "module or another object"
        )


def takes_history(policy: Policy) -> bool:
    """Whether a policy is an object without a number of observations of its own."""
    return isinstance(policy, Custom) and policy.is_live and not has_needs(policy.adapted)


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
    """Return a policy that a user gave: a `Policy`, a kind, a block (mapping, YAML or file), or an object.

    An object without `needs` sees `history` observations. A custom policy in a file needs `allow_code`.
    Raises UsageError if it is none of these, ConfigError for a block that is not valid.
    """
    if history < 1:
        raise UsageError(f"history: found {history}, expected a whole number of at least 1")
    if isinstance(given, Policy):
        return given
    if isinstance(given, Mapping):
        return _block(dict(given), "policy")
    if isinstance(given, str | os.PathLike):
        return _named(given, allow_code)
    if isinstance(given, type):
        raise UsageError(f"policy: found the class {given.__name__}, expected an object: {given.__name__}(…)")
    if can_act(given):
        try:
            refuse_density(given)
        except TypeError as error:
            raise UsageError(f"policy: {error}") from None
        name = getattr(given, "__name__", type(given).__name__).lower()
        name = re.sub("[^a-z0-9]", "-", name).strip("-")[:64]
        own = {} if has_needs(given) else {"history": history}
        return _block({"kind": "custom", "target": given, "name": name or "object", **own}, "policy")
    raise UsageError(f"policy: found {shown(given)}, expected {EXPECTED}")


def _named(given: str | os.PathLike[str], allow_code: bool) -> Policy:
    text = os.path.expanduser(given)
    if text in POLICIES:
        return _block({"kind": text}, f"policy {text}")
    if os.path.isfile(text):
        place, source, folder = text, Path(text).read_bytes(), Path(text).parent
        if b"\0" in source:
            raise UsageError(_of_binary(text))
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
    if not isinstance(block, dict) or "kind" not in block:
        raise ConfigError([f"{place}: found {shown(block)}, expected a block such as '{_example(text)}'"])
    policy = _block(block, place, folder)
    if folder is not None and not allow_code and any(customs_in(policy)):
        raise UsageError(
            f"{place}: found a custom policy, which is code that would run; --allow-code if you trust it"
        )
    return policy


def _of_binary(path: str) -> str:
    """What to do with a file that is no text."""
    if path.endswith(SUFFIX):
        return f"{path}: found a file of weights, expected a block; write '{{kind: network, file: {path}}}'"
    return (
        f"{path}: found a file that is no text, expected a block; if it holds a model, load that in Python "
        "and call ibdata.evaluate(model), or ibdata.save_network to write a file of weights"
    )


def _example(text: str) -> str:
    """A block; that of custom code where a text has the form of its target."""
    return f"{{kind: custom, target: {text!r}}}" if re.match(TARGET, text) else "{kind: safe}"


def notes_on(policy: Policy, view: ViewOptions = PLAIN) -> Iterator[str]:
    """What may be wrong with the objects of users that a policy is made of, and that have acted."""
    for part in policy.everywhere():
        if isinstance(part, UserObject):
            yield from part.notes(view if is_live(part) else PLAIN)


@contextmanager
def loaded(policies: Iterable[Policy], columns: int = len(OBSERVATION), says: bool = True) -> Iterator[None]:
    """A context in which custom policies are loaded, and code of a user is pure. Modules are those of Python.

    Objects see so many `columns` of an observation. At the end it `says` on stderr what may be wrong with
    them. Raises PolicyError for a policy that remembers or draws in secret.
    """
    policies = list(policies)
    for policy in policies:
        if type(policy) not in POLICIES.values():  # a class of a user
            refuse_impure(policy, exact=False)
    customs = [custom for policy in policies for custom in customs_in(policy)]
    try:
        for custom in customs:
            custom.load(columns if custom.is_live and custom in policies else len(OBSERVATION))
        yield
        for policy in policies if says else ():
            for note in notes_on(policy):
                say(f"{policy.label}: {note}")
    finally:
        for custom in customs:
            custom.forget()


class _Policies(FrozenModel):
    policies: list[AnyPolicy]


def _block(block: dict[str, Any], place: str, folder: Path | None = None) -> Policy:
    """The policy of a block in a file of this folder. The lines of a ConfigError begin with the place."""
    data = {"policies": [block]}

    def line(problem: Problem) -> str:
        in_block = problem._replace(loc=problem.loc[2:])  # without policies.0
        return f"{place}: {in_block.text}"

    with refusals(data, _Policies, line):
        [policy] = _Policies.model_validate(data, context={"folder": folder}).policies
    for custom in customs_in(policy):
        custom.look_in(two_places(folder))
    return policy
