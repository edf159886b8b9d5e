"""The record of the code of custom policies, and the comparison of records.

A record holds the SHA-256 of each target and of each declared file. It also holds the SHA-256 of each module
that is in use after two steps, except for modules of Python, of installed packages and of ibdata. Last, it
holds the versions of the packages in use.
"""

from __future__ import annotations

import importlib.metadata
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from ibdata._system import processes
from ibdata._system.files import file_sha256
from ibdata.dataset.models import Code
from ibdata.errors import UsageError, printable
from ibdata.plan.dataset_spec import DatasetSpec
from ibdata.policies.code import OTHERS, file_of, is_of_user, two_places
from ibdata.policies.user_object import Custom, ObjectPolicy, UserObject


def code_record(policies: Sequence[UserObject]) -> list[Code]:
    """Describe the code of policies that have acted in this process.

    The first entry also holds the modules and packages of the whole process.
    """
    distinct = {(policy.code_target, *policy.files_used().values()): policy for policy in policies}.values()
    entries = []
    for policy in distinct:
        file = policy.target_file()
        entry = Code(
            target=policy.code_target,
            version=_version(policy.source.partition(".")[0]) if isinstance(policy, Custom) else None,
            sha256=None if file is None else file_sha256(file),
            files={name: file_sha256(path) for name, path in policy.files_used().items()},
        )
        entries.append(entry)
    if not all(isinstance(policy, ObjectPolicy) for policy in policies):
        files, versions = _in_use([policy.target_file() for policy in policies])
        update = {"files": files | entries[0].files, "distributions": versions}
        entries[0] = entries[0].model_copy(update=update)
    return entries


def _in_use(targets: Sequence[Path | None]) -> tuple[dict[str, str | None], dict[str, str]]:
    """The hashes of the modules in use besides the targets, and the versions of the packages in use."""
    files: dict[str, str | None] = {}
    packages = {"numba", "numpy"}
    for name, module in list(sys.modules.items()):
        path, package = file_of(module), name.partition(".")[0]
        if path is None or path in targets or package in OTHERS:
            continue
        if is_of_user(name, module):
            folders = name.split(".") if hasattr(module, "__path__") else name.split(".")[:-1]
            files["/".join([*folders, path.name])] = file_sha256(path)
        elif name not in processes.known_before and package not in sys.stdlib_module_names:
            packages.add(package)
    versions = {package: _version(package) for package in sorted(packages)}
    return files, {package: version for package, version in versions.items() if version is not None}


def _version(package: str) -> str | None:
    with suppress(importlib.metadata.PackageNotFoundError, ValueError):
        return importlib.metadata.version(package)
    version = getattr(sys.modules.get(package), "__version__", None)
    return version if isinstance(version, str) else None


def changed_here(spec: DatasetSpec, record: Sequence[Code]) -> list[str]:
    """The files of a record whose content differs on this machine. Nothing is imported to find them."""
    subfolders = [Path(), *(Path(code.target.partition(":")[0]).parent for code in record)]
    known = dict.fromkeys(custom.checked_with["folder"] for custom in spec.custom)
    places = dict.fromkeys(place for folder in known for place in two_places(Path.cwd(), folder))
    folders = [place / subfolder for place in places for subfolder in subfolders]
    folders += map(Path, sys.path)
    names = []
    for name, recorded in _hashes(record).items():
        paths = (folder / file for folder in folders for file in _files_of(name))
        path = next(filter(Path.is_file, paths), None)
        if path is not None and file_sha256(path) != recorded:
            names.append(name)
    return names


def _files_of(name: str) -> list[str]:
    """The files that a name in a record may mean. The name is a path or the target `package.module:name`."""
    source, colon, _ = name.partition(":")
    module = source.replace(".", "/")
    return [f"{module}.py", f"{module}/__init__.py"] if colon and not source.endswith(".py") else [source]


def changed(before: Iterable[Code], after: Iterable[Code]) -> list[str]:
    """The names of files and versions that two records share and that differ."""
    new_hashes = _hashes(after)
    return [name for name, value in _hashes(before).items() if new_hashes.get(name, value) != value]


def _hashes(record: Iterable[Code]) -> dict[str, str]:
    """The hashes and versions in a record, by their names in messages."""
    hashes: dict[str, str | None] = {}
    for code in record:
        hashes |= {code.target: code.sha256, **code.files}
        hashes |= {f"the version of {name}": version for name, version in code.distributions.items()}
    return {name: value for name, value in hashes.items() if value is not None}


def refuse_changed(recorded: Iterable[Code], policies: Sequence[UserObject], where: str | Path) -> None:
    """Raise UsageError if the files of these loaded policies differ from those of a record."""
    files = [code.model_copy(update={"distributions": {}}) for code in recorded]
    if names := changed(files, code_record(policies)):
        raise UsageError(
            f"{where}: found other code than the dataset was made with, in {names_of(names)}; restore it, "
            "and give a changed policy a file of its own"
        )


def names_of(names: Iterable[str]) -> str:
    """The first names of a list of files, as text for a message."""
    return printable(", ".join(list(names)[:8]))
