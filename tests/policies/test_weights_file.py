"""Files of weights: what is read, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers import networks

from ibdata.errors import UsageError
from ibdata.policies.save_network import save_network
from ibdata.policies.tensors import read, written
from ibdata.policies.weights_file import Weights

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
    "YAML": (b"name: x\nsetpoints: 70\n", FOREIGN),
    "truncated": (GOOD[:-1], FOREIGN),
    "longer": (GOOD + b"\0", FOREIGN),
    "a list": (with_header(lambda plain: []), FOREIGN),
    "huge shape": (with_mean_bias(shape=[2**40, 2**40]), FOREIGN),
    "double": (with_mean_bias(dtype="F64", shape=[1], data_offsets=[0, 8]), FOREIGN),
    "bfloat16": (with_mean_bias(dtype="BF16", shape=[6]), "found numbers of type 'BF16', expected float32"),
    "int32": (with_mean_bias(dtype="I32"), "mean.bias: found numbers of type int32, expected float32"),
    "NaN": (replaced("mean.bias", [0, np.nan, 0]), "mean.bias: found NaN or infinity"),
    "infinity": (replaced("layers.1.bias", [np.inf] * 5), "layers.1.bias: found NaN or infinity"),
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


def test_a_file_is_read_as_it_was_written():
    tensors, metadata = networks.tensors(), networks.metadata(provenance="text\nof Ünicode")
    read_tensors, read_metadata = read(written(tensors, metadata))
    assert read_metadata == metadata
    assert set(read_tensors) == set(tensors)
    for name, tensor in tensors.items():
        np.testing.assert_array_equal(read_tensors[name], tensor)


def test_the_same_weights_are_the_same_bytes():
    assert {networks.weights(provenance="x") for _ in range(20)} == {networks.weights(provenance="x")}


@pytest.mark.parametrize("data", WRONG_FILES.values(), ids=list(WRONG_FILES))
def test_a_damaged_file_is_one_line(data):
    content, message = data
    with pytest.raises(ValueError, match=r"found|missing") as error:
        Weights(content)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("key", WRONG_METADATA)
def test_wrong_metadata_are_one_line(key):
    value, message = WRONG_METADATA[key]
    texts = {name: text for name, text in {**networks.metadata(), key: value}.items() if text is not None}
    with pytest.raises(ValueError, match="metadata: ") as error:
        Weights(written(networks.tensors(), texts))
    assert message in str(error.value)
    assert "\n" not in str(error.value)


class Linear:
    """A module as torch has them, of which a network is saved."""

    def __init__(self, weight):
        self.weight, self.bias = (Parameter(x) for x in (weight, np.zeros(len(weight), dtype=np.float32)))

    def named_modules(self, remove_duplicate=True):
        return [("", self)]

    def children(self):
        return []

    def __call__(self, x):
        return Parameter(x.numpy() @ self.weight.numpy().T)

    training = False

    def train(self, on):
        pass


class Scaled(Linear):
    def __call__(self, x):
        return Parameter(0.5 * super().__call__(x).numpy())


class Clamped(Linear):
    def __call__(self, x):
        return super().__call__(Parameter(np.clip(x.numpy(), -5.0, 5.0)))


class Parameter:
    def __init__(self, numbers):
        self.numpy = lambda: numbers

    def new_tensor(self, numbers):
        return Parameter(numbers)

    def detach(self):
        return self

    cpu = detach


@pytest.mark.parametrize("model", [Scaled, Clamped])
def test_a_model_that_does_more_than_its_layers_is_refused(tmp_path, model):
    with pytest.raises(
        UsageError, match=rf"^model: found {model.__name__}, whose actions are up to [01]\.\d"
    ):
        save_network(tmp_path / "actor.safetensors", model(np.full((3, 6), 0.01, dtype=np.float32)))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("model", "options", "line"),
    [
        (Linear, {}, "model: found type ("),
        (Linear(np.zeros((3, 6), dtype=np.float32)), {"mean": "abc"}, "mean: found 'abc', expected numbers"),
    ],
)
def test_what_is_no_model_and_no_scaling_is_one_line(tmp_path, model, options, line):
    with pytest.raises(UsageError) as error:
        save_network(tmp_path / "actor.safetensors", model, **options)
    assert str(error.value).startswith(line)
    assert list(tmp_path.iterdir()) == []


def test_a_network_too_large_to_be_read_is_not_written(tmp_path, monkeypatch):
    monkeypatch.setattr("ibdata.policies.weights_file.MAX_BYTES", 100)
    with pytest.raises(UsageError, match=r"^model: found \d+ bytes, expected at most 100; use a smaller"):
        save_network(tmp_path / "actor.safetensors", Linear(np.full((3, 6), 0.01, dtype=np.float32)))
    assert list(tmp_path.iterdir()) == []


def test_a_model_that_clips_its_inputs_as_the_file_says_is_saved(tmp_path):
    model = Clamped(np.full((3, 6), 0.01, dtype=np.float32))
    assert save_network(tmp_path / "actor.safetensors", model, clip=5.0)


def test_a_scaling_may_name_every_input():
    twelve = Weights(networks.weights(mean=json.dumps([*networks.MEAN, *networks.MEAN])))
    np.testing.assert_array_equal(twelve.mean, Weights(GOOD).mean)
    assert twelve.mean.shape == twelve.std.shape == (12,)


def test_log_deviations_may_be_the_same_in_every_state():
    tensors = networks.tensors()
    del tensors["log_std.weight"]
    assert Weights(written(tensors, networks.metadata())).has_log_std
