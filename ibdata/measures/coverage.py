"""State-action coverage: the number of different pairs of a state and an action, on a grid."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from ibdata.dynamics.steering import D_G, D_H, D_V

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

SETPOINT_WIDTH, SETPOINTS = 5.0, 21  # intervals, which begin at 0, 5 … 100
STEERING_WIDTH, STEERINGS = 10.0, 10  # of velocity, gain and shift; 100 belongs to the last interval
ACTION_WIDTH, ACTIONS = 0.4, 5  # of each change; 1 belongs to the last interval
STATES = SETPOINTS * STEERINGS**3
PAIRS = STATES * ACTIONS**3


def state_numbers(setpoint: npt.ArrayLike, steerings: npt.ArrayLike) -> Ints:
    """The number of the grid cell of each state, from 0 to STATES - 1.

    Args:
        setpoint: Setpoints (n,).
        steerings: Velocity, gain and shift (n, 3).

    >>> state_numbers([70.0, 70.0], [[50.0, 50.0, 50.0], [50.0, 50.0, 100.0]])
    array([14555, 14559])
    """
    number = np.floor_divide(np.asarray(setpoint, dtype=np.float64), SETPOINT_WIDTH).astype(np.int64)
    bins = np.floor_divide(np.asarray(steerings, dtype=np.float64), STEERING_WIDTH).astype(np.int64)
    for column in np.minimum(bins, STEERINGS - 1).T:
        number = number * STEERINGS + column
    return number


def pair_numbers(states: Ints, actions: npt.ArrayLike) -> Ints:
    """The number of the grid cell of each pair of a state and an action, from 0 to PAIRS - 1.

    Args:
        states: Numbers of states (n,).
        actions: The actions (n, 3).

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

    Hein et al. 2017, Eqs. (2), (3), (4), with the step sizes of the dynamics. Nothing else is simulated,
    because neither the setpoint nor the noise changes the three.

    Args:
        start: Velocity, gain and shift before the first action of each episode (n, 3).
        actions: The actions of all rows (rows, 3).
        lengths: The numbers of rows of the episodes (n,).

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
    """The pairs of a dataset and those of its reference, collected from batches of whole episodes.

    The state-action coverage is their ratio of numbers of different pairs:

        SACo(D) = u(D) / u(D_ref)

    Schweighofer et al. 2022, A dataset perspective on offline reinforcement learning (arXiv 2111.04714). The
    paper counts equal states and actions; values that are not discrete are never equal, so here a pair is a
    cell of a grid: the setpoint in intervals of 5, velocity, gain and shift in intervals of 10, and each
    change in intervals of 0.4. Fatigue and consumption are left out, because their noise alone would count as
    coverage.

    The paper's reference is the replay data of online training. Here, it is the same dataset with uniform
    random actions in place of its own: the same number of episodes, as long, from the same velocity, gain and
    shift, at the same setpoints. So a coverage of 1 means as many pairs as random exploration of the same
    size, any dataset has a reference, and the size of a dataset does not count. Directed exploration exceeds
    1.
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
    def pairs(self) -> int:
        """The number of different pairs of the data."""
        return int(self._pairs.sum())

    @property
    def reference_pairs(self) -> int:
        """The number of different pairs of the reference."""
        return int(self._reference.sum())

    @property
    def value(self) -> float:
        """The state-action coverage."""
        return self.pairs / self.reference_pairs
