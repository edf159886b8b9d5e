"""The generated parts of docs/api.md, docs/columns.md and docs/errors.md."""

import inspect
from importlib import import_module

import ibdata
from ibdata.errors import IbdataError, Interrupted
from ibdata.experiment import Experiment
from ibdata.experiment.columns import Column
from ibdata.experiment.columns import columns as columns_of
from measuring.documents import table

PUBLIC = {
    "ibdata": [name for name in ibdata.__all__ if name not in ("__version__", "open")],
    "ibdata.testing": ["check_policy"],
    "ibdata.plots": ["plot", "figure"],
    "ibdata.report": ["card"],
    "ibdata.dataset.selection": ["Selection"],
    "ibdata.dataset.windows": ["Windows"],
    "ibdata.views.options": ["view_options"],
    "ibdata.dynamics": ["step", "initial_state", "Variant", "State", "Noise"],
    "ibdata.policies": [
        "Policy",
        "Needs",
        "Observed",
        "Decision",
        "Distribution",
        "ClippedNormal",
        "Uniform",
        "Certain",
        "Deterministic",
        "Wrapper",
    ],
}
OTHER_LAGS = [f"latent_theta_{lag}" for lag in range(2, 10)]


def api() -> str:
    """A section for each module with public names, which mkdocstrings describes from their docstrings."""
    parts = []
    for module, names in PUBLIC.items():
        parts.append(f"## {module}")
        for found in (getattr(import_module(module), name) for name in names):
            options = "\n    options:\n      inherited_members: true" if found is ibdata.Dataset else ""
            parts.append(f"::: {found.__module__}.{found.__qualname__}{options}")
    return "\n\n".join(parts)


def errors() -> str:
    """A table of the exceptions, the base class first."""
    rows = []
    for name, error in vars(ibdata.errors).items():
        if inspect.isclass(error) and issubclass(error, IbdataError | Interrupted) and name[0] != "_":
            summary = inspect.cleandoc(error.__doc__ or "").partition("\n\n")[0].replace("\n", " ")
            rows.append((f"`{name}`", getattr(error, "exit_code", "128 + signal"), summary))
    return table(("exception", "exit code", "meaning"), rows)


def columns() -> str:
    """A table of the default columns, and of what each option adds; the page says what `next_` means."""
    default = _columns(True)
    known = {column.name for column in default}
    sections = {
        "By default": [c for c in default if c.role != "next_observation" and c.name not in OTHER_LAGS],
        "With moving setpoints": [c for c in _columns(True, "drifting") if c.name not in known],
        "With `output.latent: full`": [c for c in _columns("full") if c.name not in known],
    }
    parts = []
    for heading, own in sections.items():
        rows = [(f"`{c.name}`", _values(c), c.description) for c in own]
        parts.append(f"## {heading}\n\n{table(('column', 'values', 'meaning'), rows)}")
    return "\n\n".join(parts)


def _columns(latent: bool | str, setpoints: str | int = 70) -> list[Column]:
    plain = {"name": "all", "setpoints": setpoints, "policies": ["random"], "output": {"latent": latent}}
    return columns_of(Experiment.model_validate(plain))


def _values(column: Column) -> str:
    kind = "" if column.dtype.startswith("float") else column.dtype
    unit = "" if column.unit == "1" else column.unit
    return ", ".join(filter(None, (kind, _range(column), unit)))


def _range(column: Column) -> str:
    if column.dtype in ("bool", "string") or column.low is None:
        return ""
    return f"from {column.low:g}" if column.high is None else f"{column.low:g} to {column.high:g}"
