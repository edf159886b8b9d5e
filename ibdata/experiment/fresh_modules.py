"""Modules of custom policies that are imported anew for each run."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from importlib.machinery import ExtensionFileLoader
from pathlib import Path
from types import ModuleType

from ibdata.errors import UsageError
from ibdata.experiment.custom_code import customs
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.imported_code import drop_stale_bytecode, noted_sha256
from ibdata.experiment.imported_modules import Source, imported, is_users, loaded
from ibdata.policies.code_places import looking_in
from ibdata.policies.custom import importing


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


imported_before: set[str] = set()  # the names of the modules that were imported before those of the policies
imported_by_policies: dict[str, Source] = {}  # the modules that policies of this process have imported
_aside: dict[str, ModuleType] = {}  # modules that are taken away only until the policies are imported


def forget_modules(spec: DatasetSpec) -> dict[str, ModuleType]:
    """Take modules that are not installed, and those of custom policies, out of `sys.modules`; return them.

    What is imported next is what their files hold now. A package stays if it has loaded machine code, which
    cannot be loaded twice.
    """
    sources = list(imported_by_policies.values())
    for policy in customs(spec):
        with suppress(UsageError):  # a file that is not found is named where it is needed
            sources += imported(policy.module())[0].values()
    tops = {source.module.partition(".")[0] for source in sources} - sys.stdlib_module_names
    with importing:
        users = [name for name, module in sys.modules.items() if is_users(name, module)]
        of_policies = [name for name in sys.modules if name.partition(".")[0] in tops]
        for name in {*users, *of_policies}:
            _note(sys.modules[name])
        taken = _taken(of_policies)
        _aside.update(_taken(users))
        imported_before.clear()
        imported_before.update(sys.modules.keys() - imported_by_policies.keys())
    for source in sources:
        drop_stale_bytecode(source)
    return taken | _aside


def _note(module: ModuleType) -> None:
    """Note what a module's file holds now, before another module of its name is imported."""
    spec = getattr(module, "__spec__", None)
    if spec is not None and spec.has_location and spec.origin:
        noted_sha256(spec, Path(spec.origin))


def bring_back_others() -> None:
    """Put the modules that the policies have not imported back into `sys.modules`."""
    with importing:
        imported_before.update(_aside.keys() - sys.modules.keys())
        sys.modules.update({name: _aside[name] for name in _aside.keys() - sys.modules.keys()})
        _aside.clear()


def _restore(known: dict[str, ModuleType]) -> None:
    """Take the modules that policies imported out of `sys.modules`, and put those before in their place."""
    from ibdata.numerics.code_cache import compile_others_anew

    with importing:
        imported_by_policies.update({source.module: source for source in loaded(imported_before).values()})
        _taken(imported_by_policies.keys() - imported_before)
        compile_others_anew(False)
        sys.modules.update(known)
        imported_before.update(known)
        _aside.clear()


def _taken(names: Iterable[str]) -> dict[str, ModuleType]:
    """Take modules out of `sys.modules`, except those of packages that have loaded machine code."""
    found = [name for name in list(names) if name in sys.modules]
    stay = {name.partition(".")[0] for name, module in list(sys.modules.items()) if _is_machine_code(module)}
    return {name: sys.modules.pop(name) for name in found if name.partition(".")[0] not in stay}


def _is_machine_code(module: ModuleType) -> bool:
    spec = getattr(module, "__spec__", None)
    return spec is not None and isinstance(spec.loader, ExtensionFileLoader)
