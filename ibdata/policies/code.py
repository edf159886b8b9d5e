"""The code of custom policies: where it is, how it is imported, and which line of it failed.

Whatever runs it imports it anew, as a process does that has imported none before.
"""

from __future__ import annotations

import filecmp
import hashlib
import importlib
import os
import sys
import sysconfig
import threading
import traceback
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, redirect_stdout
from functools import cache, cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from types import ModuleType
from typing import Any

from ibdata._system import processes
from ibdata.errors import UsageError, printable

Places = tuple[Path, ...]  # folders in which code is looked for
PRIVATE = "_ibdata_code_"  # begins the names of modules made of files
PACKAGE = Path(__file__).parents[1]
STANDARD_LIBRARY = Path(sysconfig.get_path("stdlib"))
OTHERS = ("ibdata", "__main__", "__mp_main__")  # packages whose modules are never those of users
LONGEST = 300  # characters of an error's own text
IMPORTING = threading.RLock()


class Acting(ExitStack):
    """The time in which objects of users act: at its end, folder, path and modules are as before."""

    def __init__(self, folder: Path | None = None) -> None:
        super().__init__()
        self._folder = folder

    @cached_property
    def folder(self) -> Path:
        """The current folder before any object acts, in which code is looked for."""
        return self._folder or Path.cwd()

    @cached_property
    def _alone(self) -> None:
        """Wait until no other thread has users' code imported anew: modules and path are the process's."""
        self.enter_context(IMPORTING)

    def add_to_path(self, folders: Iterable[str]) -> None:
        """Let Python look for modules in these folders, before all others as `python -m` does."""
        _ = self._alone
        self._set(sys, "path", [*dict.fromkeys(folders), *sys.path])

    def imported(self, module: str, file: Path | None) -> ModuleType:
        """The module of a name, or one made of a file. Both, and what they import, are read anew."""
        _ = self._without_modules
        importlib.invalidate_caches()
        return importlib.import_module(module) if file is None else _module_of(file)

    @cached_property
    def _without_modules(self) -> None:
        """Set the modules of users aside, and what is kept of their code: such caches miss some edits."""
        processes.known_before.update(() if processes.known_before else sys.modules)
        self.callback(sys.modules.update, _modules_of_users())
        self.callback(_forget_modules)
        _forget_modules()
        self._set(sys, "dont_write_bytecode", True)
        import numba  # not earlier, because `_numerics.compiled` keeps it from reading a foreign file

        if processes.purpose != "worker":  # which has an empty folder for numba's cache
            cache = self.enter_context(TemporaryDirectory(prefix="ibdata-", ignore_cleanup_errors=True))
            if processes.purpose == "session":
                self._set(numba.config, "CACHE_DIR", cache)
            else:
                os.environ["NUMBA_CACHE_DIR"] = cache
        if processes.purpose != "session":
            os.environ.pop("NUMBA_CACHE_LOCATOR_CLASSES", None)  # which may prefer another cache
            numba.config.reload_config()  # type: ignore[no-untyped-call]

    def _set(self, owner: Any, name: str, value: Any) -> None:
        self.callback(setattr, owner, name, getattr(owner, name))
        setattr(owner, name, value)


def _forget_modules() -> None:
    for name in _modules_of_users():
        sys.modules.pop(name, None)


def _modules_of_users() -> dict[str, ModuleType]:
    """The modules that are imported anew: not those of a package with a compiled one, which loads once."""
    modules = {name: module for name, module in list(sys.modules.items()) if is_of_user(name, module)}
    files = {name: file_of(module) for name, module in modules.items()}
    compiled = {name.partition(".")[0] for name, file in files.items() if file and file.suffix != ".py"}
    return {name: module for name, module in modules.items() if name.partition(".")[0] not in compiled}


def is_of_user(name: str, module: object) -> bool:
    """Whether a module, or a package without a file, is neither of Python, nor installed, nor of ibdata."""
    if name.startswith(PRIVATE):
        return True
    origin = _origin(module)
    if name.partition(".")[0] in OTHERS or (origin and is_installed(origin)):
        return False
    places = [origin] if file_of(module) else list(getattr(module, "__path__", ()))
    return bool(places) and not any(map(is_installed, places))


def two_places(current: Path, folder: Path | None) -> Places:
    """The current folder, and that of the YAML file if there is one and it is another."""
    return tuple(dict.fromkeys([current, *([] if folder is None else [folder.absolute()])]))


def located(name: str, what: str, places: Places) -> Path:
    """The path of a file beside the YAML file or in the current folder. The errors begin with `what`."""
    paths = dict.fromkeys(folder / name for folder in reversed(places))
    files = [path for path in paths if path.is_file()]
    if not files:
        named = printable(" or ".join(map(str, paths)))
        raise UsageError(
            f"{what}found no file {printable(name)!r}, expected it beside the experiment's YAML file or in "
            f"the current folder: {named}; copy it there, or go to the folder in which it is"
        )
    if len(files) > 1 and not filecmp.cmp(files[0], files[1], shallow=False):
        raise UsageError(f"{what}found {files[0]} and {files[1]}, which differ; remove one")
    return files[0]


def is_fresh() -> bool:
    """Whether this is a process of ibdata's own that has imported no custom code."""
    return processes.purpose != "session" and not processes.known_before


def _module_of(file: Path) -> ModuleType:
    """Execute a file as a module whose name, of its path and content, no other module has."""
    source = file.read_bytes()
    name = PRIVATE + hashlib.sha256(str(file).encode() + b"\0" + source).hexdigest()[:16]
    if name in sys.modules:
        return sys.modules[name]
    _refuse_other_helpers(file, source)
    module = sys.modules[name] = ModuleType(name)
    module.__file__ = str(file)
    try:
        exec(compile(source, file, "exec", dont_inherit=True), vars(module))
    except BaseException:
        del sys.modules[name]
        raise
    return module


def _refuse_other_helpers(file: Path, source: bytes) -> None:
    """Raise UsageError if a file names one beside it, and Python has another module of that name."""
    for beside in sorted(file.parent.glob("*.py")):
        if beside == file or beside.stem.encode() not in source:
            continue
        used = file_of(sys.modules.get(beside.stem))
        if used is not None and not is_installed(used) and not used.samefile(beside):
            raise UsageError(
                f"{beside}: found another module with the name {beside.stem} in use, {used}; rename one of "
                "the two"
            )


@contextmanager
def loading(target: str) -> Iterator[None]:
    """A context in which the code of a target is loaded."""
    refuse_within_itself([target])
    token = processes.loading.set((*processes.loading.get(), target))
    try:
        yield
    finally:
        processes.loading.reset(token)


def refuse_within_itself(targets: Iterable[str]) -> None:
    """Raise UsageError if one of these targets is being loaded, as that of a script that names itself."""
    for target in targets:
        if target in processes.loading.get():
            raise UsageError(
                f"{target}: calls ibdata with itself as a policy while it is imported; put the policy into a "
                'file of its own, or such calls under `if __name__ == "__main__":`'
            )


def apart_from_results() -> AbstractContextManager[object]:
    """A context in which code prints to stderr, where this process prints its results on stdout."""
    return redirect_stdout(sys.stderr) if processes.purpose == "command" else nullcontext()


def file_of(module: object) -> Path | None:
    """The file of a module, if it has one."""
    origin = _origin(module)
    return Path(origin) if origin and os.path.isfile(origin) else None


def _origin(module: object) -> str | None:
    spec = getattr(module, "__spec__", None)
    return spec.origin if spec is not None and spec.has_location else None


@cache
def is_installed(path: str | Path) -> bool:
    """Whether a file is part of Python or of an installed package."""
    return _is_in_package(Path(path)) or Path(path).is_relative_to(STANDARD_LIBRARY)


def _is_in_package(path: Path) -> bool:
    return not {"site-packages", "dist-packages"}.isdisjoint(path.parts)


def error_line(error: BaseException) -> str:
    """An error as `my_policy.py:12: IndexError: its text`, in one line; one of ibdata itself has no place."""
    text = " ".join((error.msg if isinstance(error, SyntaxError) else str(error)).split())
    name = type(error).__name__
    return f"{_place(error)}{name}: {text[:LONGEST]}" if text else f"{_place(error)}{name}"


def _place(error: BaseException) -> str:
    """The innermost line of the user's own files, else of an installed package."""
    lines = [(Path(frame.f_code.co_filename), line) for frame, line in traceback.walk_tb(error.__traceback__)]
    if isinstance(error, SyntaxError) and error.filename:
        lines.append((Path(error.filename), error.lineno or 1))
    lines = [at for at in lines if not at[0].is_relative_to(PACKAGE)]
    in_packages = [at for at in lines if _is_in_package(at[0])]
    outside_packages = [at for at in lines if not (is_installed(at[0]) or str(at[0]).startswith("<frozen"))]
    on_disk = [at for at in outside_packages if at[0].is_file()]  # the others are cells and texts
    candidates = on_disk or outside_packages or in_packages
    if not candidates:
        return ""
    (file, line), here = candidates[-1], Path.cwd()
    return f"{file.relative_to(here) if file.is_relative_to(here) else file}:{line}: "
