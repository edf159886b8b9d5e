"""Writing a dataset from the episodes of others, and labelling the episodes of a dataset."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import suppress

import pyarrow as pa

from ibdata._system.files import plain_bytes, write
from ibdata._system.part import locked_part, resolved
from ibdata._system.signals import check
from ibdata._system.storage import refuse_url
from ibdata.dataset import manifest
from ibdata.dataset.dataset import Dataset
from ibdata.dataset.episodes import BLOCK_ROWS
from ibdata.errors import BusyError, DatasetError, IbdataError, notice
from ibdata.experiment import Experiment
from ibdata.generation import metadata
from ibdata.generation.build import Build
from ibdata.generation.card import with_splits_of
from ibdata.generation.finish import refuse_other_plan
from ibdata.generation.pieces import Piece, stored_pieces
from ibdata.generation.record import Record
from ibdata.generation.shard import write_receipt, write_shard
from ibdata.plan.columns import layout
from ibdata.plan.dataset_spec import DatasetSpec, Shard, spec_in


def write_dataset(spec: DatasetSpec, source: Dataset, out: str | os.PathLike[str]) -> Dataset:
    """Copy the episodes of a dataset, or of several opened as one, to one with this spec in a new folder.

    Raises UsageError if the folder is not new, and DatasetError if the episodes are not those that the source
    lists.
    """
    refuse_url(out)
    listed = source.stored.manifest
    record = Record.of(
        spec,
        code=listed.code,
        reproducible=bool(listed.reproducible),
        sources=[listed.content_root],
        clipped=listed.clipped_actions,
    )
    build = Build(out, spec, new=True, record=record)
    build.look(tidy=True)
    with build.open(record):
        for shard in build.missing():
            _copy(build, shard, source)
            check()
        build.publish()
    return Dataset(build.name)


def _copy(build: Build, shard: Shard, source: Dataset) -> None:
    """Copy a shard's episodes from a source, check that they are those that it lists, and write a receipt."""
    written = write_shard(build.spec, shard, _pieces(build.spec, shard, source), build.run)
    first, count = shard.offset + shard.first, shard.stop - shard.first
    if written.summary.digests != source.stored.episodes["digest"].slice(first, count).to_pylist():
        raise _changed(source)
    write_receipt(build.run, written)


def _pieces(spec: DatasetSpec, shard: Shard, source: Dataset) -> Iterator[Piece]:
    """Read the float columns of a shard's episodes from the files of the source that hold them."""
    try:
        yield from stored_pieces(spec, shard, _batches(spec.experiments[shard.experiment], shard, source))
    except ValueError as error:
        if isinstance(error, IbdataError):
            raise
        raise _changed(source) from None  # text instead of numbers


def _batches(experiment: Experiment, shard: Shard, source: Dataset) -> Iterator[pa.RecordBatch]:
    names, steps = layout(experiment).names, experiment.steps
    first, stop = shard.offset + shard.first, shard.offset + shard.stop
    for number, entry in enumerate(source.stored.manifest.shards):
        low, high = max(first, entry.episodes[0]), min(stop, entry.episodes[1])
        if low < high:
            start, end = ((episode - entry.episodes[0]) * steps for episode in (low, high))
            yield from source.stored.batches(number, names, BLOCK_ROWS, start, end)


def _changed(source: Dataset) -> DatasetError:
    return DatasetError(f"{source.place}: found other content than it lists; see ibdata validate")


def relabel(dataset: Dataset, before: DatasetSpec, spec: DatasetSpec) -> Dataset:
    """Write the splits of a spec into the metadata and the card of a dataset; nothing else changes.

    Raises BusyError if the dataset is being written, or it or its splits are no longer those of before.
    """
    refuse_url(dataset)
    listed = dataset.stored.manifest
    refuse_other_plan(spec, listed)
    with locked_part(resolved(dataset.path), dataset.place):
        dataset.stored.refuse_replaced()
        if spec_in(dataset.stored).later != before.later:
            raise BusyError(f"{dataset.place}: got other splits meanwhile; split it again")
        file, text = dataset.path / manifest.CARD, None  # first, for it may call all rows `train`
        with suppress(OSError):  # it is missing, or no file
            text = with_splits_of(spec, before, plain_bytes(file), listed)
        if text is not None:
            write(dataset.path, manifest.CARD, text)
        else:
            notice(
                f"{file}: found other text than ibdata writes, so it does not name these splits, and "
                f"load_dataset may call all rows train; ibdata card {dataset.path} --overwrite replaces it"
            )
        write(dataset.path, manifest.SPLITS, metadata.splits_file(spec))
    return Dataset(dataset)
