"""A record of the code of custom policies, and the refusal of code that is not what their files hold."""

from __future__ import annotations

import importlib.metadata
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path

from ibdata.dataset.models import Code
from ibdata.errors import UsageError
from ibdata.experiment.custom_code import customs
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.fresh_modules import imported_before, imported_by_policies
from ibdata.experiment.imported_code import NOTE, archive, drop_stale_bytecode, noted_sha256
from ibdata.experiment.imported_modules import Source, imported, loaded
from ibdata.policies.code_places import located
from ibdata.policies.custom import Custom
from ibdata.system.atomic_files import file_sha256


def provenance(spec: DatasetSpec) -> list[Code]:
    """Describe the custom policies without importing them.

    A description holds the target, the version of its distribution, the SHA-256 of its module, of each
    declared file and of each imported module that is not installed, and the versions of the installed ones.
    After the policies have been imported, the first one also holds the modules that they imported although
    their source files do not tell, as from a folder that is on `sys.path` for a moment.

    Raises UsageError if the target's file or a declared one is missing, or if this process has imported other
    code than a module's file holds.
    """
    policies = {(policy.target, *(policy.files or ())): policy for policy in customs(spec)}
    if not policies:
        return []
    owners = importlib.metadata.packages_distributions()
    found = [imported(policy.module()) for policy in policies.values()]
    _refuse_two(source for sources, _ in found for source in sources.values())
    code = [_provenance(policy, *one, owners) for policy, one in zip(policies.values(), found, strict=True)]
    known = {_file(source) for sources, _ in found for source in sources.values()}
    more = {
        name: source for name, source in loaded(imported_before, owners).items() if _file(source) not in known
    }
    imported_by_policies.update({source.module: source for source in more.values()})
    first = code[0].files
    files = {f"{name} as imported" if name in first else name: _sha256(x) for name, x in more.items()}
    return [code[0].model_copy(update={"files": first | files}), *code[1:]]


_loaded_once: dict[str, Source] = {}  # the modules of all policies of which `load_once` was called


def load_once(policy: Custom) -> None:
    """Load a policy to play it. Python imports each of its modules once, whatever plays it later.

    Raises UsageError if the name of one of its modules means another file in this process, or if the file was
    changed after the process had imported it.
    """
    for source in _of_one_name_each(policy):
        if _spec_in_use(source.module) is None:
            drop_stale_bytecode(source)
        _sha256(source)
    policy.load()
    for source in _of_one_name_each(policy):  # the policy may have added a folder to sys.path
        _loaded_once[source.module] = source
        _sha256(source)


def refuse_mixed() -> None:
    """Raise UsageError if a policy of `load_once` has imported another one's module while it was played.

    Modules that were imported only then are noted, so that a later edit of them is seen.
    """
    for source in _loaded_once.values():
        if (spec := _spec_in_use(source.module)) is not None:
            _refuse_elsewhere(source, spec)
            noted_sha256(spec, source.path)


def _of_one_name_each(policy: Custom) -> list[Source]:
    """The sources of a policy. UsageError if another policy of `load_once` has a module of the same name."""
    sources = list(imported(policy.module())[0].values())
    _refuse_two([*_loaded_once.values(), *sources])
    return sources


def _refuse_two(sources: Iterable[Source]) -> None:
    """Raise UsageError if two files are modules of the same name, of which Python would import only one."""
    known: dict[str, Path] = {}
    for source in sources:
        other = known.setdefault(source.module, source.path)
        if not _same(other, source.path):
            raise _other_module(source, other)


def imported_late(code: Sequence[Code]) -> list[str]:
    """Names of modules that were imported since `provenance` looked, and whose code it does not have.

    Args:
        code: What `provenance` returned.
    """
    known = {hashed for each in code for hashed in (each.sha256, *each.files.values())}
    return [
        name
        for name, source in loaded(imported_before).items()
        if NOTE not in vars(_spec_in_use(source.module)) and file_sha256(archive(source.path)) not in known
    ]


def _file(source: Source) -> tuple[str, str]:
    """A module and its file, however its path is written."""
    return source.module, os.path.realpath(source.path)


def _same(one: str | Path, other: str | Path) -> bool:
    """Whether two paths name one file, which may be in a zip file."""
    return os.path.realpath(one) == os.path.realpath(other)


def _provenance(
    policy: Custom, sources: dict[str, Source], packages: set[str], owners: Mapping[str, list[str]]
) -> Code:
    module = policy.module()
    files = {name: _sha256(source) for name, source in sources.items()}
    own = next((name for name, source in sources.items() if source.module == module), "")
    version = _versions({module.partition(".")[0]}, owners)
    declared = {name: located(name, f"{policy.target}: files") for name in policy.files or ()}
    return Code(
        target=policy.target,
        version=next(iter(version.values()), None),
        sha256=files.pop(own, None),
        files=files | {name: file_sha256(path) for name, path in declared.items()},
        distributions=_versions(packages, owners),
    )


def _versions(names: set[str], owners: Mapping[str, list[str]]) -> dict[str, str]:
    """Return the versions of the distributions of installed modules."""
    found = sorted({owner for name in names for owner in owners.get(name, ())})
    return {owner: importlib.metadata.version(owner) for owner in found}


def _spec_in_use(module: str) -> ModuleSpec | None:
    return getattr(sys.modules.get(module), "__spec__", None)


def _other_module(source: Source, other: str | Path) -> UsageError:
    return UsageError(
        f"{source.path}: found another module with the name {source.module} in use, {other}; rename one of "
        "the two"
    )


def _refuse_elsewhere(source: Source, spec: ModuleSpec) -> None:
    """Raise UsageError if the spec, of the module that this process has imported, names another file."""
    if spec.origin and not _same(spec.origin, source.path):
        raise _other_module(source, spec.origin)


def _sha256(source: Source) -> str | None:
    """Return the hash of a module's file. Raises UsageError if this process has imported other code."""
    found = file_sha256(archive(source.path))
    spec = _spec_in_use(source.module)
    if spec is None:
        return found
    _refuse_elsewhere(source, spec)
    noted = noted_sha256(spec, source.path)
    if drop_stale_bytecode(source):
        vars(spec)[NOTE] = None
        raise UsageError(
            f"{source.path}: its bytecode was that of other code, which Python does not see where time and "
            "size of the file are the same; the bytecode was removed, so run again"
        )
    if noted != found:
        raise UsageError(
            f"{source.path}: was changed after this process had imported it, so other code would run than it "
            "holds; start Python again"
        )
    return found
