"""Processes that run custom code, or make shards, for a run. They end with it.

They import nothing from the script or folder in which the run began, so the script needs no guard, and files
in the folder of a dataset do not run.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import cached_property
from multiprocessing.connection import Pipe
from pathlib import Path
from queue import SimpleQueue
from tempfile import TemporaryDirectory
from traceback import format_exc
from typing import Any, NamedTuple, Protocol

from ibdata._system import processes
from ibdata._system.pipes import Connection, start
from ibdata._system.runs import Run
from ibdata._system.signals import held, leave_to_parent
from ibdata.errors import WORKERS, IbdataError, notice
from ibdata.plan.dataset_spec import DatasetSpec
from ibdata.policies.code import Acting, is_fresh

# The path of modules comes from the parent. Before it is set, nothing is imported, because `python -c` looks
# in the current folder before all others.
BEGIN = """\
import sys
sys.path[:] = sys.argv[2:]
from ibdata.generation.process import main
main(int(sys.argv[1]))
"""
RowsMade = Callable[[int], object]  # called with the rows of a shard that are made so far


class Process(Protocol):
    """A process in which functions are called with the specification of a dataset."""

    spec: DatasetSpec
    folder: Path  # the current folder, in which custom code is looked for

    def call(self, function: Callable[..., Any], *arguments: Any, progress: RowsMade | None = None) -> Any:
        """Return `function(spec, *arguments)`, with `progress` as the last argument if it is given."""


@contextmanager
def process_for(spec: DatasetSpec) -> Iterator[Process]:
    """A process for the policies of a dataset, which has imported no custom code before.

    It is this process itself if there is no custom code, if a policy is a live object, or if it is that of a
    command; otherwise a new one.
    """
    for target in dict.fromkeys(custom.target for custom in spec.custom):
        notice(f"running the code of {target}")
    is_here = not spec.user_objects or is_fresh() or spec.live
    with closing((Here if is_here else Worker)(spec, Path.cwd())) as process:
        yield process


class Here:
    """The process in which it is made. Objects of users are loaded when a function is first called."""

    def __init__(self, spec: DatasetSpec, folder: Path) -> None:
        self.spec, self.folder, self._acting = spec, folder, Acting(folder)

    @cached_property
    def _loaded(self) -> DatasetSpec:
        return self.spec.loaded(self._acting) if self.spec.user_objects else self.spec

    def close(self) -> None:
        """Let no object act from now on."""
        self._acting.close()

    def call(self, function: Callable[..., Any], *arguments: Any, progress: RowsMade | None = None) -> Any:
        """Call a function here."""
        if progress is not None:
            arguments = (*arguments, progress)
        return function(self._loaded, *arguments)


class WorkerTask(NamedTuple):
    """What a worker needs to know before it is asked for anything."""

    spec: DatasetSpec
    folder: Path  # the current one
    run: Run | None  # with whose record the worker is compared


class Question(NamedTuple):
    """A function to call, and whether it takes `progress`."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    shows_progress: bool


class Rows(NamedTuple):
    """The rows of a shard that are made so far."""

    made: int


class Failure(NamedTuple):
    """An error in a worker, with its traceback."""

    error: Exception
    traceback: str


class Worker:
    """A process of its own, which is compared with the record of a run if there is one."""

    def __init__(self, spec: DatasetSpec, folder: Path, run: Run | None = None) -> None:
        self.spec, self.folder = spec, folder
        self._machine_code = TemporaryDirectory(prefix="ibdata-", ignore_cleanup_errors=True)
        self._waiting: list[Any] = [WorkerTask(spec, folder, run)]
        self._pipe, theirs = Pipe()
        path = [folder for folder in sys.path if folder]
        arguments = [sys.executable, "-c", BEGIN, str(theirs.fileno()), *path]
        environment = {**os.environ, "NUMBA_CACHE_DIR": self._machine_code.name}
        try:
            with held(), theirs:
                self._process = start(arguments, theirs, environment)
        except OSError:
            self._machine_code.cleanup()
            raise

    def call(self, function: Callable[..., Any], *arguments: Any, progress: RowsMade | None = None) -> Any:
        """Call a function there. Raises what it raises, and IbdataError if the process ends."""
        self._waiting.append(Question(function, arguments, progress is not None))
        try:
            while self._waiting:
                self._pipe.send(self._waiting.pop(0))
            while isinstance(answer := self._pipe.recv(), Rows):
                assert progress is not None  # else the function does not know of it
                progress(answer.made)
        except (EOFError, ConnectionError):
            raise IbdataError(
                f"a worker process ended with code {self._process.wait()}, perhaps for lack of memory; run "
                f"again with fewer {WORKERS}"
            ) from None
        if isinstance(answer, Failure):
            raise answer.error from RuntimeError(answer.traceback)
        return answer

    def close(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait()
        self._pipe.close()
        self._machine_code.cleanup()


def main(descriptor: int) -> None:
    """Answer what the parent asks, until it ends."""
    processes.purpose = "worker"
    leave_to_parent()
    pipe = Connection(descriptor)
    received: SimpleQueue[Any] = SimpleQueue()
    threading.Thread(target=_listen, args=(pipe, received), daemon=True).start()
    _work(received.get(), received, pipe)


def _listen(pipe: Connection, received: SimpleQueue[Any]) -> None:
    """Take what the parent asks for, and end with it, also in the middle of a shard."""
    try:
        while True:
            received.put(pipe.recv())
    except Exception:  # also what cannot be unpickled, for which the parent would wait for ever
        os._exit(1)


def _work(task: WorkerTask, questions: SimpleQueue[Question], pipe: Connection) -> None:
    from ibdata.generation.record import agree

    os.chdir(task.folder)  # a policy may have changed the parent's current folder
    here, run = Here(task.spec, task.folder), task.run
    while True:
        function, arguments, shows_progress = questions.get()
        progress = (lambda rows: pipe.send(Rows(rows))) if shows_progress else None
        try:
            if run is not None:
                here.call(agree, run)
                run = None
            answer = here.call(function, *arguments, progress=progress)
        except Exception as error:
            answer = Failure(error, format_exc())
        pipe.send(answer)
