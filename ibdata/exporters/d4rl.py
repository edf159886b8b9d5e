"""HDF5 with the keys of D4RL: observations, actions, rewards, next_observations, terminals, timeouts, and
infos/… with one entry per row. Metadata are attributes, because D4RL's sequence_dataset expects rows in every
HDF5 dataset. Read the keys yourself: D4RL's qlearning_dataset ignores next_observations and drops the last
row of each episode. Written in constant memory. Needs ibdata[hdf5].
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from ibdata.exporters._arrays import check, compressor, strategy, transitions
from ibdata.exporters._target import needed, reserve
from ibdata.exporters._view import Array, View
from ibdata.version import __version__

CHUNK_ROWS = 4096
HEADER = b"\x78\x01"  # of a zlib stream
SAMPLE = 2048  # values that decide how an array is compressed
STORED = 2**16 - 1  # bytes that a block of DEFLATE holds at most where it stores them
NOISE = 0.97  # of its bytes are left of a plane that is not worth compressing
FILTERS = {"shuffle": True, "compression": "gzip", "compression_opts": 1}
OVERHEAD = 2**20  # bytes per file; 0.37 MB was measured


def export(view: View, path: Path, target: Path) -> str:
    """Write the HDF5 file."""
    h5py = needed("h5py", "d4rl", "hdf5")
    reserve(path, view.bytes + OVERHEAD)
    with h5py.File(path, "x") as file:
        file.attrs["ibdata_version"] = __version__
        file.attrs["name"] = view.dataset.info_model.name
        file.attrs["content_root"] = view.dataset.content_root
        file.attrs["reward_scale"] = view.reward_scale
        file.attrs["history"] = view.history
        _write(view, file)
    return f"""\
import h5py

with h5py.File({str(target)!r}) as file:
    keys = ("observations", "actions", "rewards", "next_observations", "terminals", "timeouts")
    data = {{key: file[key][:] for key in keys}}
"""


def verify(view: View, path: Path) -> None:
    """Compare the file with the data."""
    with needed("h5py", "d4rl", "hdf5").File(path, "r") as file:
        done: dict[str, int] = {}

        def read(name: str, rows: int) -> Array:
            start = done.get(name, 0)
            done[name] = start + rows
            array: Array = file[name][start : start + rows]
            return array

        check(view, transitions, read, path)


def _write(view: View, file: Any) -> None:
    chunked: dict[str, _Chunked] = {}
    for block in view.blocks("write"):
        for name, array in transitions(block).items():
            if name not in chunked:
                shape, chunks = ((n, *array.shape[1:]) for n in (view.rows, min(CHUNK_ROWS, view.rows)))
                chunked[name] = _Chunked(
                    file.create_dataset(name, shape, array.dtype, chunks=chunks, **FILTERS)
                )
            chunked[name].add(array)


class _Chunked:
    """An HDF5 dataset that is written chunk by chunk, filtered here: HDF5 tries to compress noise, too."""

    def __init__(self, dataset: Any) -> None:
        self._dataset, self._rows = dataset, 0
        self._chunk = np.zeros(dataset.chunks, dataset.dtype)
        self._filter: _Filter | None = None

    def add(self, array: Array) -> None:
        """Write the chunks that are full, and the last; whatever lies beyond its rows, nobody reads."""
        size = len(self._chunk)
        for rows in np.split(array, range(size - self._rows % size, len(array), size)):
            start = self._rows % size
            self._chunk[start : start + len(rows)] = rows
            self._rows += len(rows)
            if start + len(rows) == size or self._rows == len(self._dataset):
                self._write((self._rows - 1) // size * size)

    def _write(self, row: int) -> None:
        values = self._chunk.reshape(-1)
        planes = np.ascontiguousarray(values.view(np.uint8).reshape(-1, values.itemsize).T)
        self._filter = self._filter or _Filter(planes[:, :SAMPLE])
        place = (row, *(0 for _ in self._chunk.shape[1:]))
        self._dataset.id.write_direct_chunk(place, self._filter(planes))


class _Filter:
    """HDF5's filter gzip for planes of bytes, which its filter shuffle makes: first bytes, second bytes …

    The first planes are stored as they are if those of the sample hardly become smaller: the low digits.
    """

    def __init__(self, sample: Array) -> None:
        self._strategy = strategy(sample.tobytes())
        noise = [len(self._compressed(plane.tobytes())) > NOISE * len(plane) for plane in sample]
        self._stored = [*noise, False].index(False)

    def __call__(self, planes: Array) -> bytes:
        data, cut = planes.tobytes(), self._stored * planes.shape[1]
        return (
            HEADER
            + _stored(data[:cut])
            + self._compressed(data[cut:])
            + zlib.adler32(data).to_bytes(4, "big")
        )

    def _compressed(self, data: bytes) -> bytes:
        own = compressor(self._strategy)
        return own.compress(data) + own.flush()


def _stored(data: bytes) -> bytes:
    """Bytes as they are, in blocks of DEFLATE."""
    blocks = (data[start : start + STORED] for start in range(0, len(data), STORED))
    return b"".join(struct.pack("<BHH", 0, len(block), STORED - len(block)) + block for block in blocks)
