"""docs/errors.md: the exceptions."""

import inspect

from ibdata import errors
from measuring.documents import table


def block() -> str:
    """A table of the exceptions, the base class first."""
    public = (errors.IbdataError, errors.Interrupted)
    found = [value for value in vars(errors).values() if inspect.isclass(value)]
    rows = [
        _row(error) for error in found if issubclass(error, public) and not error.__name__.startswith("_")
    ]
    return table(("exception", "exit code", "meaning"), rows)


def _row(error: type) -> tuple[str, str, str]:
    code = getattr(error, "exit_code", "128 + signal")
    summary = inspect.cleandoc(error.__doc__ or "").partition("\n\n")[0].replace("\n", " ")
    return f"`{error.__name__}`", str(code), summary
