"""Exports for other libraries, one format a file: the file's name is the format, nothing else lists them.

A format is a module whose docstring is its help, with `export(view, path, target)`: it writes `path`,
reads it back, and returns the Python that will load it from `target`, its name afterwards. Where it has
them, `HISTORY` is its default history, `place(view, out)` the target that `out` means, and keyword
arguments are its own options.
"""

from __future__ import annotations

import inspect
import math
import os
import pkgutil
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from ibdata.dataset.reader import Dataset

FORMATS = tuple(sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_")))


class Exported(NamedTuple):
    """What an export made."""

    format: str
    path: str  # of the file or folder
    episodes: int
    rows: int  # transitions
    history: int
    reward_scale: float
    snippet: str  # Python that loads it


def export(
    dataset: Dataset | str | os.PathLike[str],
    to: str,
    out: str | os.PathLike[str],
    *,
    split: str | None = None,
    history: int | None = None,
    reward_scale: float = 1.0,
    id: str | None = None,
    progress: bool | None = False,
) -> Exported:
    """Write a dataset, or a split of it, in the form of another library, and read it back.

    to is one of FORMATS; out a path that does not exist (`minari`: the root above NAMESPACE/NAME-vN, the id
    is `id`, else made from the dataset's name). history stacks observations, newest first, 1 unless the
    format has another default (`neorl`: 30); rewards are multiplied by reward_scale. progress None shows a
    bar on stderr if that is a terminal. Every transition is kept, and nothing is left behind on failure.

    Raises UsageError for an option or a path that cannot be meant, or data that the format cannot hold;
    MissingError where a library is not installed; DatasetError for a damaged dataset; IbdataError where the
    system refuses.
    """
    from ibdata.dataset.reader import Dataset
    from ibdata.errors import UsageError
    from ibdata.exporters._target import stoppable, whole
    from ibdata.exporters._view import View
    from ibdata.system.memory import refuse_too_much

    format = _format(to)
    if history is None:
        history = getattr(format, "HISTORY", 1)
    if history < 1:
        raise UsageError(f"history: found {history}, expected at least 1")
    if not 0 < reward_scale < math.inf:
        raise UsageError(f"reward scale: found {reward_scale}, expected a finite number above 0")
    source = dataset if isinstance(dataset, Dataset) else Dataset(dataset)
    view = View(source, split, history, reward_scale, progress)
    refuse_too_much("history", view.history_bytes)
    if view.rows == 0:
        raise UsageError(f"split: {split!r} has no rows, expected some")
    options: dict[str, Any] = {}
    if id is not None:
        if "id" not in inspect.signature(format.export).parameters:
            raise UsageError(f"id: found {id!r}, expected none: {to} has no ids")
        options["id"] = id
    target = Path(format.place(view, Path(out), **options) if hasattr(format, "place") else out)
    with stoppable(target), whole(target) as path:
        snippet = format.export(view, path, target, **options)
    return Exported(to, str(target), view.episodes, view.rows, history, reward_scale, snippet)


def _format(to: str) -> Any:
    """The module of a format."""
    from ibdata.errors import UsageError
    from ibdata.experiment.messages import suggestion

    if to not in FORMATS:
        raise UsageError(
            f"format: found {to!r}, expected one of {', '.join(FORMATS)}{suggestion(to, FORMATS)}"
        )
    return import_module(f"{__name__}.{to}")
