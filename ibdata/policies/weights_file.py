"""The weights of an actor network in a safetensors file, and its forward pass with the same bits everywhere.

The page "Learned policies" describes the layout. Each sum of the forward pass is taken in the order
((b + x₀ w₀) + x₁ w₁) + …, in float32, so a result depends neither on the number of lanes (the episodes side
by side) nor on the processor. Loops run over lanes, never over a sum, and are vectorized.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import BaseModel, ConfigDict, Field, Json, ValidationError
from safetensors import SafetensorError
from safetensors.numpy import load, save

from ibdata._numerics.arrays import Float32s
from ibdata._numerics.compiled import compiled
from ibdata._numerics.exact import tanh
from ibdata._system.files import plain_bytes
from ibdata.errors import printable, suggestion
from ibdata.policies.base import OBSERVATION

Sizes = npt.NDArray[np.int64]


def written(tensors: Mapping[str, Float32s], metadata: Mapping[str, str]) -> bytes:
    """The bytes of a file with these tensors and this metadata; the same for the same arguments."""
    data = save(dict(tensors), dict(metadata))
    end = _end_of_header(data)
    header = json.loads(data[8:end])
    header["__metadata__"] = dict(sorted(metadata.items()))  # the library takes another order each time
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    return len(text).to_bytes(8, "little") + text + data[end:]


def read(data: bytes) -> tuple[dict[str, Float32s], dict[str, str]]:
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


NETWORK_LAYOUT = "ibdata-network-1"
SUFFIX = ".safetensors"
SHIPPED = Path(__file__).parent / "weights"
MAX_BYTES = 2**26
COLUMNS = len(OBSERVATION)
ACTION_COUNT = 3
SHA256 = "^[0-9a-f]{64}$"

Layer = tuple[Float32s, Float32s]  # weights (outputs, inputs) and biases (outputs,)
Positive = Annotated[float, Field(gt=0.0)]


class Metadata(BaseModel):
    """The metadata of a file of weights, which are texts."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    layout: Literal["ibdata-network-1"]
    frames: Annotated[int, Field(ge=1, le=1000)]
    mean: Json[list[float]]
    std: Json[list[Positive]]
    clip: Positive = float(np.finfo(np.float32).max)
    activation: Literal["relu", "tanh"] = "relu"
    squash: Literal["tanh", "clip"]
    log_std: Literal["clamp", "tanh"] = "clamp"
    log_std_low: float = -20.0
    log_std_high: float = 2.0
    provenance: str = ""
    format: str = ""  # written by some libraries


class Weights:
    """The weights of a network and their identity, the SHA-256 of the file.

    Attributes:
        data: the bytes of the file.
        file: its name, without the folder.
        metadata: its metadata.
        has_log_std: whether the outputs are 3 means and 3 log standard deviations, otherwise 3 means.
        mean: subtracted from the inputs, float32 (6 · frames,), newest frame first.
        std: by which they are divided then, float32 (6 · frames,).
        clip: the largest absolute value that they have then.
        sizes: the sizes of the layers, see `forward.packed`.
        parameters: their weights and biases, see `forward.packed`.
    """

    def __init__(self, data: bytes, file: str = "") -> None:
        if len(data) > MAX_BYTES:
            raise ValueError(f"found {len(data)} bytes, expected at most {MAX_BYTES}; use a smaller network")
        tensors, texts = read(data)
        self.data, self.sha256 = data, hashlib.sha256(data).hexdigest()
        self.file = file or self.name
        self.metadata = _metadata(texts)
        inputs = COLUMNS * self.metadata.frames
        self.has_log_std = "log_std.bias" in tensors
        self.mean = _scaling("mean", self.metadata.mean, inputs)
        self.std = _scaling("std", self.metadata.std, inputs)
        self.clip = np.float32(self.metadata.clip)
        self.sizes, self.parameters = packed(_layers(tensors, inputs))

    @property
    def name(self) -> str:
        """The name of the file in a dataset."""
        return name_in_dataset(self.sha256)

    def outputs(self, seen: Float32s, is_scaled: bool = False) -> Float32s:
        """The outputs of the last layer, float32 (n, 3 or 6), for what the network sees, (n, 6 · frames)."""
        out = np.empty((len(seen), 6 if self.has_log_std else 3), dtype=np.float32)
        widest = max(int(self.sizes.max()), seen.shape[1])
        for first in range(0, len(seen), AT_ONCE):
            some = seen[first : first + AT_ONCE]
            x = np.zeros((widest, len(some)), dtype=np.float32)
            if is_scaled:
                x[: some.shape[1]] = some.T
            else:
                scale(some, self.mean, self.std, self.clip, x)
            into = out[first : first + AT_ONCE]
            forward(x, self.sizes, self.parameters, self.metadata.activation == "tanh", into)
        return out

    def __reduce__(self) -> tuple[Any, tuple[bytes, str]]:
        return Weights, (self.data, self.file)


def name_in_dataset(sha256: str) -> str:
    """The name of a file of weights in a dataset.

    >>> name_in_dataset("3fa0" * 16)
    'policy-3fa03fa03fa03fa0.safetensors'
    """
    return f"policy-{sha256[:16]}{SUFFIX}"


def shipped_names() -> list[str]:
    """The names of the networks that come with ibdata."""
    return sorted(path.stem for path in SHIPPED.glob(f"*{SUFFIX}"))


def weights_at(file: str, sha256: str | None, folder: Path | None, known: dict[str, Weights]) -> Weights:
    """The weights of a file in a folder, of a shipped name, or those of the known ones with this name.

    Those that are found are `known` by their SHA-256 from then on. Raises ValueError if there is no such
    file, or it is not valid, or has another SHA-256 than is given.
    """
    for weights in known.values():
        if file == weights.name and sha256 in (None, weights.sha256):
            return weights
    name, shipped = file.removesuffix(SUFFIX), shipped_names()
    path = (folder or Path()) / os.path.expanduser(file)
    if name in shipped and not path.is_file():
        path = SHIPPED / f"{name}{SUFFIX}"
    try:
        weights = Weights(plain_bytes(path, MAX_BYTES), path.name)
    except FileNotFoundError:
        where = "beside the YAML file" if folder else "in the current folder"
        hint = suggestion(name, shipped) or " or a network that ibdata config policies lists"
        if sha256 is not None and file == name_in_dataset(sha256):
            hint = "; give the experiment itself, or copy the file from meta/ of its dataset"
        raise ValueError(f"found no file {file!r}, expected one {where}{hint}") from None
    except OSError as error:
        raise ValueError(f"{file}: cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ValueError(f"{printable(file)}: {error}") from None
    if sha256 not in (None, weights.sha256):
        raise ValueError(f"{file}: found weights with SHA-256 {weights.sha256}, expected {sha256}")
    return known.setdefault(weights.sha256, weights)


def _metadata(texts: Mapping[str, str]) -> Metadata:
    try:
        return Metadata.model_validate(texts)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        value = printable(f"found {first['input']!r}")[:60]
        problem = "missing" if first["type"] == "missing" else f"{value}, expected {first['msg']}"
        raise ValueError(f"metadata: {'.'.join(map(str, first['loc']))}: {problem}") from None


def _scaling(name: str, values: list[float], inputs: int) -> Float32s:
    if len(values) not in (COLUMNS, inputs):
        raise ValueError(f"metadata: {name}: found {len(values)} numbers, expected {COLUMNS} or {inputs}")
    return np.resize(np.array(values, dtype=np.float32), inputs)


def _layers(tensors: Mapping[str, Float32s], inputs: int) -> list[Layer]:
    """Weights and biases from the first to the last layer, which computes means and log deviations."""
    left, width = dict(tensors), inputs
    layers: list[Layer] = []
    while f"layers.{len(layers)}.weight" in left:
        layers.append(_layer(left, f"layers.{len(layers)}", width))
        width = len(layers[-1][1])
    heads = [_layer(left, "mean", width, ACTION_COUNT)]
    if "log_std.bias" in left:
        left.setdefault("log_std.weight", np.zeros((ACTION_COUNT, width), dtype=np.float32))
        heads.append(_layer(left, "log_std", width, ACTION_COUNT))
    if left:
        raise ValueError(f"found the tensor {min(left)}, expected layers.0.weight, mean.bias and so on")
    weights, biases = zip(*heads, strict=True)
    return [*layers, (np.concatenate(weights), np.concatenate(biases))]


def _layer(left: dict[str, Float32s], name: str, inputs: int, outputs: int | None = None) -> Layer:
    """Move a layer's weights (outputs, inputs) and biases (outputs,) out of `left`."""
    for part in ("weight", "bias"):
        if f"{name}.{part}" not in left:
            raise ValueError(f"{name}.{part}: missing, expected a tensor of this name")
    weight, bias = left.pop(f"{name}.weight"), left.pop(f"{name}.bias")
    outputs = outputs or bias.size
    if weight.shape != (outputs, inputs) or bias.shape != (outputs,):
        raise ValueError(
            f"{name}: found weights of shape {weight.shape} and biases of shape {bias.shape}, expected "
            f"{(outputs, inputs)} and {(outputs,)}"
        )
    return weight, bias


MULTIPLE = 4  # to which the numbers of a layer's inputs and outputs are padded with zeros
AT_ONCE = 256  # lanes at a time, whose activations stay in the processor's cache


def packed(layers: list[tuple[Float32s, Float32s]]) -> tuple[Sizes, Float32s]:
    """The padded sizes (outputs, inputs) of all layers, and in one array the biases and weights of each."""
    sizes, flat = [], []
    for weight, bias in layers:
        outputs, inputs = (-(-n // MULTIPLE) * MULTIPLE for n in weight.shape)
        padded = np.zeros((outputs, 1 + inputs), dtype=np.float32)
        padded[: len(bias), 0] = bias
        padded[: len(bias), 1 : 1 + weight.shape[1]] = weight
        sizes.append((outputs, inputs))
        flat += [padded[:, 0], padded[:, 1:].ravel()]
    return np.array(sizes, dtype=np.int64), np.concatenate(flat)


@compiled
def scale(seen: Float32s, mean: Float32s, std: Float32s, clip: np.float32, out: Float32s) -> None:
    """Write the inputs clip((seen - mean) / std) of a network (inputs, n) into the first rows of out."""
    for j in range(seen.shape[1]):
        for i in range(seen.shape[0]):
            out[j, i] = seen[i, j]
        for i in range(seen.shape[0]):
            z = (out[j, i] - mean[j]) / std[j]
            out[j, i] = clip if z > clip else -clip if z < -clip else z


@compiled
def forward(x: Float32s, sizes: Sizes, parameters: Float32s, tanh_inside: bool, out: Float32s) -> None:
    """Write the outputs (n, outputs) of the last layer, from sizes and parameters as `packed` gives them.

    The inputs x (widest, n), with room for the outputs of any layer, are overwritten. Hidden layers end in
    tanh, or otherwise in max(0, x).
    """
    y = np.zeros_like(x)
    at = 0
    for layer in range(sizes.shape[0]):
        outputs, inputs = sizes[layer, 0], sizes[layer, 1]
        bias = parameters[at : at + outputs]
        weight = parameters[at + outputs : at + outputs + outputs * inputs].reshape(outputs, inputs)
        at += outputs + outputs * inputs
        _dense(x, weight, bias, y)
        if layer < sizes.shape[0] - 1:
            _activate(y[:outputs], tanh_inside)
        x, y = y, x
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = x[j, i]


@compiled
def _dense(x: Float32s, w: Float32s, bias: Float32s, out: Float32s) -> None:
    """Write bias + w x (outputs, n) into the first rows of out: four outputs and four inputs at a time."""
    for o in range(0, w.shape[0], MULTIPLE):
        y0, y1, y2, y3 = out[o], out[o + 1], out[o + 2], out[o + 3]
        for i in range(x.shape[1]):
            y0[i], y1[i], y2[i], y3[i] = bias[o], bias[o + 1], bias[o + 2], bias[o + 3]
        for k in range(0, w.shape[1], MULTIPLE):
            x0, x1, x2, x3 = x[k], x[k + 1], x[k + 2], x[k + 3]
            a0, a1, a2, a3 = w[o, k], w[o, k + 1], w[o, k + 2], w[o, k + 3]
            b0, b1, b2, b3 = w[o + 1, k], w[o + 1, k + 1], w[o + 1, k + 2], w[o + 1, k + 3]
            c0, c1, c2, c3 = w[o + 2, k], w[o + 2, k + 1], w[o + 2, k + 2], w[o + 2, k + 3]
            d0, d1, d2, d3 = w[o + 3, k], w[o + 3, k + 1], w[o + 3, k + 2], w[o + 3, k + 3]
            for i in range(x.shape[1]):
                y0[i] = (((y0[i] + x0[i] * a0) + x1[i] * a1) + x2[i] * a2) + x3[i] * a3
                y1[i] = (((y1[i] + x0[i] * b0) + x1[i] * b1) + x2[i] * b2) + x3[i] * b3
                y2[i] = (((y2[i] + x0[i] * c0) + x1[i] * c1) + x2[i] * c2) + x3[i] * c3
                y3[i] = (((y3[i] + x0[i] * d0) + x1[i] * d1) + x2[i] * d2) + x3[i] * d3


@compiled
def _activate(x: Float32s, tanh_inside: bool) -> None:
    """Apply tanh, or max(0, x), in place."""
    for o in range(x.shape[0]):
        for i in range(x.shape[1]):
            if tanh_inside:
                x[o, i] = np.float32(tanh(np.float64(x[o, i])))
            else:
                x[o, i] = x[o, i] if x[o, i] > 0.0 else np.float32(0.0)
