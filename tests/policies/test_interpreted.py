"""Networks in plain Python: an index that the compiled code would not check is an error there."""

import json
import os

import pytest

import ibdata as package

EXPERIMENT = """
name: x
setpoints: 70
policies:
- {kind: network, file: actor.safetensors}
- {kind: sampled, base: {kind: network, file: actor.safetensors}, share: 0.4}
- {kind: sampled, base: {kind: network, file: actor.safetensors}, share: 1.0, name: drawn}
episodes: 2
steps: 8
"""


@pytest.mark.usefixtures("network_here")
def test_networks_give_the_same_rows_without_the_compiler(ibdata, tmp_path):
    (tmp_path / "x.yaml").write_text(EXPERIMENT)
    done = ibdata(
        "generate", "x.yaml", "--out", "plain", "--json", env=os.environ | {"NUMBA_DISABLE_JIT": "1"}
    )
    assert (done.returncode, done.stderr) == (0, "")
    compiled = package.generate(tmp_path / "x.yaml", tmp_path / "compiled")
    assert json.loads(done.stdout)["content_root"] == compiled.content_root
