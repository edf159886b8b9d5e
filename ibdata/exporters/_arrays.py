"""Writing and comparing several arrays with the same number of rows, block by block."""

from __future__ import annotations

import json
import math
import zipfile
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import IO, Any

import numpy as np

from ibdata.exporters._target import differs
from ibdata.exporters._view import Array, Arrays, Block, View

Form = Callable[[Block], Arrays]
Read = Callable[[str, int], Array]  # the next n rows of an array


def transitions(block: Block) -> Arrays:
    """The arrays of D4RL: one entry per transition in each, and the latent state in infos/."""
    return {
        "observations": block.observations,
        "actions": block.actions,
        "rewards": block.rewards,
        "next_observations": block.next_observations,
        "terminals": block.terminated,
        "timeouts": block.truncated,
        "infos/episode": block.episode,
        "infos/step": block.step,
        **{f"infos/{name}": array for name, array in block.extras.items()},
    }


def write_npz(view: View, form: Form, path: Path, **others: Array) -> None:
    """Write the arrays of a form, and `others` that are short, as an NPZ that is not compressed.

    The members of a ZIP are written one after another, so each array is first written to a file of its own.
    """
    parts: dict[str, Path] = {}
    with ExitStack() as stack:
        files: dict[str, IO[bytes]] = {}
        for block in view.blocks("write"):
            for name, array in form(block).items():
                if name not in files:
                    parts[name] = path.with_name(f"{len(parts)}.npy")
                    files[name] = stack.enter_context(parts[name].open("xb"))
                    _header(files[name], view.rows, array)
                files[name].write(np.ascontiguousarray(array).data)
    with zipfile.ZipFile(path, "x", allowZip64=True) as archive:
        archive.comment = json.dumps(view.plain()).encode()
        for name, part in parts.items():
            archive.write(part, f"{name}.npy")
            part.unlink()
        for name, array in others.items():
            with archive.open(f"{name}.npy", "w") as member:
                np.lib.format.write_array(member, array, allow_pickle=False)


def check_npz(view: View, form: Form, path: Path) -> None:
    """Compare the arrays of an NPZ with the data."""
    with zipfile.ZipFile(path) as archive, ExitStack() as stack:
        members: dict[str, tuple[IO[bytes], tuple[int, ...], np.dtype[Any]]] = {}

        def read(name: str, rows: int) -> Array:
            if name not in members:
                file = stack.enter_context(archive.open(f"{name}.npy"))
                np.lib.format.read_magic(file)
                shape, _, dtype = np.lib.format.read_array_header_1_0(file)
                members[name] = (file, (-1, *shape[1:]), dtype)
            file, shape, dtype = members[name]
            size = rows * dtype.itemsize * math.prod(shape[1:])
            return np.frombuffer(file.read(size), dtype).reshape(shape)

        check(view, form, read, path)


def _header(file: IO[bytes], rows: int, array: Array) -> None:
    """Write the header of a NumPy file with this number of rows, each of the array's type and shape."""
    np.lib.format.write_array_header_1_0(
        file,
        {
            "descr": np.lib.format.dtype_to_descr(array.dtype),
            "fortran_order": False,
            "shape": (rows, *array.shape[1:]),
        },
    )


def check(view: View, form: Form, read: Read, path: Path) -> None:
    """Compare written arrays with the data, value by value. Raises IbdataError if they differ."""
    for block in view.blocks("check"):
        for name, array in form(block).items():
            found = read(name, len(array))
            if found.dtype != array.dtype or found.shape != array.shape or not same(found, array):
                raise differs(f"{path}: {name}")


def same(a: Array, b: Array) -> bool:
    """Whether two arrays hold the same bits, NaN included."""
    return np.ascontiguousarray(a).tobytes() == np.ascontiguousarray(b).tobytes()
