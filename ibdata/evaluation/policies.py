"""Policies that a user gives as a kind, a block, a file, or an object; and what may be wrong with them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import TypeAdapter

from ibdata._numerics.arguments import can_act, native
from ibdata._numerics.naming import exact, unequal
from ibdata.errors import ALLOW_CODE, ConfigError, UsageError, notice, printable, suggestion
from ibdata.experiment import load
from ibdata.experiment.messages import refusals, shown
from ibdata.experiment.scenario import Scenario
from ibdata.experiment.yaml import Document, StrictYamlError
from ibdata.policies import NAMED, OBSERVATION, AnyPolicy, Policy
from ibdata.policies.adapter import EXPECTED, has_needs
from ibdata.policies.base import SETPOINT
from ibdata.policies.checked import TRIED_EPISODES, histories, played
from ibdata.policies.code import Acting
from ibdata.policies.compound import block_of, is_foreign
from ibdata.policies.libraries import far_notes, owner_of, scaling_of
from ibdata.policies.network import Network
from ibdata.policies.user_object import TARGET, Custom, ObjectPolicy, UserObject, refuse_shared
from ibdata.policies.weights_file import SUFFIX, Weights, shipped_names
from ibdata.views.options import OBSERVED, PLAIN, ViewOptions


class Given(NamedTuple):
    """The policies that a user gave, in the order of the user's labels, and the policies of each of these."""

    policies: dict[str, Policy]
    groups: dict[str, list[str]]


def policies_of(policies: Any, history: int | Mapping[str, int] = 1, allow_code: bool = False) -> Given:
    """Return the policies that a user gave. Of equal labels, the later policies get -2, -3, …

    A user gives what `as_policy` takes, a mapping of labels to that or to lists of it, or a list of both, and
    the history for all or by label. Policies with one label are trainings of one algorithm, and have the
    names of their files beside it, or numbers.
    """
    lengths, common = (history, 1) if isinstance(history, Mapping) else ({}, history)
    given: dict[str | int, list[tuple[Policy, bool]]] = {}
    for number, (label, argument) in enumerate(_labelled(policies)):
        given.setdefault(label or number, []).append(_parsed(argument, common, allow_code))
    labels = unequal(x if isinstance(x, str) else members[0][0].label for x, members in given.items())
    taking = [
        label
        for label, members in zip(labels, given.values(), strict=True)
        if any(takes for _, takes in members)
    ]
    _refuse_unused(common, bool(taking))
    for label in lengths.keys() - taking:
        expected = f"one of {', '.join(taking)}" if taking else "no label"
        raise UsageError(f"history: found {label!r}, expected {expected}: others set their own number")
    named, groups = dict[str, Policy](), dict[str, list[str]]()
    for label, members in zip(labels, given.values(), strict=True):
        trainings = [
            _with_history(policy, label, lengths[label]) if takes and label in lengths else policy
            for policy, takes in members
        ]
        _refuse_mixed(label, trainings)
        names = [f"{label} ({_training(policy, i)})" for i, policy in enumerate(trainings, 1)]
        names = names if len(names) > 1 else [label]
        groups[label] = unequal([*named, *names])[len(named) :]
        named |= {name: policy.labelled(name) for name, policy in zip(groups[label], trainings, strict=True)}
    return Given(named, groups)


def _with_history(policy: Policy, label: str, length: int) -> Policy:
    """An object's policy that sees another number of observations."""
    return block_policy({**policy.options(), "name": None, "history": length}, f"history: {label}")


def _training(policy: Policy, number: int) -> str:
    """What tells a training from the others of its label: the name of its network's file, or a number."""
    return next((Path(x.weights.file).stem for x in policy.everywhere(Network)), str(number))


def is_trained(policy: Policy) -> bool:
    """Whether a policy is of a user's object or of a network."""
    return any(policy.everywhere(UserObject)) or any(policy.everywhere(Network))


def _refuse_mixed(label: str, policies: Sequence[Policy]) -> None:
    """Raise UsageError for policies of one label that are no trainings of one algorithm."""
    if len(policies) == 1:
        return
    where, meant = f"policy {printable(label)}", "one label is one algorithm, with a policy of each training"
    for policy in policies:
        if not is_trained(policy):
            raise UsageError(f"{where}: found {policy.form()['kind']}, which is not trained; {meant}")
    for one, other in combinations(policies, 2):
        objects = [part.target for part in (one, other) if isinstance(part, ObjectPolicy)]
        if one.is_same(other) if not objects else len(objects) == 2 and objects[0] is objects[1]:
            raise UsageError(f"{where}: found the same policy twice; {meant}")
    layers = {
        tuple(
            (part.weights.metadata.frames, part.weights.sizes.tobytes())
            for part in policy.everywhere(Network)
        )
        for policy in policies
    }
    if len(layers) > 1:
        raise UsageError(f"{where}: found networks of different frames or layers; {meant}")


def _refuse_unused(history: int, takes_history: bool) -> None:
    """Raise UsageError for a number of observations that none of the policies that a user gave takes."""
    if history != 1 and not takes_history:
        raise UsageError(
            f"history: found {history}, but no object that could see so many observations: policies of "
            "ibdata, blocks and objects with `needs` set their own number; leave it out, or give a function, "
            "a module or another object"
        )


def _labelled(policies: Any) -> Iterator[tuple[str | None, Any]]:
    """Yield each policy with the label that the user gave it, or None."""
    plain = native(policies)
    for argument in plain if isinstance(plain, list) and not can_act(plain) else [plain]:
        if can_act(argument) or not isinstance(argument, Mapping) or "kind" in argument:
            yield None, argument
            continue
        for label, given in argument.items():
            if not (isinstance(label, str) and label.strip() and label.isprintable()):
                raise UsageError(f"policy: found the label {label!r}, expected a name")
            several = given if isinstance(given, list) and not can_act(given) else [given]
            if not several:
                raise UsageError(f"policy {label}: found no policy, expected at least one")
            yield from ((label, policy) for policy in several)


def as_policy(policy: Any, history: int = 1, allow_code: bool = False) -> Policy:
    """Return a policy that a user gave: a `Policy`, a kind, a block (mapping, YAML or file), or an object.

    An object without `needs` sees `history` observations. A custom policy in a file needs `allow_code`.
    Raises UsageError if it is none of these, ConfigError for a block that is not valid.
    """
    parsed, takes_history = _parsed(policy, history, allow_code)
    _refuse_unused(history, takes_history)
    return parsed


def _parsed(argument: Any, history: int, allow_code: bool) -> tuple[Policy, bool]:
    """The policy of what a user gave, and whether that is an object which takes a number of observations."""
    policy, takes_history = _policy_of(argument, history)
    for custom in policy.everywhere(Custom) if not allow_code else ():
        if custom.checked_with["folder"] is not None:  # it is from a file
            raise UsageError(
                f"policy {policy.label}: found the custom policy {printable(custom.target)} of a file, "
                f"which is code that would run; {ALLOW_CODE} if you trust it"
            )
    return policy, takes_history


def _policy_of(argument: Any, history: int) -> tuple[Policy, bool]:
    if isinstance(argument, Policy) and not is_foreign(argument):
        return argument, False
    if isinstance(argument, type):
        name = argument.__name__
        raise UsageError(f"policy: found the class {name}, expected an object: {name}(…)")
    if can_act(argument):
        takes_history = not has_needs(argument)
        length = {"history": history} if takes_history else {}
        return block_policy({**block_of(argument), **length}, "policy"), takes_history
    if isinstance(argument, Mapping):
        return block_policy(argument, "policy"), False
    if isinstance(argument, str | os.PathLike):
        return _named(argument), False
    raise UsageError(f"policy: found {shown(argument)}, expected one policy: a kind, a block, {EXPECTED}")


def _named(name: str | os.PathLike[str]) -> Policy:
    text = os.path.expanduser(name)
    if text in NAMED or text in shipped_names():
        return block_policy(block_of(text), f"policy {text}").labelled(text)
    if text.endswith(SUFFIX) and "{" not in text:
        return block_policy({"kind": "network", "file": text}, f"policy {name}").labelled(Path(text).stem)
    if os.path.isfile(text):
        place, source, folder = text, Path(text).read_bytes(), Path(text).parent
        if b"\0" in source or text.endswith(".py"):
            raise UsageError(_of_no_yaml(text))
    elif "{" in text or ":" in text:
        place, source, folder = "policy", text.encode(), None
    else:
        if os.path.isdir(text):
            raise UsageError(f"policy: found the folder {text}; ibdata info shows a dataset")
        names = [*NAMED, *shipped_names()]
        known = (
            f"one of {', '.join(NAMED)}, a network that ibdata config policies lists, a block such as "
            "'{kind: safe}', or a file with one"
        )
        raise UsageError(f"policy: found {text!r}{suggestion(text, names) or f', expected {known}'}")
    try:
        block = Document(source).data
    except StrictYamlError as error:
        raise ConfigError([f"{place}:{error}"]) from None
    if not isinstance(block, dict) or "kind" not in block:
        if isinstance(block, dict) and "policies" in block:
            raise ConfigError(
                [f"{place}: found an experiment, expected a block; give ibdata.load(…).policies"]
            )
        example = f"{{kind: custom, target: {text!r}}}" if re.match(TARGET, text) else "{kind: safe}"
        raise ConfigError([f"{place}: found {shown(block)}, expected a block such as '{example}'"])
    return block_policy(block, place, folder)


def _of_no_yaml(path: str) -> str:
    """What to do with a file that is not YAML."""
    if path.endswith(".py"):
        return f"{path}: found Python, expected a block; write '{{kind: custom, target: {path}:NAME}}'"
    return (
        f"{path}: found a file that is no text, expected a block; if it holds a model, load that in Python "
        "and call ibdata.evaluate(model), or ibdata.save_network to write a file of weights"
    )


def notes_on(policy: Policy, view: ViewOptions = PLAIN) -> Iterator[str]:
    """What may be wrong with the objects of users that a policy is made of, and that have acted."""
    for part in policy.everywhere(UserObject):
        yield from part.notes(view if isinstance(part, ObjectPolicy) else PLAIN)


@contextmanager
def loaded(
    policies: Iterable[Policy], columns: int = len(OBSERVATION), says: bool = True
) -> Iterator[list[Policy]]:
    """Yield copies of policies whose objects are loaded and known to be pure, and can act in this context.

    Objects see so many `columns` of an observation. At the end, notices on stderr say what may be wrong with
    them. Raises PolicyError for a policy that remembers or draws in secret.
    """
    with Acting() as acting:
        ready = [policy.loaded(acting) for policy in policies]
        for policy in ready:
            refuse_shared(policy)
            for part in policy.everywhere(UserObject):
                is_seen = isinstance(part, ObjectPolicy) and part is policy
                part.refuse_impure(columns if is_seen else len(OBSERVATION))
        yield ready
        for policy in ready if says else ():
            for note in notes_on(policy):
                notice(f"{policy.label}: {note}")


@cache
def _any_policy() -> TypeAdapter[Policy]:
    return TypeAdapter(AnyPolicy)


def block_policy(
    block: Mapping[str, Any],
    place: str,
    folder: Path | None = None,
    weights: dict[str, Weights] | None = None,
) -> Policy:
    """The policy of a block in a file of this folder. The lines of a ConfigError begin with the place."""
    with refusals(block, Policy, lambda problem: f"{place}: {problem.text}") as block:
        return _any_policy().validate_python(block, context={"folder": folder, "weights": weights or {}})


MOST = 80  # of the 101 whole setpoints; a policy that acts alike at fewer of them saturates there
ALIKE = 0.01  # of the largest difference of actions
FEW = 4  # observations, of which some differ in the actions unless these depend on the setpoint alone


def setpoint_notes(policy: Policy, scenario: Scenario, view: ViewOptions = PLAIN) -> Iterator[str]:
    """What says that a policy, whose objects are loaded, was trained at other setpoints, in lines."""
    frame = view.frame(scenario.drifting) if isinstance(policy, ObjectPolicy) else OBSERVED
    if OBSERVED[SETPOINT] not in frame:
        return
    moving = scenario.drifting  # to any setpoint
    setpoints = [0.0, *scenario.points, 100.0] if moving else scenario.points
    columns, at = len(frame), frame.index(OBSERVED[SETPOINT])
    far = [note for scaling in _scalings(policy) for note in far_notes(scaling, setpoints, columns, at)]
    yield from far
    differences = {} if far else {p: _difference(policy, p, TRIED_EPISODES, columns, at) for p in setpoints}
    if any(difference <= 2.0 * ALIKE for difference in differences.values()):  # actions are in [-1, 1]
        everywhere = [_difference(policy, p, FEW, columns, at) for p in range(101)]
        least = ALIKE * max(everywhere)
        alike = [exact(p) for p, difference in differences.items() if difference <= least]
        if alike and MOST <= sum(difference <= least for difference in everywhere) < 101:
            yield (
                f"at setpoint {', '.join(alike)} its actions depend on hardly anything else that it sees, at "
                "others they do: perhaps it scales observations by what it saw in training, at others"
            )
    for user_object in policy.everywhere(UserObject):
        user_object.adapter.clipped[:] = 0  # what was asked here is made up


def data_notes(label: str, policies: Sequence[Policy], set_name: str | None) -> Iterator[str]:
    """What says that the networks of a label saw different data, or others than those of a set, in lines."""
    weights = [part.weights for policy in policies for part in policy.everywhere(Network)]
    if len({(each.mean.tobytes(), each.std.tobytes()) for each in weights}) > 1:
        yield f"{label}: its networks scale observations differently, so they saw different data"
    cells = load(set_name).cells if weights and set_name is not None else ()
    if not cells or cells[0].drifting:
        return
    low, high = min(cell.setpoint for cell in cells), max(cell.setpoint for cell in cells)
    for mean, std in dict.fromkeys((float(x.mean[SETPOINT]), float(x.std[SETPOINT])) for x in weights):
        # A scaler that saw one setpoint has the deviation 0, or 1 in its place.
        if not low - 0.01 <= mean <= high + 0.01 or std > max(1.0, 0.51 * (high - low)):
            yield (
                f"{label}: it was trained on other data than {set_name}: it scales setpoints by the mean "
                f"{mean:.4g} and the deviation {std:.4g}, those of the set are from {low:g} to {high:g}"
            )


def burn_in_notes(policy: Policy, scenario: Scenario) -> Iterator[str]:
    """What says that a trained policy sees frames which no row of a dataset has, in a line."""
    if is_trained(policy) and policy.needs.history > 1 and not isinstance(scenario.world.start, str):
        yield "its first histories show the burn-in; in `arrays` and `windows` they repeat the first row"


def _scalings(policy: Policy) -> Iterator[dict[str, Any]]:
    """The scalings of the networks and models in a policy."""
    for part in policy.everywhere(Policy):
        if isinstance(part, Network):
            yield {"mean": part.weights.mean, "std": part.weights.std}
        elif isinstance(part, UserObject):
            with suppress(AttributeError, TypeError):  # of another scaler, or one that is not fitted
                if scaling := scaling_of(owner_of(part.adapter.target)):
                    yield scaling


def _difference(policy: Policy, setpoint: float, n: int, columns: int, at: int) -> float:
    """The largest difference between the actions on n random observations at a setpoint."""
    seen = histories(n, policy.needs.history, columns)
    seen[:, :, at] = setpoint
    [(_, actions)] = played(policy, seen, 1)
    return float(np.abs(actions - actions[0]).max())
