"""Writing a dataset's card, README.md, and its report, report.html; the report needs matplotlib."""

from __future__ import annotations

import os
from pathlib import Path

from ibdata.arguments import public
from ibdata.dataset import manifest
from ibdata.dataset.dataset import to_write
from ibdata.errors import notice
from ibdata.experiment.dataset_spec import spec_in
from ibdata.measures import quality
from ibdata.plots import drawn
from ibdata.plots.report_page import page
from ibdata.system.files import write
from ibdata.system.part import locked_part, resolved
from ibdata.system.storage import local
from ibdata.writing.card import card_of
from ibdata.writing.edited import keep_edited, sealed
from ibdata.writing.finish import refuse_other_plan


@public
def card(folder: str | os.PathLike[str]) -> list[Path]:
    """Write the card README.md and the report report.html of a dataset.

    The report shows pictures, returns, statistics, experiment and provenance in one file that needs no
    network. The same dataset gives the same bytes. What somebody has edited is kept, as README.md.old.
    Without matplotlib only README.md is written, and a line on stderr says what to install.

    Args:
        folder: The folder of the dataset.

    Returns:
        The files that were written.

    Raises:
        DatasetError: There is no finished dataset.
        BusyError: Another process writes to the dataset.
        IbdataError: The system refuses to write; nothing is changed.
    """
    path = local(folder)
    dataset = to_write(path)
    spec = spec_in(dataset.stored)
    refuse_other_plan(spec, dataset.stored.manifest)
    measured = quality(dataset)  # before the lock, as the pictures: it may take minutes
    report = why = None
    try:
        report = page(dataset, spec, drawn(dataset), measured)
    except ImportError as error:  # no matplotlib
        why = str(error)
    text = card_of(dataset.stored, spec, measured)
    with locked_part(resolved(path), path):
        dataset.stored.refuse_replaced()
        keep_edited(manifest.CARD, path, path)
        write(path, manifest.CARD, text)
        if report is None:
            notice(f"{manifest.REPORT} is not written: {why}")
            return [path / manifest.CARD]
        keep_edited(manifest.REPORT, path, path)
        write(path, manifest.REPORT, sealed(report))
    return [path / manifest.CARD, path / manifest.REPORT]
