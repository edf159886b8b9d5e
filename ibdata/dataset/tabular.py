"""Results that print as tables, that notebooks show as tables, and that become DataFrames."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from ibdata._numerics.naming import column_format
from ibdata.errors import printable

if TYPE_CHECKING:
    import pandas as pd

MOST_ROWS = 60  # that are shown of a table
WIDTH = 80  # of a terminal
COLUMN = ("name", "dtype", "unit", "description")  # what is shown of a dataset's columns
MOST_VALUES = 10  # that are shown of a list


class Table(NamedTuple):
    """Named columns, rows of values, and lines of text below them. None is shown as a dash.

    A row that is a text is a heading of the rows below it.
    """

    names: Sequence[str]
    rows: Sequence[Sequence[Any]]
    notes: Sequence[str] = ()
    most: int | None = MOST_ROWS  # rows that are shown; None shows all

    def fitting(self, *least_needed: str) -> Table:
        """The table without those columns, the first ones first, that a terminal has no room for."""
        table = self
        for name in least_needed:
            if max(map(len, as_text(table._replace(notes=())).split("\n"))) > WIDTH:
                kept = [column for column in table.names if column != name]
                at = [table.names.index(column) for column in kept]
                table = table._replace(
                    names=kept, rows=[x if isinstance(x, str) else [x[i] for i in at] for x in table.rows]
                )
        return table


class Number(str):
    """A number as it is shown, which stands on the right of its column."""


class Tabular(ABC):
    """Base class of results. A subclass defines `tables`, of which the first is that of `to_pandas`."""

    @abstractmethod
    def tables(self) -> list[Table]:
        """The tables that show the result."""

    def to_pandas(self) -> pd.DataFrame:
        """The result as a pandas DataFrame."""
        import pandas as pd

        table = self.tables()[0]
        return pd.DataFrame(list(table.rows), columns=list(table.names))

    def __repr__(self) -> str:
        return "\n\n".join(map(as_text, self.tables()))

    def _repr_html_(self) -> str:
        return as_html(self.tables())


class ColumnStatistics(Tabular, dict[str, Any]):
    """The statistics of each column: a dict by the column's name that shows as a table.

    Each is a dict of `count` (numbers that are not NaN), `mean`, `std` (of the population: divided by
    `count`), `min`, `max` and `quantiles`, a dict by probability q, such as "0.5": the least number
    x of the column for which at least a share q of the numbers is at most x.
    """

    def tables(self) -> list[Table]:
        """A row for each column."""
        shown = ("mean", "std", "min", "max")
        rows = [
            (name, *(column[key] for key in shown), column["quantiles"]["0.5"])
            for name, column in self.items()
        ]
        most = max((column["count"] for column in self.values()), default=0)
        notes = [
            f"{name}: of the {column['count']:,} of {most:,} rows that have a number"
            for name, column in self.items()
            if column["count"] < most
        ]
        return [Table(("column", *shown, "median"), rows, notes)]

    def plain(self) -> dict[str, Any]:
        """The statistics as plain data for JSON."""
        return {"columns": dict(self)}


class Described(Tabular, dict[str, Any]):
    """What meta/dataset.json says: a dict that shows as tables.

    Its keys are `name`, `dynamics`, `drifting` (whether setpoints move), `start`, `counts`, `columns`, a list
    of dicts with the `name`, `role`, `dtype`, `unit`, `low`, `high` and `description` of each column, and
    `format` and `version` of the file.
    """

    def tables(self) -> list[Table]:
        """What is said of the dataset, and a row for each column."""
        said = [(name, value) for name, value in self.items() if name not in ("counts", "columns")]
        columns = [[column[key] for key in COLUMN] for column in self["columns"]]
        return [Table(("", "dataset"), [*said, *self["counts"].items()]), Table(COLUMN, columns)]


def as_text(table: Table) -> str:
    """A table as lines of text: texts on the left of their columns, numbers on the right.

    >>> print(as_text(Table(("policy", "score"), [("safe", 12.5), ("random", None)], ["score: 0 to 100"])))
    policy  score
    safe     12.5
    random      –
    score: 0 to 100
    """
    cells = [list(table.names), *cells_of(table)]
    right = _is_numeric(table)
    widths = [max(map(len, column)) for column in zip(*filter(_is_row, cells), strict=True)]
    lines = [
        "  ".join(x.rjust(w) if r else x.ljust(w) for x, w, r in zip(line, widths, right, strict=True))
        if _is_row(line)
        else str(line)
        for line in (cells if table.rows else ())
    ]
    return "\n".join([*map(str.rstrip, lines), *_notes(table)])


def pairs(rows: Sequence[tuple[str, object]]) -> str:
    """Names and values, a pair a line.

    >>> print(pairs([("rows", 5), ("name", "a")]))
    rows  5
    name  a
    """
    width = max(len(name) for name, _ in rows)
    return "\n".join(printable(f"{name.ljust(width)}  {value}") for name, value in rows)


def transposed(columns: Mapping[str, Sequence[Any]]) -> str:
    """Columns of values, each on one line after its name."""
    texts = {name: column_texts(values) for name, values in columns.items()}
    longest, width = max(map(len, texts)), max(len(text) for column in texts.values() for text in column) + 2
    lines = (name.ljust(longest) + "".join(x.rjust(width) for x in column) for name, column in texts.items())
    return "\n".join(map(printable, lines))


def as_html(tables: Sequence[Table]) -> str:
    """Tables as HTML, with escaped texts."""
    from html import escape

    parts = []
    for table in tables:
        if table.rows:
            styles = [f' style="text-align: {"right" if right else "left"}"' for right in _is_numeric(table)]
            lines = [
                "".join(f"<{tag}{style}>{escape(x)}</{tag}>" for x, style in zip(cells, styles, strict=True))
                if _is_row(cells)
                else f'<th colspan="{len(styles)}" style="text-align: left">{escape(str(cells))}</th>'
                for tag, cells in [("th", table.names), *(("td", row) for row in cells_of(table))]
            ]
            parts.append("\n".join(["<table>", *(f"<tr>{line}</tr>" for line in lines), "</table>"]))
        parts += [f"<p>{escape(line)}</p>" for line in _notes(table)]
    return "\n".join(parts)


def column_texts(values: Sequence[Any]) -> list[str]:
    """The values of a column as texts, in which numbers have equally many decimals.

    >>> column_texts([12345, 4 / 3, 1.0, None, True, "a\\n"])
    ['12,345', '1.33333', '1.00000', '–', 'true', 'a\\\\n']
    >>> column_texts([(1.0, 2.5), (-10.25, 0.0)])
    ['[1.00, 2.50]', '[-10.25, 0.00]']
    """
    numbers = [x for value in values for x in (value if isinstance(value, tuple | list) else [value])]
    number_format = column_format([x for x in numbers if isinstance(x, float)])
    return [_shown(value, number_format) for value in values]


def _is_row(row: Sequence[Any]) -> bool:
    """Whether a row is none that is a heading."""
    return not isinstance(row, str)


def _is_numeric(table: Table) -> list[bool]:
    """Whether each column holds numbers."""
    columns = zip(*filter(_is_row, table.rows), strict=True)
    return [any(isinstance(x, int | float | Number) for x in column) for column in columns]


def cells_of(table: Table) -> list[list[str] | str]:
    """The rows that are shown, as texts; those that are headings are one text."""
    rows = table.rows[: table.most]
    columns = [column_texts(column) for column in zip(*filter(_is_row, rows), strict=True)]
    texts = zip(*columns, strict=True)
    return [list(next(texts)) if _is_row(row) else printable(str(row)) for row in rows]


def _notes(table: Table) -> list[str]:
    more = len(table.rows) - len(table.rows[: table.most])
    return [*([f"and {more:,} more"] if more > 0 else []), *map(printable, table.notes)]


def _shown(value: Any, number_format: str) -> str:
    if value is None:
        return "–"
    if isinstance(value, tuple | list):
        more = [f"… {len(value):,} in all"] if len(value) > MOST_VALUES else []
        return f"[{', '.join([*(_shown(x, number_format) for x in value[:MOST_VALUES]), *more])}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        text = format(value, number_format)
        return text if text.strip("-0.") else text.lstrip("-")  # no zero has a sign
    return f"{value:,}" if isinstance(value, int) else printable(str(value))
