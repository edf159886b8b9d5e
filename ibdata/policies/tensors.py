"""Files of tensors in the format safetensors, which holds no code."""

from __future__ import annotations

import json
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from safetensors import SafetensorError
from safetensors.numpy import load, save

Tensor = npt.NDArray[np.float32]


def written(tensors: Mapping[str, Tensor], metadata: Mapping[str, str]) -> bytes:
    """The bytes of a file with these tensors and this metadata; the same for the same arguments."""
    data = save(dict(tensors), dict(metadata))
    end = _end_of_header(data)
    header = json.loads(data[8:end])
    header["__metadata__"] = dict(sorted(metadata.items()))  # the library takes another order each time
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + data[end:]


def read(data: bytes) -> tuple[dict[str, Tensor], dict[str, str]]:
    """The tensors of a file and its metadata. ValueError if it is not valid, or not of finite float32."""
    try:
        tensors = load(data)
    except SafetensorError as error:
        raise ValueError(f"found other contents ({error}), expected a safetensors file") from None
    except KeyError as error:  # a type that numpy has not
        raise ValueError(f"found numbers of type {error}, expected float32") from None
    for name, tensor in tensors.items():
        if tensor.dtype != np.float32:
            raise ValueError(f"{name}: found numbers of type {tensor.dtype}, expected float32")
        if not np.isfinite(tensor).all():
            raise ValueError(f"{name}: found NaN or infinity, expected finite numbers")
    return tensors, json.loads(data[8 : _end_of_header(data)]).get("__metadata__", {})


def _end_of_header(data: bytes) -> int:
    return 8 + int.from_bytes(data[:8], "little")
