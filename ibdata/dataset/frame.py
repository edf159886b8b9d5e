"""The numbers of an Arrow table as numpy arrays, columns of one type that follow each other in one array."""

from __future__ import annotations

from itertools import groupby
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

# Names of columns that follow each other, and their values (columns, rows); None for a column of texts.
Frame = list[tuple[list[str], npt.NDArray[Any] | None]]


def frame_of(table: pa.Table, described: list[dict[str, Any]]) -> Frame:
    """The columns of a table in order, copied once."""
    frame: Frame = []
    for dtype, group in groupby(described, key=lambda column: column["dtype"]):
        names = [column["name"] for column in group]
        if dtype == "string":
            frame += [([name], None) for name in names]
            continue
        values = np.empty((len(names), table.num_rows), dtype=dtype)
        for out, name in zip(values, names, strict=True):
            row = 0
            for chunk in table[name].chunks:
                out[row : row + len(chunk)] = chunk.to_numpy(zero_copy_only=False)
                row += len(chunk)
        frame.append((names, values))
    return frame


def floats_of(frame: Frame) -> list[npt.NDArray[Any]]:
    """The arrays of floats, in order."""
    return [values for _, values in frame if values is not None and values.dtype.kind == "f"]


def columns_of(frame: Frame) -> dict[str, npt.NDArray[Any]]:
    """Each column of numbers by its name."""
    return {
        name: column
        for names, values in frame
        if values is not None
        for name, column in zip(names, values, strict=True)
    }
