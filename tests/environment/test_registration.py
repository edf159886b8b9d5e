"""The environment registers with Gymnasium on import, with no other side effects."""

from __future__ import annotations

import subprocess
import sys

import pytest

# Stands in for Gymnasium, which the core does not install: what ibdata uses of it.
STAND_IN = """
registry = {}
def register(id, **given):
    assert id not in registry
    registry[id] = given
"""
EXPECTED = {
    "ibdata/IndustrialBenchmark-v0": {
        "entry_point": "ibdata.environment:IndustrialBenchmarkEnv",
        "vector_entry_point": "ibdata.environment:IndustrialBenchmarkVectorEnv",
        "max_episode_steps": 1000,
    }
}


# It is not there, and importing ibdata leaves no trace.
WITHOUT = """
import sys
class Without:
    def find_spec(self, name, path=None, target=None):
        if name == 'gymnasium':
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Without())
before = list(sys.meta_path)
import ibdata, ibdata.environment
assert sys.meta_path == before
try:
    ibdata.environment.IndustrialBenchmarkEnv
except ImportError as error:
    print(error)
"""


@pytest.mark.parametrize(
    ("code", "expected"),
    [
        ("import gymnasium, ibdata; print(gymnasium.registry)", str(EXPECTED)),
        ("import ibdata, gymnasium, ibdata.environment; print(gymnasium.registry)", str(EXPECTED)),
        (
            WITHOUT,
            "ibdata.environment needs the package gymnasium: pip install gymnasium, or 'ibdata[gymnasium]'",
        ),
    ],
    ids=["before", "after", "without"],
)
def test_it_is_registered_once_in_every_order_or_says_what_to_install(tmp_path, code, expected):
    (tmp_path / "gymnasium.py").write_text(STAND_IN)
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True)
    assert (done.stdout.strip(), done.stderr) == (expected, "")
