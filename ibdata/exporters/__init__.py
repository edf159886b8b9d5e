"""Exports for other libraries. Each format is one module here, which is found by its name.

The docstring of a format is its help. A format has `export(source, path, target)`, which writes the file or
folder `path` and returns the Python code that loads it from `target`, its final name. It may also have

- `HISTORY`, its default history;
- `place(source, out)`, which returns the target for the option `--out`. Such a format may have ids, which
  both functions then take as the keyword `id`.
"""

from __future__ import annotations

import os
import pkgutil
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from ibdata._numerics.arguments import public
from ibdata._numerics.naming import counted, rows_in_episodes
from ibdata.dataset.tabular import pairs

if TYPE_CHECKING:
    from ibdata.dataset.dataset import Place

FORMATS = tuple(sorted(m.name for m in pkgutil.iter_modules(__path__) if not m.name.startswith("_")))


class Exported(NamedTuple):
    """The result of an export.

    Attributes:
        format: the format, as it was asked for.
        path: the file or folder.
        episodes: the number of episodes.
        rows: the number of transitions.
        history: how many observations are stacked.
        reward_scale: the factor of the rewards.
        snippet: Python that loads the export.
        frame: the names of the numbers that are observed at one step.
        left_out: the number of transitions whose next frame is not in the dataset.
    """

    format: str
    path: str
    episodes: int
    rows: int
    history: int
    reward_scale: float
    snippet: str
    frame: tuple[str, ...]
    left_out: int

    def plain(self) -> dict[str, Any]:
        """The fields as plain data for JSON."""
        return self._asdict()

    def __repr__(self) -> str:
        lines = [
            ("export", self.path),
            ("rows", rows_in_episodes(self.rows, self.episodes)),
            ("format", self.format),
        ]
        if self.left_out:
            why = "the last of each episode; generate with output: {latent: next} to keep them"
            lines.append(("left out", f"{counted(self.left_out, 'row')}, {why}"))
        return f"{pairs(lines)}\n\n{self.snippet}"


@public
def export(
    dataset: Place,
    to: str,
    out: str | os.PathLike[str],
    *,
    split: str | Sequence[str] | None = None,
    history: int | None = None,
    id: str | None = None,
    overwrite: bool = False,
    progress: bool | None = False,
    view: Mapping[str, Any] | None = None,
) -> Exported:
    """Write a dataset, or a part of it, in the format of another library.

    Every transition is kept, unless a view observes hidden columns that the dataset does not have after the
    last row of an episode; `left_out` counts these rows. `out` appears only when it is complete; nothing is
    left behind on failure.

    Args:
        dataset: A dataset, its folder or URL, or a selection of its episodes.
        to: The format: one of `FORMATS`.
        out: The file or folder to write; for `minari` the root folder, which gets a folder named `id`.
        split: Only this split, or these; by default all rows.
        history: How many observations to stack, newest first; 1 unless the format has another default.
        id: For `minari`, NAMESPACE/NAME-vN; by default made from the dataset's name.
        overwrite: Whether to replace an export, a file or a folder, at `out`; nothing else is replaced.
        progress: Whether to show a bar on stderr; None shows it if stderr is a terminal.
        view: What is seen and rewarded, as the options of a view (the page "Views and costs"),
            such as {"observe": "markov", "reward_scale": 0.01}.

    Returns:
        The path and size of the export, and the Python code that loads it.

    Raises:
        UsageError: An argument is invalid, or the format cannot hold these data.
        IbdataError: A library is not installed.
        DatasetError: The dataset is damaged.
        BusyError: Another process exports to this path.
        IbdataError: The system refuses to write.
    """
    from ibdata._system.storage import local
    from ibdata.dataset.dataset import opened
    from ibdata.dataset.selection import checked_length
    from ibdata.errors import UsageError, meant
    from ibdata.exporters._source import Source
    from ibdata.exporters._target import appearing_whole
    from ibdata.views.options import view_of

    out = local(out)
    if to not in FORMATS:
        raise UsageError(f"format: found {to!r}{meant(to, FORMATS)}")
    format = import_module(f"{__name__}.{to}")
    if history is None:
        history = getattr(format, "HISTORY", 1)
    history = checked_length(history)
    options = view_of(view)
    if options.cost is not None and not getattr(format, "HOLDS_COSTS", False):
        raise UsageError(f"cost: found one, but the format {to} has no place for costs; leave it out")
    source = Source(opened(dataset).select(split), history, options, progress)
    more = {} if id is None else {"id": id}
    if more and not hasattr(format, "place"):
        raise UsageError(f"id: found {id!r}, but the format {to} has no ids; leave it out")
    target = Path(format.place(source, out, **more) if hasattr(format, "place") else out)
    with appearing_whole(target, overwrite) as path:
        snippet = format.export(source, path, target, **more)
    return Exported(
        format=to,
        path=str(target),
        episodes=source.episodes,
        rows=source.rows,
        history=history,
        reward_scale=options.reward_scale,
        snippet=snippet,
        frame=source.frame,
        left_out=source.left_out,
    )
