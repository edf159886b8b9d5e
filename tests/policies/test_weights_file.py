"""Files of weights: what is read, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers import networks
from helpers.networks import Linear, Parameter
from helpers.refusals import refused

from ibdata.policies.save_network import save_network
from ibdata.policies.weights_file import Weights, read, written

GOOD = networks.weights()


def with_header(header):
    """The good file with another header."""
    length = int.from_bytes(GOOD[:8], "little")
    text = json.dumps(header(json.loads(GOOD[8 : 8 + length]))).encode()
    return len(text).to_bytes(8, "little") + text + GOOD[8 + length :]


def with_mean_bias(**options):
    return with_header(lambda plain: {**plain, "mean.bias": {**plain["mean.bias"], **options}})


def without(*names):
    return written({n: x for n, x in networks.tensors().items() if n not in names}, networks.metadata())


def replaced(name, value):
    return written({**networks.tensors(), name: np.asarray(value, dtype=np.float32)}, networks.metadata())


FOREIGN = "found other contents"
WRONG_FILES = {
    "empty": (b"", FOREIGN),
    "truncated": (GOOD[:-1], FOREIGN),
    "huge shape": (with_mean_bias(shape=[2**40, 2**40]), FOREIGN),
    "bfloat16": (with_mean_bias(dtype="BF16", shape=[6]), "found numbers of type 'BF16', expected float32"),
    "int32": (with_mean_bias(dtype="I32"), "mean.bias: found numbers of type int32, expected float32"),
    "NaN": (replaced("mean.bias", [0, np.nan, 0]), "mean.bias: found NaN or infinity"),
    "no metadata": (with_header(lambda p: {k: x for k, x in p.items() if k[0] != "_"}), "layout: missing"),
    "no mean": (without("mean.weight", "mean.bias"), "mean.weight: missing"),
    "no bias": (without("layers.1.bias"), "layers.1.bias: missing"),
    "no layer between": (without("layers.0.weight", "layers.0.bias"), "mean: found weights of shape (3, 5)"),
    "another tensor": (replaced("critic.weight", [1.0]), "found the tensor critic.weight, expected"),
    "four actions": (replaced("mean.bias", [0.0] * 4), "biases of shape (4,), expected (3, 5) and (3,)"),
    "other inputs": (replaced("layers.0.weight", np.zeros((8, 13))), "expected (8, 12) and (8,)"),
    "a number as weights": (replaced("layers.0.weight", 1.0), "found weights of shape () and"),
    "a number as biases": (replaced("layers.0.bias", 1.0), "and biases of shape (), expected (1, 12)"),
}
WRONG_METADATA = {
    "layout": (None, "metadata: layout: missing"),
    "frames": ("0", "metadata: frames: found '0', expected"),
    "mean": ("[1, 2, 3]", "metadata: mean: found 3 numbers, expected 6 or 12"),
    "std": ("[1, 1, 1, 1, 1, 0]", "metadata: std.5: found 0, expected"),
    "clip": ("nan", "metadata: clip: found 'nan', expected"),
    "activation": ("gelu", "metadata: activation: found 'gelu', expected"),
    "squash": ("none", "metadata: squash: found 'none', expected"),
    "unknown": ("1", "metadata: unknown: found '1', expected"),
}


for key, (value, message) in WRONG_METADATA.items():
    WRONG_FILES[key] = (written(networks.tensors(), networks.metadata(**{key: value})), message)


@pytest.mark.parametrize(("content", "message"), WRONG_FILES.values(), ids=WRONG_FILES)
def test_a_wrong_file_is_one_line(content, message):
    with pytest.raises(ValueError, match=r"found|missing") as error:
        Weights(content)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_file_is_read_as_it_was_written():
    """With one scaling for all frames or one for each, and log deviations that do not depend on the state."""
    tensors = networks.tensors()
    del tensors["log_std.weight"]
    metadata = networks.metadata(provenance="text\nof Ünicode", mean=json.dumps([*networks.MEAN] * 2))
    content = written(tensors, metadata)
    assert written(tensors, metadata) == content
    read_tensors, read_metadata = read(content)
    assert read_metadata == metadata
    for name, tensor in tensors.items():
        np.testing.assert_array_equal(read_tensors[name], tensor)
    weights = Weights(content)
    assert weights.has_log_std
    np.testing.assert_array_equal(weights.mean, Weights(GOOD).mean)
    assert weights.mean.shape == weights.std.shape == (12,)


class Scaled(Linear):
    def __call__(self, x):
        return Parameter(0.5 * super().__call__(x).numpy())


class Clamped(Linear):
    def __call__(self, x):
        return super().__call__(Parameter(np.clip(x.numpy(), -5.0, 5.0)))


SMALL = np.full((3, 6), 0.01, dtype=np.float32)


@pytest.mark.parametrize(
    ("model", "options", "most", "line"),
    [
        (Scaled(SMALL), {}, 10**9, r"model: found Scaled, whose actions are up to [01]\.\d"),
        (Clamped(SMALL), {}, 10**9, r"model: found Clamped, whose actions are up to [01]\.\d"),
        (Linear, {}, 10**9, r"model: found type \("),
        (Linear(SMALL), {"mean": "abc"}, 10**9, "mean: found 'abc', expected numbers"),
        (Linear(SMALL), {}, 100, r"model: found \d+ bytes, expected at most 100; use a smaller"),
    ],
    ids=["scaled", "clamped", "a class", "no numbers", "too large"],
)
def test_a_model_that_a_file_cannot_hold_is_refused(tmp_path, monkeypatch, model, options, most, line):
    monkeypatch.setattr("ibdata.policies.weights_file.MAX_BYTES", most)
    refused(f"^{line}", save_network, tmp_path / "actor.safetensors", model, **options)
    assert list(tmp_path.iterdir()) == []
