"""After `ibdata warm-up` nothing is left to compile."""

import pytest
from helpers import python

from ibdata.errors import IbdataError
from ibdata.maintenance import compile_all
from ibdata.system.cache_folders import CacheFolders

LATER = """
import ibdata
from ibdata.maintenance.compile_all import compile_all
from ibdata.numerics.code_cache import CodeCache
print(compile_all().folder)
new = []
CodeCache.load_overload = lambda self, *_: new.append(self._function) or None
policies = [{"kind": kind} for kind in ("random", "safe", "constant", "bad", "mediocre", "optimized")]
policies += [{"kind": "epsilon_greedy", "base": {"kind": "bad"}, "epsilon": 0.2}]
policies += [{"kind": "gaussian", "base": {"kind": "optimized"}, "scale": 0.1}]
policies += ["ornstein_uhlenbeck", "coloured_noise", "prbs", "multisine"]
policies += [{"kind": "sticky", "base": "random", "kappa": 0.5}]
policies += [{"kind": "schedule", "stages": [{"base": "optimized", "steps": 2, "epsilon": [1.0, 0.5]}]}]
ibdata.evaluate(policies, setpoint=[20, 70], episodes=2, steps=3)
ibdata.evaluate(policies, setpoint="drifting", episodes=2, steps=3, start="uniform", dynamics="paper")
plain = {"name": "x", "setpoints": [20], "policies": policies, "episodes": 2, "steps": 3, "dynamics": "paper"}
for latent in (True, False, "full", "next"):
    for dtype in ("float32", "float64"):
        output = {"latent": latent, "dtype": dtype, "shard_rows": 10}
        ibdata.generate({**plain, "output": output}, f"{latent}-{dtype}", workers=1)
print(new)
"""


@pytest.mark.slow
def test_nothing_is_compiled_after_it(tmp_path):
    done = python("-c", LATER, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[1:] == ["[]"]


def test_where_nothing_can_be_kept_it_fails(monkeypatch):
    monkeypatch.setattr(compile_all, "cache_folders", lambda: CacheFolders((), False))
    with pytest.raises(IbdataError, match="set IBDATA_CACHE_DIR to one"):
        compile_all.compile_all()
