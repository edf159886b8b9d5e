"""Experiments: the YAML models, and `load` with all errors at once as file:line:column."""

from __future__ import annotations

import io
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from ruamel.yaml import YAML

from ibdata.errors import ConfigError, UsageError
from ibdata.experiment.messages import keys_at, rephrase, suggestion
from ibdata.experiment.models import Experiment, Problems
from ibdata.experiment.strict_yaml import MAX_BYTES, MAX_DEPTH, Document, Loc, StrictYamlError
from ibdata.policies import POLICIES

__all__ = ["Experiment", "as_yaml", "find", "load", "shipped"]


def shipped() -> dict[str, Path]:
    """The configs that come with ibdata, by name without ending."""
    here = Path(__file__).resolve().parent.parent
    # Installed, the configs lie inside the package; in a checkout, beside it.
    folder = next(path for path in (here / "configs", here.parent / "configs") if path.is_dir())
    return {path.stem: path for path in sorted(folder.glob("*.yaml"))}


def find(config: str | os.PathLike[str]) -> Path:
    """The config file meant: a path, else a shipped name with or without '.yaml'; UsageError if neither."""
    path = Path(config)
    if os.path.exists(path):  # False where the system refuses the name
        return path
    configs = shipped()
    name = os.fspath(config).removesuffix(".yaml")
    if name not in configs:
        raise UsageError(
            f"config: found {os.fspath(config)!r}, expected a file or one of {', '.join(configs)}"
            f"{suggestion(name, configs)}"
        )
    return configs[name]


def load(
    config: str | os.PathLike[str], overrides: Sequence[str] = (), seed: int | None = None
) -> Experiment:
    """The experiment of a YAML file (or shipped name), with `key.sub=value` overrides and a seed.

    Raises UsageError where there is no such file, ConfigError with every problem of the file and of the
    overrides as `file:line:column: key: what was found, what was expected`.
    """
    path = find(config)
    try:
        with path.open("rb") as file:  # which may have no end
            document = Document(file.read(MAX_BYTES + 1))
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from None
    except StrictYamlError as error:
        raise ConfigError([f"{path}:{error}"]) from None
    if not isinstance(document.data, dict):
        raise ConfigError([f"{path}:1:1: found no mapping, expected an experiment such as 'name: …'"])
    places = _override_all(document, [*overrides, *([] if seed is None else [f"seed={seed}"])])
    try:
        return Experiment.model_validate(document.data)
    except ValidationError as error:
        found = [line for e in error.errors() for line in _lines(e, document, str(path), places)]
        raise ConfigError(list(dict.fromkeys(found))) from None


def as_yaml(experiment: Experiment) -> bytes:
    """The resolved experiment, from which the dataset can be made again."""
    yaml = YAML(typ="safe", pure=True)
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # declared as None
    out = io.BytesIO()
    yaml.dump(experiment.plain(), out)
    return out.getvalue()


def _override_all(document: Document, overrides: Sequence[str]) -> dict[Loc, str]:
    """Put overrides into the data; where each came from, by path."""
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
    """Put a value into the data; the paths of what is new there."""
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


def _lines(error: Any, document: Document, path: str, places: dict[Loc, str]) -> list[str]:
    """One pydantic error as lines with their place; several for problems between keys."""
    inner = error.get("ctx", {}).get("error")
    if isinstance(inner, Problems):
        return [_line(loc, message, document, path, places, False) for loc, message in inner.found]
    loc = _resolved(error["loc"], document.data, keep_last=error["type"] in ("extra_forbidden", "missing"))
    if error["type"] == "union_tag_invalid":
        loc = (*loc, "kind")
    message = rephrase(error, keys_at(Experiment, document.data, loc[:-1], POLICIES))
    return [_line(loc, message, document, path, places, error["type"] == "extra_forbidden")]


def _line(loc: Loc, message: str, document: Document, path: str, places: dict[Loc, str], key: bool) -> str:
    name = ".".join(map(str, loc))
    for length in range(len(loc), 0, -1):
        if loc[:length] in places:
            return f"{places[loc[:length]]}: {name}: {message}"
    line, column = document.place(loc, key)
    return f"{path}:{line}:{column}: {f'{name}: ' if name else ''}{message}"


def _resolved(loc: Loc, data: Any, keep_last: bool) -> Loc:
    """The path without the parts that pydantic adds for the branches of unions."""
    out: list[str | int] = []
    in_policy = False  # the next part is the kind of a policy, which may be a key as well
    for i, part in enumerate(loc):
        here = (isinstance(data, dict) and part in data) or (
            isinstance(data, list) and isinstance(part, int) and part < len(data)
        )
        here = here and not in_policy
        in_policy = loc[0] == "policies" and (i == 1 or (part == "base" and here))
        if here:
            data = data[part]
        if here or (keep_last and i == len(loc) - 1):
            out.append(part)
    return tuple(out)
