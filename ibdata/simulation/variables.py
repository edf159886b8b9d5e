"""Variables of a state by name: the rows in which a run records them, and their values."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.dynamics import State
from ibdata.variables import of_role, rows, variable_of
from ibdata.views.options import ViewOptions

Table = npt.NDArray[np.floating[Any]]  # (columns, rows), float32 or float64


def hidden(drifting: bool) -> tuple[str, ...]:
    """The variables of the Markov state that are not observed."""
    return of_role("latent", "drift") if drifting else of_role("latent")


def observed_rows(view: ViewOptions, drifting: bool) -> npt.NDArray[np.int64]:
    """The rows of the variables that a view observes."""
    return record_rows([variable_of(name) for name in view.columns(drifting)])


def values_of(state: State, which: npt.NDArray[np.int64]) -> npt.NDArray[np.float32]:
    """The values of variables in a state of n lanes, (n, rows), as a dataset holds them."""
    values: npt.NDArray[np.float32] = (state.values[which].T + 0.0).astype(np.float32)
    return values


def record_rows(names: Sequence[str]) -> npt.NDArray[np.int64]:
    """The rows (k,) of variables in a state."""
    return np.array(rows(*names), dtype=np.int64)
