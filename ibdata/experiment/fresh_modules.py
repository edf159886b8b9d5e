"""Modules of custom policies that are imported anew for each run and each evaluation."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib.machinery import ExtensionFileLoader
from threading import RLock
from types import ModuleType

from ibdata.errors import UsageError
from ibdata.experiment.bytecode import drop_stale_bytecode
from ibdata.experiment.custom_code import customs
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.experiment.imported_modules import Source, imported, is_users, loaded
from ibdata.policies.code_places import looking_in
from ibdata.policies.custom import Custom, importing

imported_before: set[str] = set()  # the names of the modules that were imported before those of the policies
imported_by_policies: dict[str, Source] = {}  # the modules that policies of this process have imported
_one_at_a_time = RLock()  # held while modules are out of `sys.modules`, of which a process has only one


@contextmanager
def in_one_folder(spec: DatasetSpec) -> Iterator[None]:
    """A context in which the custom policies of a dataset are imported anew.

    Code is looked for in the current folder and in that of the first experiment's YAML file.
    """
    with looking_in(spec.experiments[0].folder), imported_anew(customs(spec)):
        yield


@contextmanager
def imported_anew(policies: Sequence[Custom]) -> Iterator[None]:
    """A context in which policies are imported anew, however late they import a module.

    At its end, Python's modules and path, the current folder and the policies are as they were before.
    """
    if not policies:
        yield
        return
    with _one_at_a_time:
        here, path = os.getcwd(), list(sys.path)
        for policy in policies:
            policy.forget()
        known = forget_modules(policies)
        try:
            yield
        finally:
            _restore(known)
            for policy in policies:
                policy.forget()
            sys.path[:] = path
            with suppress(OSError):  # it was removed
                os.chdir(here)


def forget_modules(policies: Iterable[Custom]) -> dict[str, ModuleType]:
    """Take modules that are not installed, and those of custom policies, out of `sys.modules`; return them.

    What is imported next is what their files hold now. A package stays if it has loaded machine code, which
    cannot be loaded twice.
    """
    sources = list(imported_by_policies.values())
    for policy in policies:
        with suppress(UsageError):  # a file that is not found is named where it is needed
            sources += imported(policy.module())[0].values()
    for source in sources:
        drop_stale_bytecode(source)
    tops = {source.module.partition(".")[0] for source in sources} - sys.stdlib_module_names
    with importing:
        taken = _taken(
            name
            for name, module in list(sys.modules.items())
            if name.partition(".")[0] in tops or is_users(name, module)
        )
        imported_before.clear()
        imported_before.update(sys.modules.keys() - imported_by_policies.keys())
    return taken


def _restore(known: dict[str, ModuleType]) -> None:
    """Take the modules that policies imported out of `sys.modules`, and put those before in their place."""
    from ibdata.numerics.code_cache import compile_others_anew

    with importing:
        imported_by_policies.update({source.module: source for source in loaded(imported_before).values()})
        _taken(imported_by_policies.keys() - imported_before)
        compile_others_anew(False)
        sys.modules.update(known)


def _taken(names: Iterable[str]) -> dict[str, ModuleType]:
    """Take modules out of `sys.modules`, except those of packages that have loaded machine code."""
    found = [name for name in list(names) if name in sys.modules]
    stay = {name.partition(".")[0] for name, module in list(sys.modules.items()) if _is_machine_code(module)}
    return {name: sys.modules.pop(name) for name in found if name.partition(".")[0] not in stay}


def _is_machine_code(module: ModuleType) -> bool:
    spec = getattr(module, "__spec__", None)
    return spec is not None and isinstance(spec.loader, ExtensionFileLoader)
