"""Operational cost: θ, its history and its convolution."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.examples import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.dynamics import PAPER, SIEMENS
from ibdata.dynamics.operational_cost import convolved_cost, operational_cost, remember

examples = tries(200)
percent = st.floats(0.0, 100.0)
costs = st.lists(st.floats(1.0, 5000.0), min_size=10, max_size=10)
variants = pytest.mark.parametrize("variant", [SIEMENS, PAPER], ids=["siemens", "paper"])


@pytest.mark.parametrize(
    ("p", "v", "g", "exponent"),
    [
        (50.0, 50.0, 50.0, 4.25),  # (100 + 200 + 125) / 100
        (0.0, 0.0, 0.0, 0.0),
        (100.0, 100.0, 100.0, 8.5),
        (100.0, 0.0, 0.0, 2.0),  # each coefficient alone
        (0.0, 100.0, 0.0, 4.0),
        (0.0, 0.0, 100.0, 2.5),
    ],
)
def test_the_cost_is_the_exponential_of_the_weighted_steerings(p, v, g, exponent):
    assert operational_cost(p, v, g) == pytest.approx(math.exp(exponent), rel=1e-15)


def test_the_cost_of_the_usual_start_is_70_105():
    assert round(operational_cost(50.0, 50.0, 50.0), 3) == 70.105  # e^4.25


@examples
@given(percent, percent, percent, st.floats(0.0, 50.0))
def test_the_cost_grows_with_each_of_its_arguments(p, v, g, more):
    base = operational_cost(p, v, g)
    assert 1.0 <= base <= 4914.77
    for other in (
        operational_cost(p + more, v, g),
        operational_cost(p, v + more, g),
        operational_cost(p, v, g + more),
    ):
        assert other >= base * (1.0 - 1e-15)


def test_the_first_cost_fills_the_whole_history_of_its_lane_only():
    history = np.zeros((10, 2))
    history[:, 1] = np.arange(1.0, 11.0)
    remember(np.array([7.5, 99.0]), history)
    assert history[:, 0].tolist() == [7.5] * 10
    assert history[:, 1].tolist() == [99.0, *range(1, 10)]


def test_a_later_cost_pushes_the_oldest_out():
    history = np.arange(1.0, 21.0).reshape(2, 10).T.copy()
    remember(np.array([99.0, 100.0]), history)
    assert history[:, 0].tolist() == [99.0, *range(1, 10)]
    assert history[:, 1].tolist() == [100.0, *range(11, 20)]


@examples
@given(st.lists(st.floats(1.0, 5000.0), min_size=11, max_size=30))
def test_the_history_holds_the_last_ten_costs_newest_first(thetas):
    history = np.zeros((10, 1))
    for theta in thetas:
        remember(np.array([theta]), history)
    assert history[:, 0].tolist() == thetas[:-11:-1]


@variants
def test_the_impulse_response_is_the_kernel_at_lags_5_to_9(variant):
    """A cost of 1 in a history of nothing shows after five steps, as w₅ … w₉, and is then forgotten."""
    w = variant.convolution_weights
    history = np.zeros((10, 1))
    history[0] = 1.0
    response = []
    for _ in range(11):
        response.append(convolved_cost(history, 0, w))
        history[:, 0] = [0.0, *history[:9, 0]]
    assert response == [0.0] * 5 + list(w) + [0.0]


def test_the_convolved_cost_weights_five_old_costs():
    # θ[t-9] … θ[t] = 1 … 10: (1·5 + 2·4 + 3·3 + 2·2 + 1·1) / 9 = 27/9.
    history = np.arange(10.0, 0.0, -1.0).reshape(10, 1)
    assert convolved_cost(history, 0, PAPER.convolution_weights) == pytest.approx(3.0, rel=1e-15)


@variants
@examples
@given(theta=st.floats(1.0, 5000.0))
def test_a_constant_cost_is_seen_times_the_sum_of_the_weights_after_ten_steps(variant, theta):
    history = np.full((10, 1), 123.0)
    for _ in range(10):
        remember(np.array([theta]), history)
    seen = convolved_cost(history, 0, variant.convolution_weights)
    assert seen == pytest.approx(theta * sum(variant.convolution_weights), rel=1e-14)


@variants
@examples
@given(a=costs, b=costs, factor=st.floats(0.0, 10.0))
def test_the_convolution_is_linear(variant, a, b, factor):
    w = variant.convolution_weights
    first, second = np.array([a]).T, np.array([b]).T
    combined = convolved_cost(first + factor * second, 0, w)
    parts = convolved_cost(first, 0, w) + factor * convolved_cost(second, 0, w)
    assert combined == pytest.approx(parts, rel=1e-13)
