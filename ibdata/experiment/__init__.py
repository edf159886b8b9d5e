"""Find and load experiments, from YAML or from Python data, with single values replaced by overrides.

All errors are reported at once, each with its position.
"""

from __future__ import annotations

import io
import os
import re
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from ruamel.yaml import YAML

from ibdata._numerics.arguments import native, public
from ibdata._system.configs import configs_in, shipped, suites
from ibdata.errors import ConfigError, Loc, UsageError, suggestion
from ibdata.experiment.fields import Output
from ibdata.experiment.messages import ConfigProblem, refusals
from ibdata.experiment.models import Experiment
from ibdata.experiment.yaml import MAX_DEPTH, Document, StrictYamlError
from ibdata.policies.base import FrozenModel
from ibdata.policies.compound import block_of

# The ways to name an experiment: a path, a shipped name, a mapping, or an Experiment itself.
Config = Annotated[
    str | os.PathLike[str] | Mapping[str, Any] | Experiment,
    "a file, the name of a shipped experiment, a mapping or an Experiment",
]
Overrides = Annotated[Sequence[str] | Mapping[str, Any], "a list of texts key=value, or a mapping"]

KEYS = (*Experiment.model_fields, *(f"output.{name}" for name in Output.model_fields))

__all__ = [
    "KEYS",
    "Config",
    "Experiment",
    "Overrides",
    "as_yaml",
    "find",
    "load",
    "load_all",
    "shipped",
    "suites",
]


def find(config: str | os.PathLike[str]) -> Path:
    """Find a config file or a folder of configs, by path or else by shipped name, with or without '.yaml'.

    A folder without configs is ignored. Raises UsageError if there is no match.
    """
    path = Path(os.path.expanduser(config))
    if os.path.exists(path) and (not os.path.isdir(path) or configs_in(path)):  # False for an invalid name
        return path
    known = {**shipped(), **suites()}
    name = os.fspath(config).removesuffix("/").removesuffix(".yaml")
    if name in known:
        return known[name]
    if name and os.path.isdir(path):
        raise UsageError(
            f"config: found the folder {os.fspath(config)!r} without a file *.yaml, expected one with such "
            "files, each an experiment; ibdata init makes a first one"
        )
    if os.path.isfile(f"{name}.yaml"):
        raise UsageError(f"config: found {os.fspath(config)!r}; did you mean {name + '.yaml'!r}?")
    short = ", ".join(each for each in known if "/" not in each)
    expected = suggestion(name, known) or f", expected a file or one of {short}"
    raise UsageError(f"config: found {os.fspath(config)!r}{expected}")


@partial(public, keys=KEYS)
def load(config: Config, overrides: Overrides = (), seed: int | None = None) -> Experiment:
    """Read and check an experiment.

    Args:
        config: The path of a YAML file, the name of a shipped experiment, a mapping with the same keys, or an
            Experiment.
        overrides: Replace single values: texts `key.sub=value` with values in YAML, or a mapping such as
            {"episodes": 10, "output.shard_rows": 1000}.
        seed: Replaces the seed.

    Returns:
        The experiment, always a new object.

    Raises:
        UsageError: There is no such file, or it cannot be read.
        ConfigError: The experiment is invalid. `problems` has a line for each problem of the experiment and
            of the overrides: `file:line:column: key: what was found, what was expected`.
    """
    if isinstance(config, Experiment):
        return _checked(config.options(), overrides, seed, config.checked_with)
    if isinstance(config, Mapping):
        return _checked(config, overrides, seed, {"weights": {}})
    path = find(config)
    if files := configs_in(path):
        raise UsageError(
            f"{path}: found a folder of experiments, expected a file such as {files[0]}; "
            "generate takes a folder"
        )
    return _read(path, overrides, seed)


class Loaded(NamedTuple):
    """Experiments, and where they are from."""

    folder: Path | None  # None for one experiment
    files: list[Path]  # of the experiments; none if it is given in Python
    experiments: list[Experiment]


def load_all(config: Config, overrides: Overrides = (), seed: int | None = None) -> Loaded:
    """Find and load all experiments of a folder or a shipped suite, in the order of their files.

    Anything else is one experiment, as in `load`. Raises the errors of `load`, for all files at once.
    """
    if isinstance(config, Mapping | Experiment):
        return Loaded(None, [], [load(config, overrides, seed)])
    path = find(config)
    files = configs_in(path)
    experiments: list[Experiment] = []
    problems: list[str] = []
    for file in files or [path]:
        try:
            experiments.append(_read(file, overrides, seed))
        except UsageError as error:
            problems += str(error).split("\n")
    if problems:
        raise ConfigError(list(dict.fromkeys(problems)))  # each file reports the same problem of an override
    return Loaded(path, files, experiments) if files else Loaded(None, [path], experiments)


def _read(path: Path, overrides: Overrides, seed: int | None) -> Experiment:
    """Load the experiment in a file."""
    try:
        document = Document(path.read_bytes())
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    except StrictYamlError as error:
        raise ConfigError([f"{path}:{error}"]) from None
    if not isinstance(document.data, dict):
        raise ConfigError([f"{path}:1:1: found no mapping, expected an experiment such as 'name: …'"])

    def place(problem: ConfigProblem) -> str:
        line, column = document.position(problem.loc, problem.at_key)
        return f"{path}:{line}:{column}: "

    context = {"folder": path.parent.absolute(), "weights": {}}
    return _checked(document.data, overrides, seed, context, place)


def _checked(
    data: Mapping[str, Any],
    overrides: Overrides,
    seed: int | None,
    context: dict[str, Any],
    place: Callable[[ConfigProblem], str] = lambda problem: "",
) -> Experiment:
    """Apply the overrides and check the experiment; `place` begins the line of a problem in the file."""
    changed: set[Loc] = set()
    plain: dict[str, Any] = native(data)
    pairs = overrides.items() if isinstance(overrides, Mapping) else map(_parsed, overrides)
    for key, value in pairs:
        value = native(value)
        options = {str(key): value}
        if key == "output" and isinstance(value, dict) and value:  # each option of `output` is an override
            options = {f"output.{name}": option for name, option in value.items()}
        changed |= {_put(plain, dotted, option) for dotted, option in options.items()}
    if seed is not None:
        plain["seed"] = seed

    def line(problem: ConfigProblem) -> str:
        if seed is not None and problem.loc == ("seed",):
            return problem.text
        is_changed = any(problem.loc[:length] in changed for length in range(1, len(problem.loc) + 1))
        return f"override {problem.text}" if is_changed else place(problem) + problem.text

    with refusals(plain, Experiment, line) as plain:
        return Experiment.model_validate(plain, context=context)


def _parsed(override: str) -> tuple[str, Any]:
    """The dotted key and the value of a text key=value."""
    key, equals, text = override.partition("=")
    if not equals:
        raise UsageError(f"override: found {override!r}, expected key=value")
    try:
        return key.strip(), Document(text).data
    except StrictYamlError as error:
        raise UsageError(f"override {key.strip()}: {error.message}") from None


def _put(data: Any, key: str, value: Any) -> Loc:
    """Put a value at a dotted key. Returns the shortest new path.

    A missing parent becomes a mapping, and the bare name or the object of a policy becomes its block.
    """
    if (dotted := re.sub(r"\.?\[['\"]?(\w+)['\"]?\]", r".\1", key)) != key:
        raise UsageError(f"override: found the key {key!r}; did you mean {dotted!r}?")
    *parents, last = key.split(".")
    if not all([*parents, last]) or len(parents) >= MAX_DEPTH:
        raise UsageError(f"override: found the key {key!r}, expected names joined by dots")
    path: Loc = ()
    new_path: Loc = ()
    for part in parents:
        index = _index(data, part, key)
        path = (*path, index)
        child = data.get(index) if isinstance(data, dict) else data[index]
        if path[0] == "policies":
            child = data[index] = block_of(child)
        if isinstance(child, FrozenModel):
            child = data[index] = native(child.options())
        elif not isinstance(child, dict | list):
            child = data[index] = {}
            new_path = new_path or path
        data = child
    index = _index(data, last, key)
    data[index] = value
    return new_path or (*path, index)


def _index(data: Any, part: str, key: str) -> str | int:
    """The index of a part of a dotted key: a key of a mapping, or a number in a list."""
    if isinstance(data, dict):
        return part
    if re.fullmatch("[0-9]{1,9}", part) and int(part) < len(data):
        return int(part)
    raise UsageError(f"override {key}: there is no item {part}")


def as_yaml(experiment: Experiment, ascii: bool = False) -> bytes:
    """The experiment with all defaults as YAML in UTF-8 or ASCII, as a dataset records it."""
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.allow_unicode = not ascii
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # declared as None
    buffer = io.BytesIO()
    yaml.dump(experiment.plain(), buffer)
    return buffer.getvalue()
