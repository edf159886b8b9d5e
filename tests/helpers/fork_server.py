"""Run `ibdata …` in forks of one process that has used every command before, which takes milliseconds.

Reads requests as JSON lines on stdin and answers each with code and output. The keys of a request are args;
folder, at, mode and log (see shim.c); user (whose rights the run has) and exchange
(whether two folders can be exchanged in one system call). A run that stops is answered with "stopped": then
other requests may come, until null lets it go on.
"""

import contextlib
import ctypes
import functools
import io
import json
import os
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

FULL = os.environ.get("IBDATA_TESTS") == "full"  # this file runs outside of the package `helpers`

TIMEOUT = 60  # seconds until a run counts as hanging, and is killed by SIGALRM
TINY = "name: t\nsetpoints: 50\npolicies: [random, safe]\nepisodes: 2\nsteps: 3\noutput: {shard_rows: 3}\n"


def load(folder: str) -> None:
    """Run each command once, so that all that they need is imported and compiled."""
    if not FULL:
        sys.modules["matplotlib"] = None  # type: ignore[assignment]  # pictures of a card take seconds
    a, b, config = f"{folder}/a", f"{folder}/b", f"{folder}/t.yaml"
    Path(config).write_text(TINY, encoding="utf-8")
    generate = ["generate", config, "--quiet", "--workers", "1", "--out"]
    commands = [
        [*generate, a],
        [*generate, a, "--seed", "1", "--overwrite"],
        [*generate, b, "--shards", "1/1"],
        ["finalize", b],
        ["merge", a, b, "--out", f"{folder}/both"],
        ["split", a, "--by", "episode", "fractions=[0.5, 0.5]"],
        ["split", b, "safe.policy=safe", "--materialize", f"{folder}/files"],
        ["card", a],
        ["repair", a],
        ["validate", a],
        ["ls", folder],
        [*generate, f"file://{folder}/store"],
        ["ls", f"file://{folder}"],
    ]
    with contextlib.redirect_stdout(io.StringIO()):
        for args in commands:
            if code := run(args):
                raise RuntimeError(f"exit code {code} of {args}")
    for thread in threading.enumerate():
        if thread is not threading.main_thread():
            thread.join()


def whole(put: Callable[..., None], objects: str) -> Callable[..., None]:
    """Let an object be there as a whole or not, as in a store, while a file begins empty."""

    @functools.wraps(put)
    def put_whole(self: Any, source: Any, path: str, *size: int) -> None:
        with tempfile.TemporaryDirectory(dir=objects) as elsewhere:
            put(type(self)(f"file://{elsewhere}"), source, path, *size)
            target, is_there = self.folder / path, False
            while not is_there:  # a store has no folders, which somebody else may remove
                with contextlib.suppress(FileNotFoundError):
                    if not target.parent.is_dir():
                        target.parent.mkdir(parents=True, exist_ok=True)
                    os.replace(Path(elsewhere, path), target)
                    is_there = True

    return put_whole


def objects_are_whole(objects: str) -> None:
    """The folders at URLs are stores of objects."""
    from ibdata._system.storage import Remote

    for name in ("put", "copy_from"):
        setattr(Remote, name, whole(getattr(Remote, name), objects))


def run(args: list[str]) -> int:
    """The exit code of a command."""
    from ibdata.cli import main

    try:
        main(args)
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    except BaseException:
        traceback.print_exc()
    return 99


def child(request: dict[str, Any], output: int) -> int:
    """The exit code of one run, in a fork of its own."""
    os.dup2(output, 1)
    os.dup2(output, 2)
    signal.alarm(TIMEOUT)
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # shards in order: a number names an operation
    shim = ctypes.CDLL(os.environ["LD_PRELOAD"])
    folder, mode, log = (request[name].encode() for name in ("folder", "mode", "log"))
    shim.shim_arm(folder, ctypes.c_long(request["at"]), mode, log)
    if not request["exchange"]:
        os.environ["SHIM_NO_EXCHANGE"] = "1"
    if request["user"]:
        os.setgroups([])
        os.setresgid(*[request["user"]] * 3)
        os.setresuid(*[request["user"]] * 3)
    return run(request["args"])


def answer(request: dict[str, Any]) -> dict[str, Any]:
    """Code and output of a run; if it stops, others may run before it goes on."""
    with tempfile.TemporaryFile() as output:
        pid = os.fork()
        if not pid:
            code = child(request, output.fileno())
            sys.stdout.flush()
            sys.stderr.flush()
            os._exit(code)
        while os.WIFSTOPPED(status := os.waitpid(pid, os.WUNTRACED)[1]):
            print('"stopped"', flush=True)
            serve()
            os.kill(pid, signal.SIGCONT)
        output.seek(0)
        return {"code": os.waitstatus_to_exitcode(status), "output": output.read().decode()}


def serve() -> None:
    """Answer requests until null or the end of stdin."""
    while (line := sys.stdin.readline()) and (request := json.loads(line)) is not None:
        print(json.dumps(answer(request)), flush=True)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as objects:
        objects_are_whole(objects)
        with tempfile.TemporaryDirectory() as folder:
            load(folder)
        serve()
