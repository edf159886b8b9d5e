"""Reading and writing files in the format safetensors, which holds no code.

Such a file is 8 bytes with the length of a header, the header in JSON, and the numbers of all tensors one
after the other. Source: github.com/huggingface/safetensors, README.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

Tensors = Mapping[str, npt.NDArray[np.float32]]

MAX_HEADER = 2**20  # bytes


def written(tensors: Tensors, metadata: Mapping[str, str]) -> bytes:
    """The bytes of a file with these tensors and this metadata; the same for the same arguments."""
    header: dict[str, Any] = {"__metadata__": dict(metadata)}
    at = 0
    for name, tensor in tensors.items():
        header[name] = {"dtype": "F32", "shape": tensor.shape, "data_offsets": [at, at + tensor.nbytes]}
        at += tensor.nbytes
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    numbers = (np.ascontiguousarray(tensor, dtype="<f4").tobytes() for tensor in tensors.values())
    return b"".join([len(text).to_bytes(8, "little"), text, *numbers])


def read(data: bytes) -> tuple[dict[str, npt.NDArray[np.float32]], dict[str, str]]:
    """Read the tensors of a file and its metadata.

    Raises ValueError unless the file is valid and its tensors are float32 and finite. No number is read
    before all sizes are checked.
    """
    length = int.from_bytes(data[:8], "little")
    if len(data) < 8 or length > min(MAX_HEADER, len(data) - 8):
        found = f"{len(data)} bytes that begin with the length {length} of a header"
        raise ValueError(f"found {found}, expected a safetensors file")
    places, metadata = _header(data[8 : 8 + length])
    rest = memoryview(data)[8 + length :]
    at = 0
    for name, (shape, begin, end) in sorted(places.items(), key=lambda item: item[1][1:]):
        if (begin, end) != (at, at + 4 * math.prod(shape)):
            raise ValueError(
                f"{name}: found the bytes {begin} to {end}, expected {at} to {at + 4 * math.prod(shape)}"
            )
        at = end
    if at != len(rest):
        raise ValueError(f"found {len(rest)} bytes of numbers, expected {at}")
    tensors = {
        name: np.frombuffer(rest[begin:end], dtype="<f4").astype(np.float32).reshape(shape)
        for name, (shape, begin, end) in places.items()
    }
    for name, tensor in tensors.items():
        if not np.isfinite(tensor).all():
            raise ValueError(f"{name}: found NaN or infinity, expected finite numbers")
    return tensors, metadata


def _header(text: bytes) -> tuple[dict[str, tuple[list[int], int, int]], dict[str, str]]:
    """Shape, first byte and end of each tensor, and the metadata."""
    try:
        header = json.loads(text, object_pairs_hook=_once)
        metadata = header.pop("__metadata__", {})
        if not all(isinstance(value, str) for value in metadata.values()):
            raise TypeError
        places = {name: (tensor["shape"], *tensor["data_offsets"]) for name, tensor in header.items()}
        others = {tensor["dtype"] for tensor in header.values()} - {"F32"}
        if not all(_whole([*shape, begin, end]) for shape, begin, end in places.values()):
            raise TypeError
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise ValueError("found a header that is not valid, expected a safetensors file") from None
    if others:
        raise ValueError(f"found numbers of type {str(min(others))[:20]}, expected F32 (float32)")
    return places, metadata


def _whole(numbers: list[Any]) -> bool:
    return all(type(n) is int and 0 <= n < 2**48 for n in numbers)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """The object of these pairs. Raises ValueError if a key occurs twice."""
    if len({key for key, _ in pairs}) < len(pairs):
        raise ValueError
    return dict(pairs)
