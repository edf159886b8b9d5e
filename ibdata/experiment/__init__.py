"""Load experiments from YAML files, with all errors at once as file:line:column."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from ruamel.yaml import YAML

from ibdata.errors import ConfigError, Loc, UsageError
from ibdata.experiment.messages import Problem, problems
from ibdata.experiment.models import Experiment
from ibdata.experiment.shipped import find, is_suite, shipped, suites
from ibdata.experiment.yaml import MAX_BYTES, MAX_DEPTH, Document, StrictYamlError

__all__ = [
    "Experiment",
    "as_recorded",
    "as_yaml",
    "find",
    "load",
    "load_all",
    "shipped",
    "suites",
    "validated",
]


def load(
    config: str | os.PathLike[str], overrides: Sequence[str] = (), seed: int | None = None
) -> Experiment:
    """Read the experiment of a YAML file.

    Args:
        config: the path of the file, or the name of a shipped experiment.
        overrides: texts `key.sub=value`, each of which replaces a value of the file.
        seed: replaces the seed of the file.

    Raises:
        UsageError: there is no such file, or it cannot be read.
        ConfigError: the experiment is invalid. `problems` has a line for each problem of the file and of the
            overrides: `file:line:column: key: what was found, what was expected`.
    """
    path = find(config)
    if is_suite(path):
        example = sorted(path.glob("*.yaml"))[0]
        raise UsageError(f"{path}: found a folder of experiments, expected a file such as {example}")
    try:
        with path.open("rb") as file:  # bounded, because a device may have no end
            document = Document(file.read(MAX_BYTES + 1))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    except StrictYamlError as error:
        raise ConfigError([f"{path}:{error}"]) from None
    if not isinstance(document.data, dict):
        raise ConfigError([f"{path}:1:1: found no mapping, expected an experiment such as 'name: …'"])
    places = _override_all(document, [*overrides, *([] if seed is None else [f"seed={seed}"])])
    try:
        experiment = Experiment.model_validate(document.data, context={"folder": path.parent})
    except ValidationError as error:
        found = problems(error, Experiment, document.data)
        lines = [_line(problem, document, str(path), places) for problem in found]
        raise ConfigError(list(dict.fromkeys(lines))) from None
    vars(experiment)["folder"] = path.absolute().parent
    return experiment


def validated(data: dict[str, Any], folder: Path | None = None) -> Experiment:
    """The experiment of plain data, with paths relative to a folder, by default the current one.

    Raises ConfigError with a line `key: found, expected` per problem.
    """
    try:
        return Experiment.model_validate(data, context={"folder": folder})
    except ValidationError as error:
        found = problems(error, Experiment, data)
        raise ConfigError([f"{problem.key}: {problem.message}" for problem in found]) from None


def as_recorded(experiment: Experiment) -> Experiment:
    """The experiment that its own YAML gives, from which its dataset is made here and anywhere.

    Raises:
        ConfigError: it is not valid.
        UsageError: it is another than that, as one with an instance of a subclass of a policy.
    """
    recorded = validated(experiment.plain())
    if recorded != experiment:
        raise UsageError(
            f"{experiment.name}: found an experiment that its YAML does not give again, such as one with an "
            "object of a class derived from a policy of ibdata; expected code of your own as kind: custom"
        )
    vars(recorded)["folder"] = experiment.folder
    return recorded


def load_all(
    config: str | os.PathLike[str], overrides: Sequence[str] = (), seed: int | None = None
) -> list[Experiment]:
    """The experiments of a folder or a shipped suite in the order of their files, or that of one file.

    Raises the errors of `load`, with the problems of all files at once, and ConfigError if two experiments
    have the same name.
    """
    path = find(config)
    files = sorted(path.glob("*.yaml")) if is_suite(path) else [path]
    experiments: dict[str, Experiment] = {}
    found: dict[str, list[str]] = {}  # problem → files
    for file in files:
        try:
            experiment = load(file, overrides, seed)
        except UsageError as error:
            for problem in error.problems if isinstance(error, ConfigError) else [str(error)]:
                found.setdefault(problem, []).append(str(file))
            continue
        if experiment.name in experiments:
            message = (
                f"found {experiment.name!r} as in another file of the folder, expected a name of its own"
            )
            found[f"{file}: name: {message}"] = [str(file)]
        experiments[experiment.name] = experiment
    if found:
        raise ConfigError([line for item in found.items() for line in _with_files(*item, len(files))])
    return list(experiments.values())


def _with_files(problem: str, files: list[str], total: int) -> list[str]:
    """A problem with the names of its files, unless all files have it or it already names its file."""
    named = len(files) == total or problem.startswith(files[0])
    return [problem] if named else [f"{file}: {problem}" for file in files]


def as_yaml(experiment: Experiment, ascii: bool = False) -> bytes:
    """The resolved experiment, from which the dataset can be made again, as UTF-8 or as ASCII."""
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.allow_unicode = not ascii
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # declared as None
    out = io.BytesIO()
    yaml.dump(experiment.plain(), out)
    return out.getvalue()


def _override_all(document: Document, overrides: Sequence[str]) -> dict[Loc, str]:
    """Apply overrides to the data. Returns the override behind each changed path."""
    places: dict[Loc, str] = {}
    for override in overrides:
        key, equals, text = override.partition("=")
        loc: Loc = tuple(
            int(part) if re.fullmatch("[0-9]{1,9}", part) else part for part in key.strip().split(".")
        )
        if not equals or not all(part != "" for part in loc) or len(loc) > MAX_DEPTH:
            raise UsageError(f"--set: found {override!r}, expected key=value")
        try:
            value = Document(text).data
        except StrictYamlError as error:
            raise UsageError(f"--set {override}: {error.message}") from None
        for put in _put(document.data, loc, value, override):
            places[put] = f"--set {override}"
    return places


def _put(data: Any, loc: Loc, value: Any, override: str) -> list[Loc]:
    """Put a value into the data. Returns the paths of all new values."""
    new: list[Loc] = []
    path: Loc = ()
    for i, part in enumerate(loc):
        last = i == len(loc) - 1
        if isinstance(data, list) and isinstance(part, int) and part < len(data):
            pass
        elif isinstance(data, dict):
            part = str(part)
            if not last and not isinstance(data.get(part), dict | list):
                data[part] = {}
                new.append((*path, part))
        else:
            raise UsageError(f"--set {override}: there is no {'.'.join(map(str, loc[: i + 1]))} to set")
        path = (*path, part)
        if last:
            data[part] = value
        data = data[part]
    return [*new, path]


def _line(problem: Problem, document: Document, path: str, places: dict[Loc, str]) -> str:
    """A problem with its place: the override that caused it, or file, line and column."""
    loc, key, message = problem.loc, problem.key, problem.message
    for length in range(len(loc), 0, -1):
        if loc[:length] in places:
            return f"{places[loc[:length]]}: {key}: {message}"
    line, column = document.place(loc, problem.at_key)
    return f"{path}:{line}:{column}: {f'{key}: ' if key else ''}{message}"
