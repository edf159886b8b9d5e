"""The law of α agrees with many draws of the step, and with integrals by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helpers import FULL
from helpers.variants import VARIANTS_MOVED

from ibdata.dynamics import PAPER, SIEMENS, Noise, initial_state, step
from ibdata.dynamics.noise import amplification_cdf, noise_component_cdf, squashed_exponential_cdf

DRAWS = 100_000 if FULL else 20_000
# μᵛ, μᵍ before the step; velocity and gain, which give the effective values.
STATES = {
    "bifurcated": (4.8, 0.3, 50.0, 50.0),
    "near the threshold of the paper": (1.15, 1.1, 30.0, 20.0),
    "both reset": (3.0, 3.0, 100.0, 100.0),
}


def drawn(n, seed):
    rng = np.random.default_rng(seed)
    laws = {"exp": rng.exponential, "normal": rng.standard_normal}
    return Noise(*(laws.get(name.split("_")[0], rng.random)(size=n) for name in Noise._fields))


@pytest.mark.parametrize("variant", VARIANTS_MOVED.values(), ids=VARIANTS_MOVED)
@pytest.mark.parametrize("case", STATES.values(), ids=STATES)
def test_the_law_is_that_of_many_steps_from_one_state(variant, case):
    mu_v, mu_g, velocity, gain = (np.full(DRAWS, x) for x in case)
    before = initial_state(np.full(DRAWS, 70.0), velocity, gain).replace(mu_v=mu_v, mu_g=mu_g)
    after = step(before, np.zeros((DRAWS, 3)), drawn(DRAWS, 1), variant)
    own = (x[:1] for x in (mu_v, mu_g, after.effective_velocity, after.effective_gain))
    x = np.array([0.03, 0.1, 0.3, 0.51, 0.55, 0.7, 0.9, 0.95])
    (cdf,) = amplification_cdf(x, *own, variant.parameters)
    share = (after.alpha <= x[:, None]).mean(axis=1)
    error = np.sqrt(np.maximum(cdf * (1.0 - cdf), 0.0) / DRAWS)
    assert np.all(np.abs(share - cdf) <= 4.0 * error + 1e-9)


@pytest.mark.parametrize("mean", [0.05, 0.1, 1.0])
@pytest.mark.parametrize("base", [SIEMENS, PAPER], ids=["siemens", "paper"])
def test_the_closed_form_is_the_integral_over_the_uniform_draw(base, mean):
    k = dataclasses.replace(base, eta_mean=mean, bernoulli_bounds=(1.0, 1.0)).parameters  # always the event
    u = (np.arange(20_000) + 0.5) / 20_000
    for x in (0.05, 0.4, 0.52, 0.6, 0.9, 1.0):
        for effective in (0.02, 0.5, 1.0):
            by_hand = squashed_exponential_cdf(1.0 - (1.0 - x) / (1.0 - effective * u), k).mean()
            found = noise_component_cdf(np.array(x), np.array(effective), k)
            assert float(found) == pytest.approx(by_hand, abs=2e-4)
