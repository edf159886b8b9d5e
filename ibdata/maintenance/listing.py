"""The datasets below a folder, finished or not."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from ibdata.dataset import manifest
from ibdata.errors import IbdataError, UsageError
from ibdata.experiment import load
from ibdata.experiment.dataset_spec import DatasetSpec, spec_in
from ibdata.experiment.split_schemes import setpoints
from ibdata.generation import output_folder
from ibdata.system.storage import refuse_url


class Listed(NamedTuple):
    """A folder that holds a dataset.

    `state` is finished, unfinished, unsettled (a replacement was interrupted) or damaged. `rows` and
    `content_root` are None unless the manifest tells them.
    """

    path: Path
    state: str
    name: str | None
    rows: int | None
    setpoints: list[float]
    policies: list[str]
    bytes: int
    content_root: str | None

    def plain(self) -> dict[str, Any]:
        """The fields as plain data for JSON."""
        return {**self._asdict(), "path": str(self.path)}


def datasets_in(folder: str | os.PathLike[str]) -> list[Listed]:
    """List the datasets in a folder and below it, in the order of their paths.

    Links and hidden folders are not followed. No code of a dataset runs.

    Args:
        folder: The folder; it may itself be a dataset.

    Raises:
        UsageError: There is no such folder.
    """
    refuse_url(folder)
    root = Path(folder)
    if not os.path.isdir(root):
        raise UsageError(f"{root}: found no folder here, expected one to look for datasets in")
    return [_listed(path) for path in _places(root)]


def _places(root: Path) -> Iterator[Path]:
    """The folders that hold a dataset; nothing inside a dataset is looked at."""
    for place, below, _ in os.walk(root):
        below[:] = sorted(name for name in below if not name.startswith("."))
        signs = (manifest.PATH, output_folder.EXPERIMENT, f"{manifest.NEW}/{manifest.MARK}")
        if any(os.path.isfile(os.path.join(place, sign)) for sign in signs):
            below.clear()
            yield Path(place)


def _listed(path: Path) -> Listed:
    finished = manifest.locate(path, manifest.PATH).is_file()
    try:
        if not finished:
            spec = DatasetSpec.of(load(path / output_folder.EXPERIMENT))
            return _of(path, spec, "unfinished", None, None, _size(path / "data"))
        listed = manifest.read(path)
        state = "unsettled" if os.path.lexists(path / manifest.NEW) else "finished"
        total = sum(file.bytes for file in listed.files)
        return _of(path, spec_in(path, listed), state, listed.rows, listed.content_root, total)
    except IbdataError:
        return Listed(path, "damaged", None, None, [], [], _size(path), None)


def _of(path: Path, spec: DatasetSpec, state: str, rows: int | None, root: str | None, total: int) -> Listed:
    return Listed(path, state, spec.name, rows, setpoints(spec), spec.labels, total, root)


def _size(folder: Path) -> int:
    """The bytes of all files in a folder and below it."""
    places = (os.path.join(place, name) for place, _, names in os.walk(folder) for name in names)
    return sum(os.lstat(place).st_size for place in places if os.path.lexists(place))
