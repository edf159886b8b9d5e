"""Modules of custom policies that are imported anew for each run and each evaluation."""

from __future__ import annotations

import os
import sys
from collections.abc import Container, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import invalidate_caches
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
        try:
            for policy in policies:
                policy.forget()
            known = forget_modules(policies)
            try:
                yield
            finally:
                _restore(known)
        finally:
            for policy in policies:
                policy.forget()
            sys.path[:] = path
            with suppress(OSError):  # it was removed
                os.chdir(here)


def forget_modules(policies: Iterable[Custom]) -> dict[str, ModuleType]:
    """Take modules that are not installed, and those of custom policies, out of `sys.modules`; return them.

    What is imported next is what their files hold now. Packages are taken as a whole, because those that stay
    would keep their old modules as attributes. A package stays if it has loaded machine code, which cannot be
    loaded twice.
    """
    sources, declared = list(imported_by_policies.values()), []
    for policy in policies:
        with suppress(UsageError):  # a file that is not found is named where it is needed
            sources += imported(policy.module())[0].values()
            declared += [Source(path.stem, path) for path in policy.declared().values()]
    for source in [*sources, *declared]:
        drop_stale_bytecode(source)
    invalidate_caches()  # a file may have been written a moment ago
    with importing:
        users = [name for name, module in list(sys.modules.items()) if is_users(name, module)]
        taken = _taken({*users, *(source.module for source in sources)})
        imported_before.clear()
        imported_before.update(sys.modules.keys() - imported_by_policies.keys())
    return taken


def _restore(known: dict[str, ModuleType]) -> None:
    """Take the modules that policies imported out of `sys.modules`, and put those before in their place."""
    from ibdata.numerics.code_cache import compile_others_anew

    with importing:
        imported_by_policies.update({source.module: source for source in loaded(imported_before).values()})
        _taken(imported_by_policies, imported_before)
        compile_others_anew(False)
        sys.modules.update(known)


def _taken(names: Iterable[str], others: Container[str] = ()) -> dict[str, ModuleType]:
    """Take the outermost packages of some modules out of `sys.modules`, with all that is in them.

    Packages that have loaded machine code stay, and so do Python's own modules and those that `others` names.
    """
    modules = [(name.partition(".")[0], name, module) for name, module in list(sys.modules.items())]
    tops = {name.partition(".")[0] for name in names}
    tops -= {top for top, name, module in modules if _is_machine_code(module) or _is_of_python(name, module)}
    return {name: sys.modules.pop(name) for top, name, _ in modules if top in tops and name not in others}


def _is_of_python(name: str, module: ModuleType) -> bool:
    """Whether a module is Python's own, and not a user's that has the name of one, such as profile.py."""
    return name in sys.stdlib_module_names and not is_users(name, module)


def _is_machine_code(module: ModuleType) -> bool:
    spec = getattr(module, "__spec__", None)
    return spec is not None and isinstance(spec.loader, ExtensionFileLoader)
