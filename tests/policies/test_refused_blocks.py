"""Blocks of policies that are refused, in one line with its place."""

from __future__ import annotations

import pytest
from helpers import networks

from ibdata.errors import ConfigError
from ibdata.experiment import load

NO_STEPS = "31: policies.0.stages.0.steps: found none, expected the number of its steps"
NO_TARGET = "28: policies.0.target: found '{}', expected package.module:name, or file.py:name"
TARGETS = ("mine", "mine:Actor()", "../mine:Actor", "os;x:y", "", "/mine.py:Actor", "a/mine.py")
REFUSED = [  # the block, the column, and the message
    ("mixture, bases: [{kind: random}], weights: [1.0, 2.0]",
     "55: policies.0.weights: found 2, expected 1, one for each base"),
    ("mixture, bases: [{kind: random, name: mine}]",
     "50: policies.0.bases.0.name: found 'mine' in a base, expected the name beside the outer kind"),
    ("sticky, base: {kind: mixture, bases: []}, kappa: 0.5",
     "49: policies.0.base.bases: found [], expected at least 1 item"),
    ("schedule, stages: [{base: {kind: bad}}, {base: {kind: random}}]", NO_STEPS),
    ("schedule, stages: [{base: {kind: bad}, epsilon: [1.0, 0.0]}]", NO_STEPS),
    ("sampled, share: 0.0, base: {kind: network, file: p70-3}",
     "28: policies.0.share: found 0.0, expected a number above 0"),
    ("sampled, base: {kind: optimized}, share: 0.5",
     "34: policies.0.base.kind: found 'optimized', expected network"),
    ("sampled, base: {kind: network, file: actor.safetensors}, share: 0.5",
     "27: policies.0.base: found weights without log_std, with which only kind: network works"),
    ("gaussian, base: {kind: random}, scale: 0.1",
     "35: policies.0.base.kind: found 'random', expected a policy that draws nothing: one of bad, "),
    ("gaussian, base: {kind: custom, target: 'a:b'}, scale: 0.1",
     "28: policies.0.base: found custom without deterministic: true, expected a policy that draws nothing"),
    ("network, file: no.safetensors",
     "27: policies.0.file: found no file 'no.safetensors', expected one beside the YAML file or a netw"),
    ("network, file: x.yaml", "27: policies.0.file: x.yaml: found other contents"),
    ("network, file: .", "27: policies.0.file: .: cannot be read: not a regular file"),
    ("network, file: actor.safetensors, sha256: '00'",
     "27: policies.0.file: actor.safetensors: found weights with SHA-256 "),
    ("constant, action: [0.0, 0.0, 1.0000001]",
     "41: policies.0.action.2: found 1.0000001, expected a number of at most 1"),
    ("constant, action: [true, 0, 0]", "31: policies.0.action.0: found true, expected a number"),
    ("multisine, sines: 10, period: 60",
     "42: policies.0.period: found 60, expected more than 60, which is 6 for each of the sines"),
    ("custom, target: 'a:b', deterministic: true, draws: 3",
     "63: policies.0.draws: found 3 and deterministic: true, expected 0, or no such promise"),
    ("custom, target: 'a:b', params: {limit: 1e400, fine: 1e300}",
     "43: policies.0.params: found what JSON cannot hold (Out of range float values"),
    *((f"custom, target: '{target}'", NO_TARGET.format(target)) for target in TARGETS),
]  # fmt: skip


@pytest.mark.parametrize(("block", "line"), REFUSED)
def test_a_wrong_block_is_refused_with_its_place(tmp_path, monkeypatch, block, line):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "actor.safetensors").write_bytes(networks.weights(log_std=False))
    (tmp_path / "x.yaml").write_text(f"name: x\nsetpoints: 70\npolicies:\n  - {{kind: {block}}}\n".ljust(105))
    with pytest.raises(ConfigError) as error:
        load("x.yaml")
    assert str(error.value).startswith(f"x.yaml:4:{line}")
