"""Writing a dataset's card, README.md, and its report, report.html; the report needs matplotlib."""

from __future__ import annotations

import os
from pathlib import Path

from ibdata._numerics.arguments import public
from ibdata._system.files import plain_bytes, write
from ibdata._system.part import locked_part, resolved
from ibdata._system.storage import local
from ibdata.dataset import manifest
from ibdata.dataset.dataset import to_write
from ibdata.dataset.quality import quality
from ibdata.dataset.tabular import pairs
from ibdata.errors import OVERWRITE, UsageError, notice
from ibdata.generation.card import card_of
from ibdata.generation.finish import refuse_other_plan
from ibdata.plan.dataset_spec import spec_in
from ibdata.plots import drawn
from ibdata.plots.report_page import page


class Written(list[Path]):
    """The files that were written."""

    def __repr__(self) -> str:
        return pairs([(path.stem.lower(), path) for path in self])


@public
def card(folder: str | os.PathLike[str], overwrite: bool = False) -> Written:
    """Write the card README.md and the report report.html of a dataset.

    The report shows pictures, returns, statistics, experiment and provenance in one file that needs no
    network. The same dataset gives the same bytes. Without matplotlib only README.md is written, and a line
    on stderr says what to install.

    Args:
        folder: The folder of the dataset.
        overwrite: Whether to replace files that somebody has edited.

    Returns:
        The files that were written.

    Raises:
        DatasetError: There is no finished dataset.
        UsageError: A file has been edited; nothing is changed.
        BusyError: Another process writes to the dataset.
        IbdataError: The system refuses to write; nothing is changed.
    """
    path = local(folder)
    dataset = to_write(path)
    spec = spec_in(dataset.stored)
    refuse_other_plan(spec, dataset.stored.manifest)
    measured = quality(dataset)  # before the lock, as the pictures: it may take minutes
    texts = {manifest.CARD: card_of(dataset.stored, spec, measured)}
    why = ""
    try:
        texts[manifest.REPORT] = page(dataset, spec, drawn(dataset), measured)
    except ImportError as error:  # no matplotlib
        why = f"{manifest.REPORT} is not written: {error}"
    own = {*texts.values(), card_of(dataset.stored, spec)}
    with locked_part(resolved(path), path):
        manifest.read(path)  # somebody may have moved the dataset away
        dataset.stored.refuse_replaced()
        for name in texts:
            _refuse_edited(path / name, own, overwrite)
        for name, text in texts.items():
            write(path, name, text)
    if why:
        notice(why)
    return Written(path / name for name in texts)


def _refuse_edited(file: Path, own: set[bytes], overwrite: bool) -> None:
    """Raise UsageError if a file is there that may not be replaced, because its text is not ibdata's own."""
    if not os.path.lexists(file):
        return
    try:
        text = plain_bytes(file)
    except OSError as error:
        raise UsageError(f"{file}: cannot be replaced: {error.strerror}; move it away") from None
    if text not in own and not overwrite:
        raise UsageError(f"{file}: found other text than ibdata writes now; {OVERWRITE} to replace it")
