"""Load experiments from YAML or from Python's data, with all errors at once and the place of each."""

from __future__ import annotations

import io
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from ruamel.yaml import YAML

from ibdata.errors import ConfigError, Loc, UsageError
from ibdata.experiment.messages import Problem, problems
from ibdata.experiment.models import Experiment, refusals
from ibdata.experiment.overrides import Overrides, override_all
from ibdata.experiment.plain import plain
from ibdata.experiment.shipped import find, is_suite, shipped, suites
from ibdata.experiment.yaml import MAX_BYTES, Document, StrictYamlError

# What gives an experiment: a path or a shipped name, a mapping, or an Experiment itself.
Config = str | os.PathLike[str] | Mapping[str, Any] | Experiment

__all__ = [
    "Config",
    "Experiment",
    "Overrides",
    "as_recorded",
    "as_yaml",
    "find",
    "in_full",
    "load",
    "load_all",
    "refuse_unreadable",
    "shipped",
    "suites",
    "validated",
]


def load(config: Config, overrides: Overrides = (), seed: int | None = None) -> Experiment:
    """Read and check an experiment.

    Args:
        config: The path of a YAML file, the name of a shipped experiment, a mapping with the same keys, or an
            Experiment.
        overrides: Replace single values: texts `key.sub=value` with values in YAML, or a mapping such as
            {"episodes": 10, "output.shard_rows": 1000}, in which mappings are merged.
        seed: Replaces the seed.

    Returns:
        The experiment, always a new object.

    Raises:
        UsageError: There is no such file, or it cannot be read.
        ConfigError: The experiment is invalid. `problems` has a line for each problem of the experiment and
            of the overrides: `file:line:column: key: what was found, what was expected`.
    """
    if isinstance(config, Mapping | Experiment):
        return _load_data(config, overrides, seed)
    path = find(config)
    if is_suite(path):
        example = sorted(path.glob("*.yaml"))[0]
        raise UsageError(
            f"{path}: found a folder of experiments, expected a file such as {example}; in Python, "
            "generate_all takes a folder"
        )
    try:
        with path.open("rb") as file:  # bounded, because a device may have no end
            document = Document(file.read(MAX_BYTES + 1))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    except StrictYamlError as error:
        raise ConfigError([f"{path}:{error}"]) from None
    if not isinstance(document.data, dict):
        raise ConfigError([f"{path}:1:1: found no mapping, expected an experiment such as 'name: …'"])

    def place(problem: Problem) -> str:
        line, column = document.place(problem.loc, problem.at_key)
        return f"{path}:{line}:{column}: "

    experiment = _overridden(document.data, overrides, seed, place, path.parent)
    vars(experiment)["folder"] = path.absolute().parent
    return experiment


def _load_data(config: Mapping[str, Any] | Experiment, overrides: Overrides, seed: int | None) -> Experiment:
    """The experiment of plain data, or the one that an Experiment records, with overrides."""
    given = as_recorded(config).plain() if isinstance(config, Experiment) else plain(config)
    experiment = _overridden(given, overrides, seed, lambda problem: "")
    vars(experiment)["folder"] = getattr(config, "folder", None)
    return experiment


def _overridden(
    data: dict[str, Any],
    overrides: Overrides,
    seed: int | None,
    place: Callable[[Problem], str],
    folder: Path | None = None,
) -> Experiment:
    """The experiment of data that are changed by overrides; `place` is where a problem of the data is.

    Paths in the data are relative to the folder, by default the current one.
    """
    places = override_all(data, overrides, seed)
    try:
        return as_recorded(
            Experiment.model_validate(data, context={"folder": folder})
        )  # Python's data may hold objects
    except ValidationError as error:
        lines = [_line(problem, places, place) for problem in problems(error, Experiment, data)]
        raise ConfigError(list(dict.fromkeys(lines))) from None


def validated(data: dict[str, Any], folder: Path | None = None) -> Experiment:
    """The experiment of plain data, with paths relative to a folder, by default the current one.

    Raises ConfigError with a line `key: found, expected` per problem.
    """
    with refusals(data):
        return Experiment.model_validate(data, context={"folder": folder})


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


def refuse_unreadable(experiment: Experiment) -> None:
    """Raise ConfigError if the YAML that a dataset records of an experiment is none that ibdata reads.

    It has all defaults written out, so it is larger and deeper than the YAML that a person writes.
    """
    try:
        Document(as_yaml(experiment))
    except StrictYamlError as error:
        found = f"{experiment.name}: with all defaults written out, {error.message}"
        raise ConfigError([f"{found}; make several experiments of it"]) from None


def load_all(config: Config, overrides: Overrides = (), seed: int | None = None) -> list[Experiment]:
    """The experiments of a folder or a shipped suite in the order of their files, or the one of `load`.

    Raises the errors of `load`, with the problems of all files at once, and ConfigError if two experiments
    have the same name.
    """
    if isinstance(config, Mapping | Experiment):
        return [load(config, overrides, seed)]
    path = find(config)
    files = sorted(path.glob("*.yaml")) if is_suite(path) else [path]
    experiments: dict[str, Experiment] = {}
    found: dict[str, list[str]] = {}  # problem → files
    for file in files:
        try:
            experiment = load(file, overrides, seed)
        except UsageError as error:
            for problem in _lines(error):
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


def _lines(error: UsageError) -> list[str]:
    return error.with_options.split("\n") if isinstance(error, ConfigError) else [error.with_options]


def _with_files(problem: str, files: list[str], total: int) -> list[str]:
    """A problem with the names of its files, unless all files have it or it already names its file."""
    named = len(files) == total or problem.startswith(files[0])
    return [problem] if named else [f"{file}: {problem}" for file in files]


def as_yaml(experiment: Experiment) -> bytes:
    """The resolved experiment, from which the dataset can be made again, as a dataset records it in UTF-8."""
    return _yaml(experiment.plain())


def in_full(experiment: Experiment, ascii: bool = False) -> bytes:
    """The resolved experiment with all defaults, for people, as UTF-8 or as ASCII."""
    return _yaml(experiment.in_full(), ascii)


def _yaml(data: dict[str, Any], ascii: bool = False) -> bytes:
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.allow_unicode = not ascii
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # declared as None
    out = io.BytesIO()
    yaml.dump(data, out)
    return out.getvalue()


def _line(problem: Problem, places: dict[Loc, str], place: Callable[[Problem], str]) -> str:
    """A problem with its place: the override that caused it, or else where it is in the data."""
    loc, key, message = problem.loc, problem.key, problem.message
    for length in range(len(loc), 0, -1):
        if (option := places.get(loc[:length])) is not None:
            return f"{option}: {message}" if option == f"--{key}" else f"{option}: {key}: {message}"
    return f"{place(problem)}{f'{key}: ' if key else ''}{message}"
