"""State-action coverage: the number of different pairs of a state and an action, on a grid."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ibdata.dynamics.setpoint import D_G, D_H, D_V

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

SETPOINT_WIDTH, SETPOINTS = 5.0, 21  # intervals, which begin at 0, 5 … 100
STEERING_WIDTH, STEERINGS = 10.0, 10  # of velocity, gain and shift; 100 belongs to the last interval
ACTION_WIDTH, ACTIONS = 0.4, 5  # of each change; 1 belongs to the last interval
STATES = SETPOINTS * STEERINGS**3
PAIRS = STATES * ACTIONS**3


def state_numbers(setpoint: npt.ArrayLike, steerings: npt.ArrayLike) -> Ints:
    """The numbers (n,) of the grid cells of states: setpoints (n,), and velocity, gain and shift (n, 3).

    >>> state_numbers([70.0, 70.0], [[50.0, 50.0, 50.0], [50.0, 50.0, 100.0]])
    array([14555, 14559])
    """
    number = np.floor_divide(np.asarray(setpoint, dtype=np.float64), SETPOINT_WIDTH).astype(np.int64)
    bins = np.floor_divide(np.asarray(steerings, dtype=np.float64), STEERING_WIDTH).astype(np.int64)
    for column in np.minimum(bins, STEERINGS - 1).T:
        number = number * STEERINGS + column
    return number


def pair_numbers(states: Ints, actions: npt.ArrayLike) -> Ints:
    """The numbers (n,) of the grid cells of pairs of a state, by its number (n,), and an action (n, 3).

    >>> pair_numbers(np.array([2, 2]), [[-1.0, -1.0, -1.0], [1.0, 1.0, 0.0]])
    array([250, 372])
    """
    number = states
    bins = np.floor_divide(np.asarray(actions, dtype=np.float64) + 1.0, ACTION_WIDTH).astype(np.int64)
    for column in np.minimum(bins, ACTIONS - 1).T:
        number = number * ACTIONS + column
    return number


def steered(start: Floats, actions: Floats, lengths: Ints) -> Floats:
    """Velocity, gain and shift before each action of episodes, one episode after the other (rows, 3).

    Hein et al. 2017, Eqs. (2), (3), (4): neither the setpoint nor the noise changes the three. They begin at
    start (n, 3), and episode after episode has so many of the actions (rows, 3) as lengths (n,) says.

    >>> steered(np.array([[99.5, 50.0, 0.0]]), np.array([[1.0, -0.5, -1.0], [1.0, 1.0, 1.0]]), np.array([2]))
    array([[ 99.5,  50. ,   0. ],
           [100. ,  45. ,   0. ]])
    """
    inside = np.arange(lengths.max()) < lengths[:, None]
    moves = np.zeros((*inside.shape, 3))
    moves[inside] = actions * (D_V, D_G, D_H)
    out, now = np.empty_like(moves), start
    for t in range(moves.shape[1]):
        out[:, t] = now
        now = np.clip(now + moves[:, t], 0.0, 100.0)
    return out[inside]


class Coverage:
    """State-action coverage, collected from batches of whole episodes: SACo(D) = u(D) / u(D_ref).

    u is the number of different pairs (Schweighofer et al. 2022, arXiv 2111.04714). Values that are not
    discrete are never equal, so a pair is a cell of a grid. Fatigue and consumption are left out, because
    their noise alone would count. The reference is the same dataset with uniform random actions in place of
    its own, from the same velocity, gain and shift; docs/quality.md says why.
    """

    def __init__(self, seed: int = 0) -> None:
        self._rng = np.random.Generator(np.random.Philox(seed))
        self._pairs, self._reference = np.zeros((2, PAIRS), dtype=bool)

    def add(self, setpoint: Floats, steerings: Floats, actions: Floats, lengths: Ints) -> None:
        """Add whole episodes: rows (rows,), (rows, 3), (rows, 3), and the lengths of the episodes (n,)."""
        self._pairs[pair_numbers(state_numbers(setpoint, steerings), actions)] = True
        random = 2.0 * self._rng.random((len(actions), 3)) - 1.0
        walked = steered(steerings[np.cumsum(lengths) - lengths], random, lengths)
        self._reference[pair_numbers(state_numbers(setpoint, walked), random)] = True

    @property
    def pairs(self) -> tuple[int, int]:
        """The numbers of different pairs of the data and of the reference."""
        return int(self._pairs.sum()), int(self._reference.sum())
