"""The weights of an actor network in a safetensors file; docs/networks.md describes the layout.

Weights that a process has read are known by their SHA-256, so that an experiment can be checked again, or be
made of what a dataset lists, without the path from which they came.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import ConfigDict, Field, FiniteFloat, Json

from ibdata.dataset.models import JsonObject, parse
from ibdata.errors import printable
from ibdata.policies import safetensors
from ibdata.policies.base import NormalSingle
from ibdata.policies.forward import Float32s, packed
from ibdata.system.files import plain_bytes

LAYOUT = "ibdata-network-1"
SUFFIX = ".safetensors"
SHIPPED = Path(__file__).parent / "weights"
MAX_BYTES = 2**26
COLUMNS = 6  # of an observation
ACTIONS = 3
TINY, HUGE = (float(x) for x in (np.finfo(np.float32).tiny, np.finfo(np.float32).max))

Layer = tuple[Float32s, Float32s]  # weights (outputs, inputs) and biases (outputs,)
Positive = Annotated[float, Field(ge=TINY, le=HUGE)]


class Metadata(JsonObject):
    """The metadata of a file of weights, which are texts."""

    model_config = ConfigDict(strict=False, allow_inf_nan=False)

    layout: Literal["ibdata-network-1"]
    frames: Annotated[int, Field(ge=1, le=1000)]
    mean: Json[list[Annotated[FiniteFloat, Field(ge=-HUGE, le=HUGE), NormalSingle]]]
    std: Json[list[Positive]]
    clip: Positive = HUGE
    activation: Literal["relu", "tanh"] = "relu"
    squash: Literal["tanh", "clip"]
    log_std: Literal["clamp", "tanh"] = "clamp"
    log_std_low: Annotated[float, Field(ge=-20.0, le=20.0), NormalSingle] = -20.0
    log_std_high: Annotated[float, Field(ge=-20.0, le=20.0), NormalSingle] = 2.0
    provenance: Annotated[str, Field(max_length=10_000)] = ""
    format: str = ""  # written by some libraries


class Weights:
    """The weights of a network and their identity, the SHA-256 of the file.

    Attributes:
        data: the bytes of the file.
        metadata: its metadata.
        has_log_std: whether the outputs are 3 means and 3 log standard deviations, otherwise 3 means.
        mean: subtracted from the inputs, float32 (6 · frames,), newest frame first.
        std: by which they are divided then, float32 (6 · frames,).
        clip: the largest absolute value that they have then.
        sizes: the sizes of the layers, see `forward.packed`.
        parameters: their weights and biases, see `forward.packed`.
    """

    def __init__(self, data: bytes) -> None:
        if len(data) > MAX_BYTES:
            raise ValueError(f"found {len(data)} bytes, expected at most {MAX_BYTES}; use a smaller network")
        tensors, texts = safetensors.read(data)
        self.data, self.sha256 = data, hashlib.sha256(data).hexdigest()
        try:
            self.metadata = parse(Metadata, texts)
        except ValueError as error:
            raise ValueError(f"metadata: {error}") from None
        if self.metadata.log_std_low > self.metadata.log_std_high:
            raise ValueError("metadata: found log_std_low above log_std_high, expected at most the same")
        inputs = COLUMNS * self.metadata.frames
        self.has_log_std = "log_std.bias" in tensors
        self.mean, self.std = (
            _scaling(name, getattr(self.metadata, name), inputs) for name in ("mean", "std")
        )
        self.clip = np.float32(self.metadata.clip)
        self.sizes, self.parameters = packed(_layers(tensors, inputs))

    @property
    def name(self) -> str:
        """The name of the file in a dataset."""
        return name_of(self.sha256)

    def __reduce__(self) -> tuple[Any, tuple[bytes]]:
        return kept, (self.data,)


def name_of(sha256: str) -> str:
    """The name of a file of weights in a dataset.

    >>> name_of("3fa0" * 16)
    'policy-3fa03fa03fa03fa0.safetensors'
    """
    return f"policy-{sha256[:16]}{SUFFIX}"


_known: dict[str, Weights] = {}  # all weights that this process has read, by SHA-256


def kept(data: bytes) -> Weights:
    """The weights that a file holds; the same object for the same bytes.

    From then on, `find` finds them by their SHA-256. Raises ValueError if the file is not valid.
    """
    weights = Weights(data)
    return _known.setdefault(weights.sha256, weights)


def find(file: str, sha256: str | None, folder: Path | None) -> Weights:
    """Find weights by the path of their file, or by a shipped name.

    Args:
        file: a path relative to the folder, the name of shipped weights, or `name_of` weights that this
            process has read before.
        sha256: the SHA-256 that the file must have; None for any.
        folder: the folder; by default the current one.

    Raises:
        ValueError: there is no such file, or it is not valid, or it has another SHA-256.
    """
    if sha256 in _known and file == name_of(sha256):
        return _known[sha256]
    shipped = [path.stem for path in sorted(SHIPPED.glob(f"*{SUFFIX}"))]
    path = (folder or Path()) / file
    if file.removesuffix(SUFFIX) in shipped and not path.is_file():
        path = SHIPPED / f"{file.removesuffix(SUFFIX)}{SUFFIX}"
    try:
        weights = kept(plain_bytes(path, MAX_BYTES))
    except FileNotFoundError:
        where = "beside the YAML file" if folder else "in the current folder"
        names = f" or one of {', '.join(shipped)}" if shipped else ""
        raise ValueError(f"found no file {file!r}, expected one {where}{names}") from None
    except OSError as error:
        raise ValueError(f"{file}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{printable(file)}: {error}") from None
    if sha256 not in (None, weights.sha256):
        raise ValueError(f"{file}: found weights with SHA-256 {weights.sha256}, expected {sha256}")
    return weights


def _scaling(name: str, values: list[float], inputs: int) -> Float32s:
    if len(values) not in (COLUMNS, inputs):
        raise ValueError(f"metadata: {name}: found {len(values)} numbers, expected {COLUMNS} or {inputs}")
    return np.resize(np.array(values, dtype=np.float32), inputs)


def _layers(tensors: Mapping[str, Float32s], inputs: int) -> list[Layer]:
    """Weights and biases from the first to the last layer, which computes means and log deviations.

    Raises ValueError for a tensor with another name or another shape than the layout has.
    """
    left = dict(tensors)
    layers: list[Layer] = []
    width = inputs
    while f"layers.{len(layers)}.weight" in left:
        layers.append(_layer(left, f"layers.{len(layers)}", None, width))
        width = len(layers[-1][1])
    heads = [_layer(left, "mean", ACTIONS, width)]
    if "log_std.bias" in left:
        left.setdefault("log_std.weight", np.zeros((ACTIONS, width), dtype=np.float32))
        heads.append(_layer(left, "log_std", ACTIONS, width))
    if left:
        raise ValueError(f"found the tensor {min(left)}, expected layers.0.weight, mean.bias and so on")
    weights, biases = zip(*heads, strict=True)
    return [*layers, (np.concatenate(weights), np.concatenate(biases))]


def denormal(numbers: Float32s) -> npt.NDArray[np.bool_]:
    """Whether each number is denormal. Its bits are compared, as the processor may take it for 0."""
    size = np.ascontiguousarray(numbers).view(np.uint32) & 0x7FFFFFFF
    return (size > 0) & (size < 0x00800000)


def _layer(left: dict[str, Float32s], name: str, outputs: int | None, inputs: int) -> Layer:
    """Take a layer's weights (outputs, inputs) and biases (outputs,) out of `left`."""
    found = []
    for part, rest in (("weight", (inputs,)), ("bias", ())):
        tensor = left.pop(f"{name}.{part}", None)
        if tensor is None:
            raise ValueError(f"{name}.{part}: missing, expected a tensor of this name")
        outputs = outputs or (tensor.shape or (0,))[0] or 1
        if tensor.shape != (outputs, *rest):
            raise ValueError(f"{name}.{part}: found the shape {tensor.shape}, expected {(outputs, *rest)}")
        if denormal(tensor).any():
            raise ValueError(
                f"{name}.{part}: found a number closer to 0 than {TINY!r}, which some machines take for 0; "
                "expected 0 in its place"
            )
        found.append(tensor)
    return found[0], found[1]
