"""Processes that make shards for a run. They end with it, and import nothing from its script or folder.

So the script needs no guard, and files in the folder of a dataset do not run.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from queue import SimpleQueue
from subprocess import DEVNULL, Popen
from traceback import format_exc
from typing import Any, NamedTuple

from ibdata.errors import IbdataError
from ibdata.system.signals import held

# The path of modules comes from the parent. Before it is set, nothing is imported, because `python -c` looks
# in the current folder before all others.
BEGIN = """\
import sys
sys.path[:] = sys.argv[2:]
from ibdata.generation.worker import main
main(int(sys.argv[1]))
"""


class Job(NamedTuple):
    """What the shards of a run have in common."""

    spec: dict[str, Any]  # as `DatasetSpec.plain` gives it
    weights: dict[str, bytes]
    root: Path
    overlap: bool
    here: Path  # the folder in which the run began
    folder: Path | None  # that of its YAML file


class Failure(NamedTuple):
    """An error in a worker, with its traceback."""

    error: Exception
    traceback: str


class Worker:
    """A process that makes one shard after the other."""

    def __init__(self, job: Job) -> None:
        self._pipe, theirs = Pipe()
        path = [folder for folder in sys.path if folder]
        arguments = [sys.executable, "-c", BEGIN, str(theirs.fileno()), *path]
        with held(), theirs:
            self._process = Popen(arguments, pass_fds=[theirs.fileno()], stdin=DEVNULL, stdout=2)
        self._job: Job | None = job

    def make(self, shard: Any, tell: Any) -> None:
        """Make a shard. Raises what making it raises, and IbdataError if the process ends."""
        try:
            if self._job is not None:
                self._pipe.send(self._job)
                self._job = None
            self._pipe.send(shard)
            while (answer := self._pipe.recv()) is not None:
                if isinstance(answer, Failure):
                    raise answer.error from RuntimeError(answer.traceback)
                tell(shard.number, answer)
        except (EOFError, ConnectionError):
            raise IbdataError(
                f"a worker process ended with code {self._process.wait()}, perhaps for lack of memory; run "
                "again with --resume and fewer --workers"
            ) from None

    def end(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait()
        self._pipe.close()


def main(descriptor: int) -> None:
    """Make the shards that the parent names, until it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal signals every process; the parent reacts
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGTERM])
    pipe = Connection(descriptor)
    asked: SimpleQueue[Any] = SimpleQueue()
    threading.Thread(target=_listen, args=(pipe, asked), daemon=True).start()
    _work(asked.get(), asked, pipe)


def _listen(pipe: Connection, asked: SimpleQueue[Any]) -> None:
    """Take what the parent asks for, and end with it, also in the middle of a shard."""
    try:
        while True:
            asked.put(pipe.recv())
    except (EOFError, OSError):
        os._exit(1)


def _work(job: Job, asked: SimpleQueue[Any], pipe: Connection) -> None:
    from ibdata.experiment.dataset_spec import DatasetSpec
    from ibdata.generation.make_shard import make_shard
    from ibdata.generation.origin import agree
    from ibdata.policies.code_places import look_in

    os.chdir(job.here)  # a policy may have changed the parent's current folder
    look_in(job.here, job.folder)
    spec = DatasetSpec.from_plain(job.spec, job.weights)
    while True:
        shard = asked.get()
        try:
            agree(job.root, spec)
            make_shard(spec, shard, job.root, lambda number, rows: pipe.send(rows), job.overlap)
            answer = None
        except Exception as error:
            answer = Failure(error, format_exc())
        pipe.send(answer)
