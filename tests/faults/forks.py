"""Run `ibdata …` in forks of one process that has made a dataset before, so that a run takes milliseconds.

Reads requests as JSON lines on stdin, and answers with code and output. The keys of a request are args,
folder, at, mode, log, user (whose rights the run has; 0 for its own), megabytes (of memory; 0 for all),
exchange (whether two folders can be exchanged in one system call) and readers (whether a replacement waits
for readers).
"""

import contextlib
import ctypes
import io
import json
import os
import resource
import signal
import sys
import tempfile
import threading
import traceback
from typing import Any

TIMEOUT = 60  # seconds until a run counts as hanging, and is killed by SIGALRM


def load(config: str) -> None:
    """Make a dataset, replace it and repair it, so that all that a run needs is compiled."""
    from ibdata.cli import main
    from ibdata.generation import replacement

    waits, replacement.PAUSE = replacement.PAUSE, 0.0
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        made = ["generate", "--quiet", "--config", config, "--out", f"{folder}/out", "--workers", "1"]
        for args in (made, [*made, "--overwrite"], ["repair", f"{folder}/out"]):
            try:
                main(args)
            except SystemExit as end:
                if end.code:
                    raise
    replacement.PAUSE = waits
    for thread in threading.enumerate():
        if thread is not threading.main_thread():
            thread.join()


def child(request: dict[str, Any], output: int) -> int:
    """The exit code of one run, in a fork of its own."""
    from ibdata.cli import main
    from ibdata.generation import division, replacement

    os.dup2(output, 1)
    os.dup2(output, 2)
    signal.alarm(TIMEOUT)
    if request["mode"]:
        shim = ctypes.CDLL(os.environ["LD_PRELOAD"])
        folder, mode, log = (request[name].encode() for name in ("folder", "mode", "log"))
        shim.shim_arm(folder, ctypes.c_long(request["at"]), mode, log)
    division.available_processors = lambda: 1  # shards in order, so that an operation's number names it
    if not request["readers"]:
        replacement.PAUSE = 0.0
    if not request["exchange"]:
        os.environ["SHIM_NO_EXCHANGE"] = "1"
    if request["user"]:
        os.setgroups([])
        os.setresgid(*[request["user"]] * 3)
        os.setresuid(*[request["user"]] * 3)
    if request["megabytes"]:
        resource.setrlimit(resource.RLIMIT_AS, (request["megabytes"] * 2**20,) * 2)
    try:
        main(request["args"])
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    except BaseException:
        traceback.print_exc()
    return 99


def main() -> None:
    """Answer requests until stdin ends."""
    load(sys.argv[1])
    for line in sys.stdin:
        with tempfile.TemporaryFile() as output:
            pid = os.fork()
            if not pid:
                code = child(json.loads(line), output.fileno())
                sys.stdout.flush()
                sys.stderr.flush()
                os._exit(code)
            code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
            output.seek(0)
            print(json.dumps({"code": code, "output": output.read().decode()}), flush=True)


if __name__ == "__main__":
    main()
