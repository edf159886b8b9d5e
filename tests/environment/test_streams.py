"""The random integers of lanes, without Gymnasium."""

from __future__ import annotations

import numpy as np

from ibdata._numerics.random import Purpose
from ibdata.environment.streams import AHEAD, Streams


def test_a_lane_takes_the_integers_of_its_generator_in_order_however_the_others_take_theirs():
    lanes, chance = 5, np.random.default_rng(0)
    streams = Streams(lanes)
    for lane in range(lanes):
        streams.seed(lane, lane)
    taken = [[] for _ in range(lanes)]
    while min(map(len, taken)) <= 2 * AHEAD:
        which = np.flatnonzero(chance.random(lanes) < 0.6)
        steps, slots = int(chance.integers(1, 4)), int(chance.choice([1, 4, 8]))
        drawn = streams.draw(which, Purpose.DYNAMICS, 0, steps, slots)
        assert drawn.shape == (steps, slots, len(which))
        for lane, integers in zip(which, drawn.reshape(steps * slots, len(which)).T, strict=True):
            taken[lane] += integers.tolist()
    for lane, integers in enumerate(taken):
        expected = np.random.default_rng(lane).bit_generator.random_raw(len(integers))
        assert integers == expected.tolist()
