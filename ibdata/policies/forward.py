"""The forward pass of a network in float32, with the same bits on every machine.

Each sum is taken in the order ((b + x₀ w₀) + x₁ w₁) + …, so a result depends neither on the number of lanes
(the episodes side by side) nor on the processor. Loops run over lanes, never over a sum, and are vectorized.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ibdata.numerics.compiled import compiled
from ibdata.numerics.exact import tanh

Float32s = npt.NDArray[np.float32]
Sizes = npt.NDArray[np.int64]

MULTIPLE = 4  # to which the numbers of a layer's inputs and outputs are padded with zeros
BLOCK = 256  # lanes at a time, whose activations stay in the processor's cache


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
        _layer(x, weight, bias, y)
        if layer < sizes.shape[0] - 1:
            _activate(y[:outputs], tanh_inside)
        x, y = y, x
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = x[j, i]


@compiled
def _layer(x: Float32s, w: Float32s, bias: Float32s, out: Float32s) -> None:
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
