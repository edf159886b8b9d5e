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


def said(tmp_path, code: str) -> str:
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r})\n{code}"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize("order", ["gymnasium, ibdata", "ibdata, gymnasium, ibdata.environment"])
def test_the_environment_is_registered_once_in_every_order(tmp_path, order):
    (tmp_path / "gymnasium.py").write_text(STAND_IN)
    code = f"import {order}\nimport gymnasium; print(gymnasium.registry)"
    assert said(tmp_path, code) == str(EXPECTED)


def test_without_gymnasium_it_says_what_to_install(tmp_path):
    code = """
class Without:
    def find_spec(self, name, path=None, target=None):
        if name == 'gymnasium':
            raise ModuleNotFoundError("No module named 'gymnasium'", name=name)
sys.meta_path.insert(0, Without())
before = list(sys.meta_path)
import ibdata, ibdata.environment
assert sys.meta_path == before
for attempt in ("import gymnasium", "ibdata.environment.IndustrialBenchmarkEnv"):
    try:
        exec(attempt)
    except ImportError as error:
        print(error)
"""
    assert said(tmp_path, code).splitlines() == [
        "No module named 'gymnasium'",
        "ibdata.environment needs the package gymnasium: pip install gymnasium, or 'ibdata[gymnasium]'",
    ]
