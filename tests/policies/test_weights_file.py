"""Files of weights: what is read, and what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from helpers import networks

from ibdata.errors import UsageError
from ibdata.policies.safetensors import read, written
from ibdata.policies.save_network import save_network
from ibdata.policies.weights_file import Weights

GOOD = networks.weights()


def changed(header, rest=None):
    """The good file with another header."""
    length = int.from_bytes(GOOD[:8], "little")
    plain = json.loads(GOOD[8 : 8 + length])
    text = header(plain) if callable(header) else header
    text = text if isinstance(text, bytes) else json.dumps(text).encode()
    return len(text).to_bytes(8, "little") + text + (GOOD[8 + length :] if rest is None else rest)


def with_tensor(**options):
    return lambda plain: {**plain, "mean.bias": {**plain["mean.bias"], **options}}


def without(*names):
    return written(
        {name: x for name, x in networks.tensors().items() if name not in names}, networks.metadata()
    )


def replaced(name, value):
    return written({**networks.tensors(), name: np.asarray(value, dtype=np.float32)}, networks.metadata())


WRONG_BYTES = {
    "empty": (b"", "found 0 bytes"),
    "short": (GOOD[:7], "found 7 bytes"),
    "truncated": (GOOD[:-1], "bytes of numbers, expected"),
    "longer": (GOOD + b"\0", "bytes of numbers, expected"),
    "huge header": (b"\xff" * 8 + GOOD[8:], "that begin with the length 18446744073709551615 of a header"),
    "header beyond the file": (
        (10**6).to_bytes(8, "little") + GOOD[8:],
        "that begin with the length 1000000",
    ),
    "no JSON": (changed(b"\x00\x01"), "found a header that is not valid"),
    "deep JSON": (changed(b"[" * 100_000), "found a header that is not valid"),
    "a list": (changed(b"[]"), "found a header that is not valid"),
    "a name twice": (changed(b'{"a": 1, "a": 1}'), "found a header that is not valid"),
    "no shape": (changed(lambda p: {**p, "mean.bias": {"dtype": "F32"}}), "found a header that is not valid"),
    "negative shape": (changed(with_tensor(shape=[-3])), "found a header that is not valid"),
    "fractional shape": (changed(with_tensor(shape=[3.0])), "found a header that is not valid"),
    "huge shape": (changed(with_tensor(shape=[2**40, 2**40])), "expected "),
    "double": (changed(with_tensor(dtype="F64")), "found numbers of type F64, expected F32"),
    "three offsets": (changed(with_tensor(data_offsets=[0, 12, 24])), "found a header that is not valid"),
    "overlap": (changed(with_tensor(data_offsets=[0, 12])), "found the bytes 0 to 384, expected 12 to 396"),
    "reversed": (changed(with_tensor(data_offsets=[12, 0])), "found the bytes 12 to 0, expected "),
    "beyond the end": (changed(with_tensor(data_offsets=[2**40, 2**40 + 12])), "expected "),
    "no text in metadata": (changed(lambda p: {**p, "__metadata__": {"a": 1}}), "header that is not valid"),
    "NaN": (replaced("mean.bias", [0, np.nan, 0]), "mean.bias: found NaN or infinity"),
    "infinity": (replaced("layers.1.bias", [np.inf] * 5), "layers.1.bias: found NaN or infinity"),
    "denormal": (
        replaced("mean.weight", np.full((3, 5), -1e-42)),
        "mean.weight: found a number closer to 0 than",
    ),
    "a denormal bias": (
        replaced("log_std.bias", [0, 1e-38, 0]),
        "log_std.bias: found a number closer to 0 than",
    ),
    "no mean": (without("mean.weight", "mean.bias"), "mean.weight: missing"),
    "no bias": (without("layers.1.bias"), "layers.1.bias: missing"),
    "no layer between": (without("layers.0.weight", "layers.0.bias"), "mean.weight: found the shape (3, 5)"),
    "another tensor": (replaced("critic.weight", [1.0]), "found the tensor critic.weight, expected"),
    "four actions": (replaced("mean.bias", [0.0] * 4), "mean.bias: found the shape (4,), expected (3,)"),
    "other inputs": (replaced("layers.0.weight", np.zeros((8, 13))), "expected (8, 12)"),
    "a number as weights": (replaced("layers.0.weight", 1.0), "found the shape (), expected (1, 12)"),
    "no output": (
        replaced("layers.0.weight", np.zeros((0, 12))),
        "found the shape (0, 12), expected (1, 12)",
    ),
}
WRONG_METADATA = {
    "layout": (None, "metadata: layout: missing"),
    "frames": ("0", "metadata: frames: found '0', expected"),
    "mean": ("[1, 2, 3]", "metadata: mean: found 3 numbers, expected 6 or 12"),
    "std": ("[1, 1, 1, 1, 1, 0]", "metadata: std.5: found 0, expected"),
    "clip": ("nan", "metadata: clip: found 'nan', expected"),
    "activation": ("gelu", "metadata: activation: found 'gelu', expected"),
    "squash": ("none", "metadata: squash: found 'none', expected"),
    "log_std_high": ("-21", "metadata: log_std_high: found '-21', expected"),
    "log_std_low": ("3", "metadata: found log_std_low above log_std_high"),
    "unknown": ("1", "metadata: unknown: found '1', expected"),
}


def test_a_file_is_read_as_it_was_written():
    tensors, metadata = networks.tensors(), networks.metadata(provenance="text\nof Ünicode")
    read_tensors, read_metadata = read(written(tensors, metadata))
    assert read_metadata == metadata
    assert list(read_tensors) == list(tensors)
    for name, tensor in tensors.items():
        np.testing.assert_array_equal(read_tensors[name], tensor)


@pytest.mark.parametrize("data", WRONG_BYTES.values(), ids=list(WRONG_BYTES))
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


@pytest.mark.parametrize(
    ("key", "value"),
    [("mean", "[0, 1e-42, 0, 0, 0, 0]"), ("log_std_low", "-1e-42"), ("log_std_high", "1e-42")],
)
def test_denormal_metadata_are_one_line(key, value):
    with pytest.raises(
        ValueError, match=rf"^metadata: {key}.*: found -?1e-42, which some machines take for 0"
    ):
        Weights(written(networks.tensors(), {**networks.metadata(), key: value}))


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


def test_denormal_weights_of_a_trained_network_are_saved_as_0(tmp_path):
    weight = np.full((3, 6), -1e-42, dtype=np.float32)
    weight[0, 0] = 1.5
    save_network(tmp_path / "actor.safetensors", Linear(weight))
    tensors, _ = read((tmp_path / "actor.safetensors").read_bytes())
    assert tensors["mean.weight"].ravel().tolist() == [1.5, *[0.0] * 17]


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


@pytest.mark.parametrize("end", range(0, len(GOOD), 97))
def test_a_file_cut_anywhere_is_refused(end):
    with pytest.raises(ValueError, match="found"):
        Weights(GOOD[:end])


def test_a_scaling_may_name_every_input():
    twelve = Weights(networks.weights(mean=json.dumps([*networks.MEAN, *networks.MEAN])))
    np.testing.assert_array_equal(twelve.mean, Weights(GOOD).mean)
    assert twelve.mean.shape == twelve.std.shape == (12,)


def test_log_deviations_may_be_the_same_in_every_state():
    tensors = networks.tensors()
    del tensors["log_std.weight"]
    assert Weights(written(tensors, networks.metadata())).has_log_std
