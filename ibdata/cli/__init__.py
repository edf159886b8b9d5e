"""The command line. A command calls one library function and prints its result. Errors become exit codes."""

from __future__ import annotations

import atexit
import gc
import inspect
import os
import re
import signal
import sys
import threading
import traceback
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from io import TextIOWrapper
from types import FrameType
from typing import TextIO

import click

from ibdata import errors
from ibdata._system import processes
from ibdata._system.signals import STOPPING
from ibdata.cli._options import Suggesting
from ibdata.cli._printing import print_json, shortened
from ibdata.errors import ConfigError, IbdataError, Interrupted, is_thread_limit, nearest, notice, printable
from ibdata.version import __version__

COMMANDS = {  # by what they are for; the module of each
    "Use": {
        "init": "make", "generate": "make", "info": "read", "head": "read", "stats": "read", "plot": "use",
        "evaluate": "evaluate", "export": "use", "config": "use",
    },
    "Maintain": {
        "ls": "read", "validate": "check", "repair": "check", "reproduce": "check", "split": "make",
        "merge": "make", "finalize": "make", "card": "use",
    },
}  # fmt: skip
MODULES = {name: module for modules in COMMANDS.values() for name, module in modules.items()}
INTERRUPTED = 130
PLACE = re.compile(r"(?P<file>.+?):(?P<line>\d+):\d+: ")


class Stopped(Exception):
    """A signal stopped a command. click would take its KeyboardInterrupt for one of its own."""

    def __init__(self, interrupted: Interrupted) -> None:
        self.interrupted = interrupted


class Commands(Suggesting):
    """The commands by what they are for, each a function NAME_command in a module of this folder."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(MODULES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in MODULES:
            return None
        module = import_module(f"{__name__}.{MODULES[cmd_name]}")
        command: click.Command = getattr(module, f"{cmd_name}_command")
        return command

    def invoke(self, ctx: click.Context) -> None:
        try:
            super().invoke(ctx)
        except Interrupted as error:
            raise Stopped(error) from error

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        for title, modules in COMMANDS.items():
            with formatter.section(title):
                formatter.write_dl([(name, self.summary(ctx, name)) for name in modules])


@click.command(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="ibdata")
@click.option(
    "--debug",
    is_flag=True,
    expose_value=False,
    help="Show Python's traceback of an error, such as one in the code of a policy; also after a command.",
)
def cli() -> None:
    """Offline reinforcement-learning datasets of the Industrial Benchmark.

    \b
    ibdata generate --config random.yaml  the paper's random batch in data/random
    ibdata info data/random               a summary of that dataset
    ibdata config list                    the experiments that come with ibdata
    """


def main(args: Sequence[str] | None = None) -> None:
    """Run the command line and exit with its code; no traceback without --debug.

    Where `args` is None the process has no other purpose, and ends at once: Python would take 0.4 s to clear
    its memory.
    """
    if args is None:
        processes.purpose = "command"
    errors.at_command_line = True
    sys.stdout, sys.stderr = sys.stdout or _nowhere(), sys.stderr or _nowhere()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # for help and tracebacks
    gc.set_threshold(100_000)  # imports make many objects and little garbage
    _end_at_signals()
    code = _run(list(sys.argv[1:] if args is None else args))
    _flush()
    errors.at_command_line = False
    if args is None:
        atexit._run_exitfuncs()
        _flush()
        os._exit(code)
    sys.exit(code)


def _nowhere() -> TextIO:
    """A stream in place of one that was closed before the command began."""
    return open(os.devnull, "w", encoding="utf-8")


def _run(args: list[str]) -> int:
    """Run a command, report its error, and return its exit code."""
    debug, hint = "--debug" in args, ""
    try:
        others = [arg for arg in args if arg != "--debug"]
        code = int(cli.main(others, prog_name="ibdata", standalone_mode=False) or 0)
        sys.stdout.flush()
        return code
    except click.ClickException as error:
        code, lines = 2, [_instead(error) or " ".join(error.format_message().split())]
        if isinstance(error, click.UsageError) and error.ctx:
            hint = f"Try '{error.ctx.command_path} --help'."
    except Stopped as error:
        code, lines = error.interrupted.exit_code, [str(error.interrupted)]
    except (KeyboardInterrupt, click.Abort):
        code, lines = INTERRUPTED, ["stopped; nothing unfinished is left behind"]
    except BrokenPipeError:  # whoever reads stdout has gone
        return 1
    except Exception as error:
        if debug:
            traceback.print_exc()
        code, lines = error.exit_code if isinstance(error, IbdataError) else 1, _lines(error)
    with suppress(OSError):  # stderr or stdout may be what cannot be written
        _report(lines, hint)
        if "--json" in args:
            place = PLACE.match(lines[0])
            file, line = (place["file"], int(place["line"])) if place else (None, None)
            report = {"code": code, "message": "\n".join(lines), "file": file, "line": line}
            print_json({"version": 1, "error": report})
    return code


def _flush() -> None:
    """Flush stdout and stderr; Python would complain, and change the exit code, if they cannot be written."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


def _end_at_signals() -> None:
    """Let signals end the process until there is something to clean up: an exception could get lost."""
    if threading.current_thread() is not threading.main_thread():
        return

    def end(number: int, frame: FrameType | None) -> None:
        os.write(2, f"ibdata: {Interrupted(number)}\n".encode())
        os._exit(128 + number)

    for number in STOPPING:
        if signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            signal.signal(number, end)


def _instead(error: click.ClickException) -> str | None:
    """Where the option is that a command lacks: one of the experiment, or an argument in Python."""
    if not isinstance(error, click.NoSuchOption) or error.ctx is None:
        return None
    import ibdata
    from ibdata.experiment import Experiment

    key, command = error.option_name.removeprefix("--"), error.ctx.command
    takes_set = any(parameter.name == "overrides" for parameter in command.params)
    name = nearest(key, Experiment.model_fields)
    if takes_set and name and (name == key or not error.possibilities):
        return f"No such option '--{key}'; expected --set {name}=…, since the experiment has this option."
    function = getattr(ibdata, command.name or "", None)
    if inspect.isfunction(function) and key in inspect.signature(function).parameters:
        return f"No such option '--{key}'; it is one of Python's: ibdata.{command.name}(…, {key}=…)."
    return None


def _lines(error: Exception) -> list[str]:
    if isinstance(error, ConfigError):
        return shortened(str(error).split("\n"))
    if isinstance(error, IbdataError):
        return [printable(str(error))]
    if isinstance(error, OSError) and error.strerror:
        unnamed = "the current folder" if isinstance(error, FileNotFoundError) else "stdout"
        return [f"{printable(os.fsdecode(error.filename or unnamed))}: {error.strerror}"]
    if isinstance(error, MemoryError):
        return ["out of memory; ask for less at once"]
    if is_thread_limit(error):
        return ["the system starts no more threads; raise ulimit -u"]
    return [f"{type(error).__name__}: {error} (a bug of ibdata; --debug shows where)"]


def _report(lines: list[str], hint: str) -> None:
    for line in lines:
        begins_with_place = line[:1] in "/." or ":" in line.split(" ")[0]
        notice(line, "" if begins_with_place else "ibdata: ")
    if hint:
        notice(hint, "")
