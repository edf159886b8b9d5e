"""Processes that run custom code, or make shards, for a run. They end with it.

They import nothing from the script or folder in which the run began, so the script needs no guard, and files
in the folder of a dataset do not run.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from queue import SimpleQueue
from subprocess import DEVNULL, Popen
from tempfile import TemporaryDirectory
from traceback import format_exc
from typing import Any, NamedTuple, Protocol

from ibdata.errors import IbdataError
from ibdata.experiment.code import announce, customs, live_objects, places_of, user_objects
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.policies.code import Places, is_fresh
from ibdata.system import processes
from ibdata.system.signals import held

# The path of modules comes from the parent. Before it is set, nothing is imported, because `python -c` looks
# in the current folder before all others.
BEGIN = """\
import sys
sys.path[:] = sys.argv[2:]
from ibdata.generation.worker import main
main(int(sys.argv[1]))
"""
Tell = Callable[[int, int], object]  # called with the number of a shard and its rows that are made so far


class Process(Protocol):
    """A process in which functions are called with the specification of a dataset."""

    spec: DatasetSpec

    def call(self, function: Callable[..., Any], *arguments: Any, tell: Tell | None = None) -> Any:
        """Return `function(spec, *arguments)`, with `tell` as the last argument if it is given."""


@contextmanager
def process_for(spec: DatasetSpec) -> Iterator[Process]:
    """A process that has imported no custom code before, for the custom policies of a dataset.

    It is this process if it is a command's, if there is nothing to import, or if a policy is a live object.
    """
    places = places_of(spec)
    for custom in customs(spec):
        custom.look_in(places)
    announce(spec)
    if not user_objects(spec):
        yield Here(spec)
    elif is_fresh() or live_objects(spec):
        try:
            yield Here(spec)
        finally:
            os.chdir(places[0])  # they may have gone elsewhere
    else:
        with closing(Worker(spec)) as worker:
            yield worker


class Here:
    """The process in which it is made."""

    def __init__(self, spec: DatasetSpec) -> None:
        self.spec = spec

    def call(self, function: Callable[..., Any], *arguments: Any, tell: Tell | None = None) -> Any:
        """Call a function here."""
        return function(self.spec, *arguments, *([] if tell is None else [tell]))


class Job(NamedTuple):
    """What a worker needs to know before it is asked for anything."""

    spec: dict[str, Any]  # as `DatasetSpec.plain` gives it
    weights: dict[str, bytes]
    places: Places  # where the code of custom policies is looked for; the first is the current folder
    root: Path | None  # the part of the run, with whose origin the worker is compared


def job_of(spec: DatasetSpec, root: Path | None) -> Job:
    """The job of a dataset, whose custom policies know where their code is looked for."""
    own = customs(spec)
    return Job(spec.plain(), spec.weights, own[0].places if own else (Path.cwd(),), root)


class Question(NamedTuple):
    """A function to call, and whether it tells of its progress."""

    function: Callable[..., Any]
    arguments: tuple[Any, ...]
    tells: bool


class Progress(NamedTuple):
    """What is told while a function runs."""

    shard: int
    rows: int


class Failure(NamedTuple):
    """An error in a worker, with its traceback."""

    error: Exception
    traceback: str


class Worker:
    """A process of its own, which is compared with the origin of the run in a part if there is one."""

    def __init__(self, spec: DatasetSpec, root: Path | None = None) -> None:
        self.spec = spec
        self._machine_code = TemporaryDirectory(prefix="ibdata-")
        self._waiting: list[Any] = [job_of(spec, root)]
        self._pipe, theirs = Pipe()
        path = [folder for folder in sys.path if folder]
        arguments = [sys.executable, "-c", BEGIN, str(theirs.fileno()), *path]
        environment = {**os.environ, "NUMBA_CACHE_DIR": self._machine_code.name}
        try:
            with held(), theirs:
                self._process = Popen(
                    arguments, pass_fds=[theirs.fileno()], stdin=DEVNULL, stdout=2, env=environment
                )
        except OSError:
            self._machine_code.cleanup()
            raise

    def call(self, function: Callable[..., Any], *arguments: Any, tell: Tell | None = None) -> Any:
        """Call a function there. Raises what it raises, and IbdataError if the process ends."""
        self._waiting.append(Question(function, arguments, tell is not None))
        try:
            while self._waiting:
                self._pipe.send(self._waiting.pop(0))
            while isinstance(answer := self._pipe.recv(), Progress):
                assert tell is not None  # else the function does not know of it
                tell(*answer)
        except (EOFError, ConnectionError):
            raise IbdataError(
                f"a worker process ended with code {self._process.wait()}, perhaps for lack of memory; run "
                "again with --resume and fewer --workers"
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
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal signals every process; the parent reacts
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
    pipe = Connection(descriptor)
    asked: SimpleQueue[Any] = SimpleQueue()
    threading.Thread(target=_listen, args=(pipe, asked), daemon=True).start()
    _work(asked.get(), asked, pipe)


def spec_of(job: Job) -> DatasetSpec:
    """The specification of a job's dataset."""
    spec = DatasetSpec.from_plain(job.spec, job.weights)
    for custom in customs(spec):
        custom.look_in(job.places)
    return spec


def _listen(pipe: Connection, asked: SimpleQueue[Any]) -> None:
    """Take what the parent asks for, and end with it, also in the middle of a shard."""
    try:
        while True:
            asked.put(pipe.recv())
    except (EOFError, OSError):
        os._exit(1)


def _work(job: Job, asked: SimpleQueue[Question], pipe: Connection) -> None:
    from ibdata.generation.origin import agree

    os.chdir(job.places[0])  # a policy may have changed the parent's current folder
    spec, root = spec_of(job), job.root
    while True:
        question = asked.get()
        tell = [lambda *told: pipe.send(Progress(*told))] if question.tells else []
        try:
            if root is not None:
                agree(spec, root)
                root = None
            answer = question.function(spec, *question.arguments, *tell)
        except Exception as error:
            answer = Failure(error, format_exc())
        pipe.send(answer)
