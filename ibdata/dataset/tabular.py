"""Results that print as tables, that notebooks show as tables, and that become DataFrames."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from ibdata.errors import printable

if TYPE_CHECKING:
    import pandas as pd

MOST_ROWS = 60  # that are shown of a table
MOST_VALUES = 10  # that are shown of a list


class Table(NamedTuple):
    """Named columns, rows of values, and lines of text below them. None is shown as a dash."""

    names: Sequence[str]
    rows: Sequence[Sequence[Any]]
    notes: Sequence[str] = ()


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


def as_text(table: Table) -> str:
    """A table as lines of text: texts on the left of their columns, numbers on the right.

    >>> print(as_text(Table(("policy", "score"), [("safe", 12.5), ("random", None)], ["score: 0 to 100"])))
    policy  score
    safe     12.5
    random      –
    score: 0 to 100
    """
    cells = [list(table.names), *_cells(table)]
    right = [any(isinstance(x, int | float) for x in column) for column in zip(*table.rows, strict=True)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    lines = [
        "  ".join(x.rjust(w) if r else x.ljust(w) for x, w, r in zip(line, widths, right, strict=True))
        for line in (cells if table.rows else ())
    ]
    return "\n".join([*map(str.rstrip, lines), *_notes(table)])


def as_html(tables: Sequence[Table]) -> str:
    """Tables as HTML, with escaped texts."""
    from html import escape

    import pandas as pd

    parts = []
    for table in tables:
        if table.rows:
            cells = pd.DataFrame(_cells(table), columns=list(table.names))
            parts.append(cells.to_html(index=False, border=0))
        parts += [f"<p>{escape(line)}</p>" for line in _notes(table)]
    return "\n".join(parts)


def _cells(table: Table) -> list[list[str]]:
    return [[_shown(value) for value in row] for row in table.rows[:MOST_ROWS]]


def _notes(table: Table) -> list[str]:
    more = len(table.rows) - MOST_ROWS
    return [*([f"and {more:,} more"] if more > 0 else []), *map(printable, table.notes)]


def _shown(value: Any) -> str:
    """A value as text.

    >>> _shown(12345), _shown(0.12345678), _shown((1.0, 2.5)), _shown(None), _shown("a\\n")
    ('12,345', '0.123457', '[1, 2.5]', '–', 'a\\\\n')
    """
    if value is None:
        return "–"
    if isinstance(value, tuple | list):
        more = [f"… {len(value):,} in all"] if len(value) > MOST_VALUES else []
        return f"[{', '.join([*map(_shown, value[:MOST_VALUES]), *more])}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:,.6g}"
    return f"{value:,}" if isinstance(value, int) else printable(str(value))
