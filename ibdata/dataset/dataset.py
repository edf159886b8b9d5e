"""A finished dataset, or some of its episodes, which are read without running any code of it."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa

from ibdata._numerics.arguments import public
from ibdata._system.storage import local
from ibdata.dataset import manifest
from ibdata.dataset.digest import identity
from ibdata.dataset.episodes import BLOCK_ROWS, SomeEpisodes, refuse_selection
from ibdata.dataset.selection import (
    ColumnsArg,
    SplitArg,
    checked_columns,
    checked_history,
    checked_length,
    refuse_columns,
)
from ibdata.dataset.transitions import (
    Transitions,
    arrays_of,
    as_batch,
    beside,
    first_rows,
    left_out,
    needed,
    transitions,
    whole_episodes,
)
from ibdata.dataset.windows import Sizes, WindowFolder, Windows, fill_folder, in_memory
from ibdata.errors import UsageError
from ibdata.views.options import View, ViewOptions, view_of

if TYPE_CHECKING:
    import pandas as pd


class Dataset(SomeEpisodes):
    """A finished dataset in a folder or at a URL, or some of its episodes. Only listed files are read.

    If the dataset is replaced after it was opened, reading raises BusyError. Functions that take a folder
    take a Dataset too. Of one that `select` gives, `content_root`, `info`, `manifest`, `splits` and `place`
    are those of the whole dataset, and all else is of its episodes.

    Args:
        path: The folder, or a URL such as s3://bucket/name. A plain name, without `..`, of which there is no
            folder is looked for in data/, so that the name of a shipped experiment finds its dataset. Of a
            list of these, of opened datasets or of selections, the datasets follow one another as if `merge`
            had copied them, but without its copy: what needs a folder refuses them.

    Raises:
        DatasetError: There is no finished dataset, or its manifest is damaged.
        UsageError: The list is empty, or `merge` would refuse its datasets.
    """

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"a dataset has no {name}; ibdata.card, export, plots.plot and others take one")

    def __getitem__(self, name: Any) -> Any:
        raise TypeError(f"a dataset has no items; to_pandas()[{name!r}] is a column, arrays() has all")

    @public
    def table(
        self,
        columns: ColumnsArg = None,
        split: SplitArg = None,
        *,
        view: View = None,
    ) -> pa.Table:
        """The rows as an Arrow table.

        Args:
            columns: The names of the columns to read; by default all.
            split: Only rows of this split, or of these.
            view: The options of a view, a mapping of some of observe, actions, reward, reward_scale,
                imperfections and cost (the page "Views and costs"). The columns are then episode, step,
                those of the frame, the actions, the reward, the cost, the flags, and `next_…` of the frame.

        Raises:
            UsageError: The dataset has no such column or split, or the selection is empty; or both columns
                and a view are given.
            DatasetError: A file is missing or damaged.
        """
        chosen = self._chosen(split)
        if view is None:
            return self.stored.rows_of(chosen.mask, checked_columns(columns, self.stored.info))
        refuse_columns(columns)
        info, options = self.stored.info, view_of(view)
        shown = transitions(self.stored.rows_of(chosen.mask, needed(info, options)), info, options)
        return pa.Table.from_batches([as_batch(shown, options.frame(info.drifting))])

    @public
    def to_pandas(
        self,
        columns: ColumnsArg = None,
        split: SplitArg = None,
        *,
        view: View = None,
    ) -> pd.DataFrame:
        """The rows as a pandas DataFrame, whose index has their numbers in the dataset, from 0.

        Arguments and errors are those of `table`.
        """
        chosen = self._chosen(split)
        frame: pd.DataFrame = chosen.table(columns, view=view).to_pandas(ignore_metadata=True)
        if len(frame) < self.stored.manifest.rows:
            lengths = self.stored.episodes["length"].to_numpy()
            inside = np.repeat(chosen.inside, lengths)
            if left_out(self.stored.info, view_of(view)):
                inside[np.cumsum(lengths) - 1] = False
            frame.index = np.flatnonzero(inside)
        return frame

    @public
    def head(
        self,
        rows: int = 5,
        columns: ColumnsArg = None,
        split: SplitArg = None,
        *,
        at: tuple[int, int] | None = None,
    ) -> pa.Table:
        """The first rows as an Arrow table, read without the others.

        Args:
            rows: How many rows.
            columns: As in `table`.
            split: As in `table`.
            at: `(episode, step)` of the row of the dataset to begin at; by default the first one.

        Raises:
            UsageError: `rows` is below 1, or the dataset has no such column, split or row; or a row is given
                for a split or a selection.
            DatasetError: A file is missing or damaged.
        """
        rows = min(checked_length(rows, "rows"), self.stored.manifest.rows)
        chosen = self._chosen(split)
        if at is None:
            batches = chosen.iter_batches(columns, batch_rows=rows)
        elif chosen.mask is not None:
            raise UsageError("at: found a split or a selection too; leave one of them out")
        else:
            batches = self.stored.batches_from(at, checked_columns(columns, self.stored.info), rows)
        return first_rows(batches, rows)

    @public
    def iter_batches(
        self,
        columns: ColumnsArg = None,
        split: SplitArg = None,
        batch_rows: int = 65_536,
        *,
        view: View = None,
    ) -> Iterator[pa.RecordBatch]:
        """The rows in order, at most `batch_rows` at a time, in constant memory.

        The other arguments and the errors are those of `table`.

        Raises UsageError if batch_rows is below 1.
        """
        batch_rows = min(checked_length(batch_rows, "batch_rows"), self.stored.manifest.rows)
        chosen = self._chosen(split)
        if view is None:
            names = checked_columns(columns, self.stored.info)
            return self.stored.batches_of(chosen.mask, names, batch_rows)
        refuse_columns(columns)
        options = view_of(view)
        frame = options.frame(self.stored.info.drifting)
        blocks = chosen._transitions(options, batch_rows)
        shown = (pa.Table.from_batches([as_batch(block, frame)]) for block in blocks)
        return (batch for table in shown for batch in table.to_batches(max_chunksize=batch_rows))

    @public
    def arrays(
        self,
        history: int = 1,
        split: SplitArg = None,
        pad: str = "repeat",
        columns: Sequence[str] = (),
        *,
        view: View = None,
    ) -> dict[str, npt.NDArray[Any]]:
        """The rows as the arrays that learning libraries take.

        Args:
            history: How many frames to stack, newest first. A frame has the six observed variables, unless
                the view shows others.
            split: As in `table`.
            pad: For rows with fewer frames before them, "repeat" the first, or "drop" these rows.
            columns: Further columns of the dataset, such as action_log_prob and policy.
            view: The options of a view, as in `table`.

        Returns:
            observations and next_observations (N, 6 · history), actions (N, 3), rewards, terminated,
            truncated, episode and step (N,), and the further columns by name; costs (N,) if the view has a
            cost; expert_actions (N, 3) if the dataset has them. If the view observes values that the dataset
            does not have after the last row of an episode, that row is left out.

        Raises:
            UsageError: An argument is invalid, or as in `table`.
            DatasetError: A file is missing or damaged.
        """
        drop, options = checked_history(history, pad), view_of(view)
        more = checked_columns(columns, self.stored.info) if len(columns) else []
        names = list(dict.fromkeys([*needed(self.stored.info, options), *more]))
        table = self.stored.rows_of(self._chosen(split).mask, names)
        return arrays_of(table, self.stored.info, options, history, drop, more)

    @public
    def windows(
        self,
        history: int = 1,
        split: SplitArg = None,
        pad: str = "repeat",
        folder: str | os.PathLike[str] | None = None,
        *,
        view: View = None,
    ) -> Windows:
        """The rows as `arrays` gives them, in float32, but stacked only when they are asked for.

        For `torch.utils.data.DataLoader(windows, batch_size=256, shuffle=True, collate_fn=windows.collate)`.

        Args:
            history: As in `arrays`.
            split: As in `table`.
            pad: As in `arrays`.
            folder: A folder to keep the values in, which are then mapped and take no memory. It is made if it
                does not exist; if it holds the same windows, they are used.
            view: As in `table`.

        Raises:
            UsageError: As in `arrays`, or the folder holds something else.
            DatasetError: A file is missing or damaged.
        """
        drop, options = checked_history(history, pad), view_of(view)
        chosen = self._chosen(split)
        blocks = chosen._transitions(options)
        lengths = chosen.episode_table["length"].to_numpy()
        kept = np.maximum(lengths - left_out(self.stored.info, options), 0)
        rows, lost = int(kept.sum()), int((lengths - kept).sum())
        frame = options.frame(self.stored.info.drifting)
        sizes = Sizes(
            episodes=int(np.count_nonzero(kept)),
            rows=rows,
            frame=len(frame),
            beside=beside(self.stored.info, options),
        )
        if folder is None or not rows:  # nothing to keep in files
            return Windows(in_memory(sizes, blocks), frame, history, drop, lost)
        description = {
            "content_root": self.content_root,
            "episodes": identity(chosen.episode_table),
            "view": options.plain(self.stored.info.drifting),
        }
        source = WindowFolder(local(folder).absolute(), description, sizes)
        fill_folder(source, blocks)
        return Windows(source, frame, history, drop, lost)

    def _transitions(self, options: ViewOptions, rows: int = BLOCK_ROWS) -> Iterator[Transitions]:
        """The transitions in order, those of whole episodes with about `rows` rows at a time.

        Raises UsageError at once if the view does not fit the dataset.
        """
        import pandas  # noqa: F401  # because Arrow imports it for the first rows, after the call

        info = self.stored.info
        batches = self.stored.batches_of(self.mask, needed(info, options), rows)
        return (transitions(table, info, options) for table in whole_episodes(batches, self.place))


Place = Dataset | str | os.PathLike[str]


def opened(place: Place) -> Dataset:
    """Return a dataset as it is, or open the one in a folder or at a URL."""
    return place if isinstance(place, Dataset) else Dataset(place)


def whole_dataset(place: Place) -> Dataset:
    """Like `opened`. Raises UsageError for a selection."""
    dataset = opened(place)
    refuse_selection(dataset)
    return dataset


def to_write(place: Place) -> Dataset:
    """Like `opened`, but a writer's folder is not looked for in data/, and it writes to no selection."""
    manifest.read(place)
    return opened(place)
