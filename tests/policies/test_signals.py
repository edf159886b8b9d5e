"""Signals for the identification of systems."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.policies import played

from ibdata.policies import POLICIES
from ibdata.policies.signals import TAPS, sequence, waves

Prbs, Multisine = POLICIES["prbs"], POLICIES["multisine"]


@pytest.mark.parametrize("order", TAPS)
def test_the_sequence_has_the_longest_period(order):
    """Golomb 1967: one 1 more than -1, and an autocorrelation of -1 at every lag."""
    signs = sequence(order)
    n = 2**order - 1
    assert len(signs) == n
    assert signs.sum() == 1.0
    spectrum = np.abs(np.fft.fft(signs)) ** 2
    np.testing.assert_allclose(np.fft.ifft(spectrum).real[1:], -np.ones(n - 1), atol=1e-9)


def test_an_episode_begins_anywhere_in_the_sequence():
    policy = Prbs(order=4, hold=3, amplitude=0.5)
    action = played(policy, 50, 45)
    assert set(np.unique(action).tolist()) == {-0.5, 0.5}
    everywhere = {np.roll(np.repeat(sequence(4), 3), -k).astype(int).tobytes() for k in range(45)}
    found = {(2.0 * lane[:, 0]).astype(int).tobytes() for lane in action}
    assert found <= everywhere
    assert len(found) > 20
    assert (action[:, :30, 1] == action[:, 15:, 0]).all()
    assert (action[:, :15, 2] == action[:, 30:, 0]).all()


def test_a_multisine_has_equal_power_in_its_frequencies():
    signals = waves(4, 60)
    for j in range(3):
        power = np.abs(np.fft.rfft(signals[:, j])) ** 2
        own = np.array([3 * i + j + 1 for i in range(4)])
        np.testing.assert_allclose(power[own] / power[own[0]], np.ones(4), atol=1e-9)
        assert np.delete(power, own).max() < 1e-20 * power[own[0]] + 1e-20


def test_its_highest_peak_is_the_amplitude_and_low():
    action = played(Multisine(sines=10, period=1000, amplitude=0.8), 3, 1000)
    assert np.abs(action).max(axis=1) == pytest.approx(np.full((3, 3), 0.8))
    crest = np.abs(waves(10, 1000)).max(axis=0) / waves(10, 1000).std(axis=0)
    assert (crest < 2.0).all()  # with equal phases √20 = 4.5
