"""Signals for the identification of systems."""

from __future__ import annotations

import numpy as np
import pytest

from ibdata.policies.signals import TAPS, sequence, waves


@pytest.mark.parametrize("order", TAPS)
def test_the_sequence_has_the_longest_period(order):
    """Golomb 1967: one 1 more than -1, and an autocorrelation of -1 at every lag."""
    signs = sequence(order)
    n = 2**order - 1
    assert len(signs) == n
    assert signs.sum() == 1.0
    spectrum = np.abs(np.fft.fft(signs)) ** 2
    np.testing.assert_allclose(np.fft.ifft(spectrum).real[1:], -np.ones(n - 1), atol=1e-9)


def test_a_multisine_has_equal_power_in_its_frequencies():
    signals = waves(4, 60)
    for j in range(3):
        power = np.abs(np.fft.rfft(signals[:, j])) ** 2
        own = np.array([3 * i + j + 1 for i in range(4)])
        np.testing.assert_allclose(power[own] / power[own[0]], np.ones(4), atol=1e-9)
        assert np.delete(power, own).max() < 1e-20 * power[own[0]] + 1e-20
