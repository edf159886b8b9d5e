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
from ibdata.experiment.bytecode import drop_stale_bytecode
from ibdata.experiment.fresh_modules import imported_before, imported_by_policies
from ibdata.experiment.imported_modules import Source, imported, loaded
from ibdata.policies.custom import Custom
from ibdata.system.files import file_sha256

AS_IMPORTED = " as imported"  # ends the names of modules that only an import has shown
NOTE = "ibdata_sha256"  # an attribute of a module's spec: the hash of its file when ibdata first saw it


def provenance(customs: Iterable[Custom]) -> list[Code]:
    """Describe custom policies without importing them.

    A description holds the target, the version of its distribution, the SHA-256 of its module, of each
    declared file and of each imported module that is not installed, and the versions of the installed ones.
    After the policies have been imported, the first one also holds the modules that they imported although
    their source files do not tell, as from a folder that is on `sys.path` for a moment.

    Raises UsageError if the target's file or a declared one is missing, or if this process has imported other
    code than a module's file holds.
    """
    policies = {(policy.target, policy.file(), *policy.declared().values()): policy for policy in customs}
    if not policies:
        return []
    owners = importlib.metadata.packages_distributions()
    found = [imported(policy.module()) for policy in policies.values()]
    _refuse_equal_names(source for sources, _ in found for source in sources.values())
    code = [_provenance(policy, *one, owners) for policy, one in zip(policies.values(), found, strict=True)]
    known = {_file(source) for sources, _ in found for source in sources.values()}
    more = {
        name: source for name, source in loaded(imported_before, owners).items() if _file(source) not in known
    }
    imported_by_policies.update({source.module: source for source in more.values()})
    files = {f"{name}{AS_IMPORTED}": _sha256(source) for name, source in more.items()}
    return [code[0].model_copy(update={"files": code[0].files | files}), *code[1:]]


def refuse_two(policies: Iterable[Custom]) -> None:
    """Raise UsageError if modules of policies have the same name, before any of them is imported."""
    _refuse_equal_names(source for policy in policies for source in imported(policy.module())[0].values())


def refuse_mixed(policies: Iterable[Custom]) -> None:
    """Raise UsageError if a policy has imported other code than its own while it was played.

    It may be another policy's module of the same name, or bytecode that is not that of its file.
    """
    for source in _since_the_record().values():
        _refuse_stale(source)
    for policy in policies:
        for source in imported(policy.module())[0].values():
            if (spec := _spec_in_use(source.module)) is not None:
                _refuse_elsewhere(source, spec)


def _refuse_equal_names(sources: Iterable[Source]) -> None:
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
    late = _since_the_record()
    return [name for name, source in late.items() if file_sha256(_archive(source.path)) not in known]


def _since_the_record() -> dict[str, Source]:
    """The sources of the modules that policies have imported since `provenance` looked."""
    found = loaded(imported_before)
    return {name: x for name, x in found.items() if NOTE not in vars(_spec_in_use(x.module))}


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
    hashes = {name: file_sha256(path) for name, path in policy.declared().items()}
    declared = {name if files.get(name, x) == x else f"{name} as declared": x for name, x in hashes.items()}
    return Code(
        target=policy.target,
        version=next(iter(version.values()), None),
        sha256=files.pop(own, None),
        files=files | declared,
        distributions=_versions(packages, owners),
    )


def _versions(names: set[str], owners: Mapping[str, list[str]]) -> dict[str, str]:
    """Return the versions of the distributions of installed modules."""
    found = sorted({owner for name in names for owner in owners.get(name, ())})
    return {owner: importlib.metadata.version(owner) for owner in found}


def _refuse_stale(source: Source) -> None:
    """Raise UsageError if this process has imported bytecode that is not that of the module's file."""
    if drop_stale_bytecode(source):
        vars(_spec_in_use(source.module))[NOTE] = None
        raise UsageError(
            f"{source.path}: its bytecode was that of other code, which Python does not see where time and "
            "size of the file are the same; the bytecode was removed, so run again"
        )


def _archive(path: Path) -> Path:
    """The file of a module, or the zip file that holds it."""
    return next((folder for folder in path.parents if folder.is_file()), path)


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
    found = file_sha256(_archive(source.path))
    spec = _spec_in_use(source.module)
    if spec is None:
        return found
    _refuse_elsewhere(source, spec)
    _refuse_stale(source)
    if vars(spec).setdefault(NOTE, found) != found:
        raise UsageError(
            f"{source.path}: was changed after this process had imported it, so other code would run than it "
            "holds; start Python again"
        )
    return found
