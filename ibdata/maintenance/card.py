"""Writing a dataset's card, README.md, and its report, report.html; the report needs matplotlib."""

from __future__ import annotations

import os
import sys
from pathlib import Path

from ibdata.dataset import manifest
from ibdata.dataset.reader import Dataset
from ibdata.errors import MissingError, UsageError, printable
from ibdata.experiment.dataset_spec import DatasetSpec, spec_in
from ibdata.generation import output_folder, replacement
from ibdata.generation.single_files import refuse_edits
from ibdata.plots import drawn
from ibdata.plots.report_page import page
from ibdata.system import lock
from ibdata.system.atomic_files import write
from ibdata.system.guard import writing_to
from ibdata.system.storage import refuse_url
from ibdata.version import __version__
from ibdata.writing.card import card as readme
from ibdata.writing.card import refuse_foreign
from ibdata.writing.finish import rewritten_manifest
from ibdata.writing.metadata import unread_shards
from ibdata.writing.planned import refuse_other_plan


def card(folder: str | os.PathLike[str]) -> Dataset:
    """Write the card README.md and the report report.html of a dataset, replacing old ones, and open it.

    The report shows pictures, returns, statistics, experiment and provenance in one file that needs no
    network. The manifest lists both files; no row and no other file changes. The same dataset gives the same
    bytes. Without matplotlib only README.md is written, a report stays as it is, and a line on stderr says
    what to install.

    Args:
        folder: The folder of the dataset.

    Raises:
        UsageError: Somebody else wrote or edited the README.md or report.html that is there.
        DatasetError: There is no finished dataset.
        BusyError: Another process writes to the dataset.
        IbdataError: The system refuses to write; nothing is changed.
    """
    refuse_url(folder)
    path = Path(folder)
    dataset = Dataset(path)
    lock.refuse_busy(path)
    output_folder.refuse_links(path)
    refuse_foreign(path / manifest.CARD)
    _refuse_foreign_report(path, dataset)
    refuse_edits(path, dataset.manifest_model, "the new one")
    spec = spec_in(path, dataset.manifest_model)
    refuse_other_plan(spec, dataset.manifest_model)
    report = _report(dataset, spec)  # before the lock: it may take minutes
    with writing_to(path):
        replacement.finish_interrupted(path)
        manifest.refuse_replaced(path, dataset.manifest_model)
        listed = dataset.manifest_model
        entries = listed.entries()
        with replacement.staged(path) as staged:
            replacement.keep(path, staged, (file for file in entries if file.startswith("meta/")))
            made = readme(
                spec,
                unread_shards(spec, listed),
                dataset.content_root,
                dataset.episode_table,
                printable(listed.versions.get("ibdata", __version__)),
            )
            entries[manifest.CARD] = write(staged, manifest.CARD, made)
            if report is not None:
                entries[manifest.REPORT] = write(staged, manifest.REPORT, report)
            data = rewritten_manifest(listed, entries, versions=listed.versions)
            write(staged, manifest.PATH, data)
    return Dataset(path)


def _report(dataset: Dataset, spec: DatasetSpec) -> bytes | None:
    """The bytes of report.html; None, and a line on stderr, where matplotlib is not installed."""
    try:
        return page(dataset, spec, drawn(dataset))
    except MissingError as error:
        print(f"ibdata: {manifest.REPORT} is not written: {error}", file=sys.stderr, flush=True)
        return None


def _refuse_foreign_report(path: Path, dataset: Dataset) -> None:
    if manifest.REPORT not in dataset.manifest_model.entries() and os.path.lexists(path / manifest.REPORT):
        raise UsageError(f"{path / manifest.REPORT}: found a file that ibdata did not write; move it away")
