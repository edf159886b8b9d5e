"""docs/errors.md: exit codes, and the exceptions behind them."""

import inspect
import pkgutil
from importlib import import_module

import ibdata
from ibdata.errors import IbdataError, Interrupted
from referring import NOTE

OPENING = """\
# Errors and exit codes

An error is one line that says where it is, the value that was found, the value that was expected and, where
there is a way out, what to do. An experiment can have several mistakes: each has a line with file, line and
column. A run that fails leaves nothing behind but what `--resume` can use.

## Exit codes

| code | meaning | what to do |
|---|---|---|
| 0 | done | |
| 1 | an operating-system error, a missing package, or a failed policy | read the line, or add `--debug` |
| 2 | an option or the experiment is wrong | correct what the line names |
| 3 | the dataset is missing, damaged, or differs from the other | `ibdata validate`, then `ibdata repair` |
| 75 | another process writes there, or the dataset was replaced while it was read | run the command again |
| 129, 130, 143 | stopped by SIGHUP, SIGINT (Ctrl-C), SIGTERM | `--resume` continues |

With `--json`, stdout holds `{"error": {"code", "message", "file", "line"}}`.

## Exceptions

In Python every error is an `ibdata.IbdataError`, which is a `ValueError`; `exit_code` has the code above.

| exception | from | exit code | meaning |
|---|---|---|---|
"""


def page() -> str:
    """The page."""
    rooms = ("errors", "dataset.", "policies.", "evaluation", "experiment")
    for module in pkgutil.walk_packages(ibdata.__path__, "ibdata."):
        if module.name.removeprefix("ibdata.").startswith(rooms):
            import_module(module.name)
    found: list[type[BaseException]] = [IbdataError, *sorted(_below(IbdataError), key=_order), Interrupted]
    rows = [
        f"| `{error.__name__}` | `{error.__module__}` | {_code(error)} | {_summary(error)} |\n"
        for error in found
        if not error.__name__.startswith("_")
    ]
    return NOTE + OPENING + "".join(rows)


def _below(error: type[IbdataError]) -> set[type[IbdataError]]:
    return {found for sub in error.__subclasses__() for found in (sub, *_below(sub))}


def _order(error: type[IbdataError]) -> tuple[bool, str]:
    return error.__module__ != "ibdata.errors", error.__name__


def _code(error: type[BaseException]) -> str:
    return str(error.exit_code) if issubclass(error, IbdataError) else "128 + signal"


def _summary(error: type[BaseException]) -> str:
    return inspect.cleandoc(error.__doc__ or "").partition("\n\n")[0].replace("\n", " ")
