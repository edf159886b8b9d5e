"""The custom policies of an experiment: consent to their code, its record, and the comparison of records.

A record holds the SHA-256 of each target, of each declared file, and of each module that is in use after two
steps and is neither Python's, nor installed, nor ibdata's, and the versions of the packages in use.
"""

from __future__ import annotations

import importlib.metadata
import os
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from ibdata.dataset.models import Code, Manifest
from ibdata.errors import UsageError, printable, say
from ibdata.experiment.dataset_spec import DatasetSpec, spec_in
from ibdata.policies import Policy
from ibdata.policies.code import (
    Places,
    file_of,
    is_installed,
    known_before,
    refuse_within_itself,
    two_places,
)
from ibdata.policies.custom import Custom
from ibdata.system.files import file_sha256
from ibdata.system.storage import storage

OTHERS = ("ibdata", "__main__", "__mp_main__")  # packages whose modules are no part of a record


def customs(spec: DatasetSpec) -> list[Custom]:
    """Return every custom policy, including those of which another policy is made."""
    return [custom for e in spec.experiments for policy in e.policies for custom in customs_in(policy)]


def customs_in(policy: Policy) -> Iterator[Custom]:
    """Yield the policy and all of which it is made, as far as they are custom."""
    return (part for part in policy.everywhere() if isinstance(part, Custom))


def require_consent(spec: DatasetSpec, where: str | Path, allow_code: bool, again: bool = False) -> None:
    """Refuse custom policies without consent. Messages begin with `where`.

    Raises UsageError if the code may not run, or if a policy is a live object that is gone, or that other
    processes may have to ask `again`.
    """
    policies = customs(spec)
    targets = list(dict.fromkeys(custom.target for custom in policies if not custom.is_live))
    if targets and not allow_code:
        raise UsageError(
            f"{where}: found a custom policy, {printable(', '.join(targets))}, which is code that would run; "
            "--allow-code if you trust it"
        )
    refuse_within_itself(targets)
    for custom in policies:
        if custom.is_live and (again or not custom.is_held):
            raise UsageError(
                f"{where}: found {custom.target}, an object that acts in the Python session of its run and "
                "nowhere else; put its class into a file and name it with kind: custom"
            )
        for text in _undeclared(custom, places_of(spec)):
            say(f"{custom.target}: params: {text} is a file; list it under files, so that it is recorded")


def announce(spec: DatasetSpec) -> None:
    """Print on stderr which code of custom policies runs now."""
    for target in dict.fromkeys(custom.target for custom in customs(spec) if not custom.is_live):
        say(f"running the code of {target}")


def places_of(spec: DatasetSpec) -> Places:
    """The folders in which the code of custom policies is looked for."""
    return two_places(spec.experiments[0].folder)


def _undeclared(custom: Custom, places: Places) -> list[str]:
    """The texts in a policy's parameters that name an existing file, and are not declared."""
    texts = dict.fromkeys(_texts(custom.params))
    return [
        text
        for text in texts
        if text not in (custom.files or ()) and any(os.path.isfile(folder / text) for folder in places)
    ]


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, list | dict):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _texts(inner)


def consented_spec(place: Any, listed: Manifest, allow_code: bool) -> DatasetSpec:
    """Return the specification of a dataset, after `require_consent`, to make its episodes again."""
    spec = spec_in(place, listed)
    require_consent(spec, storage(place).name, allow_code, again=True)
    return spec


def record(policies: Sequence[Custom]) -> list[Code]:
    """Describe the code of policies that this process has loaded and that have acted.

    Modules and packages are those of the whole process, and are listed with the first policy.
    """
    distinct = {(policy.target, *policy.declared().values()): policy for policy in policies}.values()
    records = [
        Code(
            target=policy.target,
            version=None if policy.is_live else _version(re.split("[.:]", policy.target)[0]),
            sha256=_sha256(_target_file(policy)),
            files={name: file_sha256(path) for name, path in policy.declared().items()},
        )
        for policy in distinct
    ]
    if not all(policy.is_live for policy in policies):
        files, versions = _in_use([_target_file(policy) for policy in policies])
        records[0] = records[0].model_copy(
            update={"files": files | records[0].files, "distributions": versions}
        )
    return records


def _in_use(targets: Sequence[Path | None]) -> tuple[dict[str, str | None], dict[str, str]]:
    """The hashes of all other modules in use, and the versions of packages that were imported with them."""
    files: dict[str, str | None] = {}
    packages = {"numba", "numpy"}
    for name, module in list(sys.modules.items()):
        path, top = file_of(module), name.partition(".")[0]
        if path is None or path in targets or top in OTHERS:
            continue
        if not is_installed(path):
            folders = name.split(".") if hasattr(module, "__path__") else name.split(".")[:-1]
            files["/".join([*folders, path.name])] = file_sha256(path)
        elif name not in known_before and top not in sys.stdlib_module_names:
            packages.add(top)
    return files, {name: version for name in sorted(packages) if (version := _version(name)) is not None}


def _target_file(policy: Custom) -> Path | None:
    if policy.is_live:
        return None
    return policy.file() or file_of(sys.modules.get(policy.target.partition(":")[0]))


def _sha256(path: Path | None) -> str | None:
    return None if path is None else file_sha256(path)


def _version(package: str) -> str | None:
    with suppress(importlib.metadata.PackageNotFoundError, ValueError):
        return importlib.metadata.version(package)
    version = getattr(sys.modules.get(package), "__version__", None)
    return version if isinstance(version, str) else None


def changed_here(spec: DatasetSpec, began: Sequence[Code]) -> list[str]:
    """The files of a record that are other ones here, as far as they are found without importing anything."""
    beside = [Path(), *(Path(code.target.partition(":")[0]).parent for code in began)]
    folders = [*(root / path for root in places_of(spec) for path in beside), *map(Path, sys.path)]
    names = []
    for name, recorded in _hashes(began).items():
        paths = (folder / path for folder in folders for path in _files_of(name))
        file = next(filter(Path.is_file, paths), None)
        if file is not None and file_sha256(file) != recorded:
            names.append(name)
    return names


def _files_of(name: str) -> list[str]:
    """The files that a record's name may stand for: a path, or the target `package.module:name`."""
    source, colon, _ = name.partition(":")
    module = source.replace(".", "/")
    return [f"{module}.py", f"{module}/__init__.py"] if colon and not source.endswith(".py") else [source]


def changed(was: Iterable[Code], here: Iterable[Code]) -> list[str]:
    """What differs of the files and versions that two records both name."""
    one, other = _hashes(was), _hashes(here)
    return [name for name in one if name in other and other[name] != one[name]]


def _hashes(code: Iterable[Code]) -> dict[str, str]:
    """The hashes and versions in a record, by the names that messages give them."""
    hashes: dict[str, str | None] = {}
    for record in code:
        hashes |= {record.target: record.sha256, **record.files}
        hashes |= {f"the version of {name}": version for name, version in record.distributions.items()}
    return {name: value for name, value in hashes.items() if value is not None}


def refuse_changed(began: Iterable[Code], policies: Sequence[Custom], where: str | Path) -> None:
    """Raise UsageError if the files of these policies, which are loaded, are not those of a record."""
    files = [code.model_copy(update={"distributions": {}}) for code in began]
    if names := changed(files, record(policies)):
        raise UsageError(
            f"{where}: found other code than the dataset was made with, in {names_of(names)}; restore it, "
            "and give a changed policy a file of its own"
        )


def names_of(names: Iterable[str]) -> str:
    """Names of files in a record, for a message."""
    return printable(", ".join(list(names)[:8]))
