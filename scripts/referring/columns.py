"""docs/columns.md: every column of a dataset."""

from ibdata.experiment import Experiment
from ibdata.simulation.variables import Column, columns
from referring import NOTE

OPENING = """\
# Columns

A dataset has these columns. Those of the later tables stand between `latent_mu_g` and `policy`. `float` is
`float32`, or `float64` with `output.dtype: float64`; the actions are rounded to float32 in both.
`meta/dataset.json` of a dataset says the same of its own columns.
[The format of a dataset](dataset-format.md) explains them.
"""


def page() -> str:
    """The page."""
    most = _columns("next", drifting=True)
    default = {column.name for column in _columns(True)}
    full = [column for column in _columns("full") if column.name not in default]
    drifting = {column.name for column in _columns(True, drifting=True)} - default
    later = [column for column in most if column.role == "next_latent"]
    only = [column for column in most if column.name in drifting]
    parts = [
        NOTE + OPENING,
        _table("By default", _columns(True)),
        _table("With moving setpoints", only),
        _table("With `output.latent: full`", full),
        _table("With `output.latent: next`", later),
    ]
    return "\n".join(parts) + "\nWith `output.latent: false` there are no `latent_*` columns.\n"


def _columns(latent: bool | str, drifting: bool = False) -> list[Column]:
    setpoints = "drifting" if drifting else 70
    plain = {
        "name": "all",
        "setpoints": setpoints,
        "policies": [{"kind": "random"}],
        "output": {"latent": latent},
    }
    return columns(Experiment.model_validate(plain))


def _table(heading: str, of: list[Column]) -> str:
    lines = [f"## {heading}", "", "| column | type | unit | range | meaning |", "|---|---|---|---|---|"]
    for column in of:
        kind = "float" if column.dtype.startswith("float") else column.dtype
        unit = "" if column.unit == "1" else column.unit
        lines.append(f"| `{column.name}` | {kind} | {unit} | {_range(column)} | {column.description} |")
    return "\n".join(lines) + "\n"


def _range(column: Column) -> str:
    low, high = column.low, column.high
    if column.dtype in ("bool", "string"):
        return ""
    if low is None or high is None:
        return "" if low is None else f"from {low:g}"
    return f"{low:g} to {high:g}"
