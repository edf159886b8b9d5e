"""Writing HDF5, which crashes when a write fails, or goes on: so what was written is read back."""

from __future__ import annotations

import errno
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from ibdata.exporters._view import Array
from ibdata.system import files

ROWS = 100_000  # that are read back at a time

Sums = dict[str, int]  # CRC-32 of the values of each dataset, by its path in the file


def reserve(path: Path, size: int) -> None:
    """Raise OSError unless there is room for this number of bytes.

    When a write fails, HDF5 ends the process with a segmentation fault (h5py 3.16), without a message.
    """
    with path.open("xb") as file:
        files.reserve(file.fileno(), size)
    path.unlink()


def add(sums: Sums, name: str, values: Array) -> None:
    """Count values that are written to the end of a dataset."""
    sums[name] = zlib.crc32(np.ascontiguousarray(values).data, sums.get(name, 0))


@contextmanager
def read_back(path: Path) -> Iterator[Sums]:
    """Yield the sums that the block fills. Raises OSError if the file then holds other values."""
    written: Sums = {}
    try:
        yield written
        whole = _found(path, written) == written
    except (KeyError, RuntimeError):  # whatever h5py raises for what the system refused
        whole = False
    if not whole:
        raise OSError(errno.EIO, "HDF5 has lost what it wrote")


def _found(path: Path, names: Sums) -> Sums:
    import h5py

    found: Sums = {}
    with h5py.File(path) as file:
        for name in names:
            data = file[name]
            places = [slice(i, i + ROWS) for i in range(0, len(data), ROWS)] if data.shape else [()]
            for place in places:
                add(found, name, data[place])
    return found
