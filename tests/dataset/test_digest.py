"""Digests and content roots depend on the values, not on the files, and differ if any value differs."""

import pytest

import ibdata

# ibdata generate --config random.yaml --set steps=3 --set episodes=2 --seed 5 --out golden
# made by ibdata 0.1.0 at commit a995b53 on x86-64; the same on every machine, for ever
GOLDEN = "eca6844419622e0ead4ff2102eaba311afe943ea615e842a8989bb2e868c1c35"
NEXT = {"latent": "next"}


def test_a_golden_dataset_keeps_its_content_root(tmp_path):
    overrides = ["steps=3", "episodes=2"]
    made = ibdata.generate("random.yaml", tmp_path / "golden", overrides=overrides, seed=5, workers=1)
    assert made.content_root == GOLDEN


def test_the_root_is_that_of_a_plain_implementation(either, plain_root):
    """tests/generation/test_layout.py compares the digests."""
    assert plain_root(either, either.table()) == either.content_root


QUIET = [{"kind": "random"}, {"kind": "safe", "name": "quiet"}]
SAME = [
    {"output": {**NEXT, "shard_rows": 1}},
    {"name": "turned", "setpoints": [70.0, 20.0], "output": NEXT},
]
OTHERS = [{"policies": QUIET}, {"output": {"latent": "full"}}, {"output": {**NEXT, "dtype": "float64"}}]


@pytest.mark.parametrize(("change", "same"), [*((c, True) for c in SAME), *((c, False) for c in OTHERS)])
def test_the_same_content_has_the_same_root_and_other_content_another(
    describe, dataset, tmp_path, change, same
):
    made = ibdata.generate(describe(**{"output": NEXT, **change}), tmp_path / "x", workers=1)
    assert (made.content_root == dataset.content_root) == same
