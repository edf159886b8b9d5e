"""Consent to the custom code of an experiment, and a record of the code that ran."""

from __future__ import annotations

import importlib.metadata
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.machinery import ExtensionFileLoader, ModuleSpec, SourceFileLoader
from importlib.util import cache_from_source
from pathlib import Path
from types import ModuleType

from ibdata.dataset.models import Code, Manifest
from ibdata.errors import UsageError, printable
from ibdata.experiment.dataset_spec import DatasetSpec, spec_in
from ibdata.experiment.imported_modules import Source, imported, is_users, loaded
from ibdata.policies import Policy
from ibdata.policies.code_places import located, looking_in
from ibdata.policies.custom import Custom, importing
from ibdata.system.atomic_files import file_sha256


def customs(spec: DatasetSpec) -> list[Custom]:
    """Return every custom policy, including those of which another policy is made."""
    return [found for e in spec.experiments for policy in e.policies for found in customs_in(policy)]


def customs_in(policy: Policy) -> Iterator[Custom]:
    """Yield the policy and all of which it is made, as far as they are custom."""
    return (each for each in policy.everywhere() if isinstance(each, Custom))


def require_consent(spec: DatasetSpec, where: str | Path, allow_code: bool) -> None:
    """Print on stderr which custom code will run.

    Raises UsageError if there is such code and allow_code is false, or if the code is in the script that was
    started, because it could not be imported to make the dataset again.
    """
    targets = spec.code_targets
    if targets and not allow_code:
        raise UsageError(
            f"{where}: found a custom policy, {printable(', '.join(targets))}, which is code that would run; "
            "--allow-code if you trust it"
        )
    for target in targets:
        if target.startswith("__main__:"):
            raise UsageError(
                f"{where}: found the target {target}, which is in the script itself, expected one in a "
                "module that worker processes can import; move it to a file of its own"
            )
        print(f"ibdata: running the code of {printable(target)}", file=sys.stderr, flush=True)


def consented_spec(folder: Path, listed: Manifest, allow_code: bool) -> DatasetSpec:
    """Return the specification of a dataset, after `require_consent`, to make its episodes again."""
    spec = spec_in(folder, listed)
    require_consent(spec, folder, allow_code)
    return spec


@contextmanager
def in_one_folder(spec: DatasetSpec) -> Iterator[None]:
    """A context that imports policies anew, and restores the current folder and the modules.

    Code is looked for in the current folder and in that of the first experiment's YAML file.
    """
    if not customs(spec):
        yield
        return
    here = os.getcwd()
    with looking_in(spec.experiments[0].folder):
        known = forget_modules(spec)
        try:
            yield
        finally:
            _restore(known)
            with suppress(OSError):  # it was removed
                os.chdir(here)


_others: set[str] = set()  # the names of the modules that were imported before those of the policies
_seen: dict[str, Source] = {}  # the modules that policies of this process have imported
_aside: dict[str, ModuleType] = {}  # modules that are taken away only until the policies are imported


def forget_modules(spec: DatasetSpec) -> dict[str, ModuleType]:
    """Take modules that are not installed, and those of custom policies, out of `sys.modules`; return them.

    What is imported next is what their files hold now. A package stays if it has loaded machine code, which
    cannot be loaded twice.
    """
    sources = list(_seen.values())
    for policy in customs(spec):
        with suppress(UsageError):  # a file that is not found is named where it is needed
            sources += imported(policy.module())[0].values()
    for source in sources:
        _drop_stale_bytecode(source)
    tops = {source.module.partition(".")[0] for source in sources} - sys.stdlib_module_names
    with importing:
        taken = _taken(name for name in sys.modules if name.partition(".")[0] in tops)
        _aside.update(_taken(name for name, module in sys.modules.items() if is_users(name, module)))
        _others.clear()
        _others.update(sys.modules.keys() - _seen.keys())
        return taken | _aside


def bring_back_others() -> None:
    """Put the modules that the policies have not imported back into `sys.modules`."""
    with importing:
        _others.update(_aside.keys() - sys.modules.keys())
        sys.modules.update({name: _aside[name] for name in _aside.keys() - sys.modules.keys()})
        _aside.clear()


def _restore(known: dict[str, ModuleType]) -> None:
    """Take the modules that policies imported out of `sys.modules`, and put those before in their place."""
    from ibdata.numerics.code_cache import compile_others_anew

    with importing:
        _seen.update({source.module: source for source in loaded(_others).values()})
        _taken(_seen.keys() - _others)
        compile_others_anew(False)
        sys.modules.update(known)
        _others.update(known)
        _aside.clear()


def _taken(names: Iterable[str]) -> dict[str, ModuleType]:
    """Take modules out of `sys.modules`, except those of packages that have loaded machine code."""
    found = [name for name in list(names) if name in sys.modules]
    stay = {name.partition(".")[0] for name, module in list(sys.modules.items()) if _is_machine_code(module)}
    return {name: sys.modules.pop(name) for name in found if name.partition(".")[0] not in stay}


def _drop_stale_bytecode(source: Source) -> bool:
    """Remove bytecode that is not that of its source; return whether there was such.

    Python itself only compares time and size of the source.
    """
    kept = Path(cache_from_source(str(source.path)))
    if not (source.path.suffix == ".py" and source.path.is_file() and kept.is_file()):
        return False
    loader = SourceFileLoader(source.module, str(source.path))
    with suppress(SyntaxError, ValueError, EOFError):
        if loader.get_code(source.module) == loader.source_to_code(source.path.read_bytes(), source.path):
            return False
    try:
        kept.unlink(missing_ok=True)
    except OSError:
        raise UsageError(f"{kept}: holds other code than {source.path}; remove it") from None
    return True


def _is_machine_code(module: ModuleType) -> bool:
    spec = getattr(module, "__spec__", None)
    return spec is not None and isinstance(spec.loader, ExtensionFileLoader)


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
    code = [_provenance(policy, *one, owners) for policy, one in zip(policies.values(), found, strict=True)]
    known = {_file(source) for sources, _ in found for source in sources.values()}
    more = {name: source for name, source in loaded(_others, owners).items() if _file(source) not in known}
    _seen.update({source.module: source for source in more.values()})
    first = code[0].files
    files = {f"{name} as imported" if name in first else name: _sha256(x) for name, x in more.items()}
    return [code[0].model_copy(update={"files": first | files}), *code[1:]]


def imported_late(code: Sequence[Code]) -> list[str]:
    """Names of modules that were imported since `provenance` looked, and whose code it does not have.

    Args:
        code: What `provenance` returned.
    """
    known = {hashed for each in code for hashed in (each.sha256, *each.files.values())}
    return [
        name
        for name, source in loaded(_others).items()
        if _imported.get(source.module, (None, None))[0] is not _spec_in_use(source.module)
        and file_sha256(_archive(source)) not in known
    ]


def _file(source: Source) -> tuple[str, str]:
    """A module and its file, however its path is written."""
    return source.module, os.path.realpath(source.path)


def _provenance(
    policy: Custom, sources: dict[str, Source], others: set[str], owners: Mapping[str, list[str]]
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
        distributions=_versions(others, owners),
    )


def _versions(names: set[str], owners: Mapping[str, list[str]]) -> dict[str, str]:
    """Return the versions of the distributions of installed modules."""
    found = sorted({owner for name in names for owner in owners.get(name, ())})
    return {owner: importlib.metadata.version(owner) for owner in found}


# The spec and the hash of each module when this process first saw it.
_imported: dict[str, tuple[ModuleSpec, str | None]] = {}


def _spec_in_use(module: str) -> ModuleSpec | None:
    return getattr(sys.modules.get(module), "__spec__", None)


def _archive(source: Source) -> Path:
    """The file of a module, or the zip file that holds it."""
    return next((path for path in source.path.parents if path.is_file()), source.path)


def _sha256(source: Source) -> str | None:
    """Return the hash of a module's file. Raises UsageError if this process has imported other code."""
    found = file_sha256(_archive(source))
    spec = _spec_in_use(source.module)
    if spec is None:
        return found
    if _drop_stale_bytecode(source):
        raise UsageError(
            f"{source.path}: its bytecode was that of other code, which Python does not see where time and "
            "size of the file are the same; the bytecode was removed, so run again"
        )
    other = spec.origin if spec.has_location else None
    elsewhere = other and os.path.realpath(other) != os.path.realpath(source.path)
    if other and elsewhere and file_sha256(Path(other)) != found:
        raise UsageError(
            f"{source.path}: found another module with the name {source.module} in use, {other}; rename one "
            "of the two"
        )
    known, was = _imported.get(source.module, (None, None))
    if known is not spec:  # imported or reloaded since then
        _imported[source.module] = spec, found
    elif was != found:
        raise UsageError(
            f"{source.path}: was changed after this process had imported it, so code would run that is not "
            "recorded; start Python again"
        )
    return found
