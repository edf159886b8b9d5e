"""docs/columns.md: every column of a dataset."""

from collections.abc import Iterable

from ibdata.experiment import Experiment
from ibdata.experiment.columns import Column, columns
from measuring.documents import table

OTHER_LAGS = [f"latent_theta_{lag}" for lag in range(2, 10)]


def block() -> str:
    """A table of the default columns, and of what each option adds; the page says what `next_` means."""
    default = _columns(True)
    known = {column.name for column in default}
    shown = [c for c in default if c.role != "next_observation" and c.name not in OTHER_LAGS]
    moving, full = _columns(True, "drifting"), _columns("full")
    return "\n\n".join(
        [
            _section("By default", shown),
            _section("With moving setpoints", [c for c in moving if c.name not in known]),
            _section("With `output.latent: full`", [c for c in full if c.name not in known]),
        ]
    )


def _columns(latent: bool | str, setpoints: str | int = 70) -> list[Column]:
    plain = {"name": "all", "setpoints": setpoints, "policies": ["random"], "output": {"latent": latent}}
    return columns(Experiment.model_validate(plain))


def _section(heading: str, of: Iterable[Column]) -> str:
    rows = [
        (
            f"`{column.name}`",
            "float" if column.dtype.startswith("float") else column.dtype,
            "" if column.unit == "1" else column.unit,
            _range(column),
            column.description,
        )
        for column in of
    ]
    return f"## {heading}\n\n{table(('column', 'type', 'unit', 'range', 'meaning'), rows)}"


def _range(column: Column) -> str:
    if column.dtype in ("bool", "string") or column.low is None:
        return ""
    return f"from {column.low:g}" if column.high is None else f"{column.low:g} to {column.high:g}"
