"""Data of custom policies: their code is asked for densities, where it may run and is what it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from helpers.refusals import refused

import ibdata

EXPLORER = """
    import numpy as np
    from helper_of_explorer import PUSH
    from ibdata.policies import Decision, Distribution, Needs

    class Pushed(Distribution):  # a component is exactly -1 or 1 with the probability PUSH
        draws = 6

        def sample(self, u):
            uniform = 2.0 * u[:, :3] - 1.0
            return np.where(u[:, 3:] < PUSH, np.sign(uniform), uniform)

        def log_density(self, action):
            with np.errstate(divide="ignore"):
                return np.log(np.where(np.abs(action) == 1.0, PUSH / 2.0, (1.0 - PUSH) / 2.0)).sum(axis=1)

    class Explorer:
        needs = Needs(draws=6)

        def decide(self, observed):
            return Decision(Pushed(), observed.memory)
    """
BLOCK = {"kind": "custom", "target": "explorer.py:Explorer", "draws": 6}


def test_weights_of_custom_data_need_consent_and_the_same_code_and_states_none(code):
    own = code({"explorer.py": EXPLORER, "helper_of_explorer.py": "PUSH = 0.0\n"}, **BLOCK)
    ds = own.run("x")
    refused("code that would run", ibdata.importance, ds, "random")
    found = ibdata.importance(ds, BLOCK, allow_code=True)
    np.testing.assert_allclose(found.weights, 1.0, rtol=1e-6)  # recorded densities are float32
    own.edit({"helper_of_explorer.py": "PUSH = 0.3\n"})
    line = r"x: found other code than .*made with, in helper_of_explorer\.py; restore"
    refused(line, ibdata.importance, ds, BLOCK, allow_code=True)
    Path("explorer.py").unlink()
    assert np.float32(ibdata.state_at(ds, (3, 2)).mu_v[0]) == ds.to_pandas()["latent_mu_v"][3 * 4 + 2]
