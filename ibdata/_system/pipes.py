"""Processes that have a pipe to this one."""

from __future__ import annotations

import os
import sys
from multiprocessing import connection
from subprocess import DEVNULL, Popen

if sys.platform == "win32":
    from subprocess import STARTUPINFO

    Connection = connection.PipeConnection

    def start(arguments: list[str], pipe: Connection, environment: dict[str, str]) -> Popen[bytes]:
        """Start a process with an end of a pipe, which is the `Connection` of its number there too."""
        os.set_handle_inheritable(pipe.fileno(), True)
        info = STARTUPINFO(lpAttributeList={"handle_list": [pipe.fileno()]})
        return Popen(arguments, stdin=DEVNULL, stdout=2, env=environment, startupinfo=info)

else:
    Connection = connection.Connection

    def start(arguments: list[str], pipe: Connection, environment: dict[str, str]) -> Popen[bytes]:
        """Start a process with an end of a pipe, which is the `Connection` of its number there too."""
        return Popen(arguments, pass_fds=[pipe.fileno()], stdin=DEVNULL, stdout=2, env=environment)
