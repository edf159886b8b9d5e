"""Episodes of a dataset in an environment: their starts, and the random integers of their steps."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ibdata._numerics.random import Purpose, Raw, integers
from ibdata._simulation.carry import begin_lanes
from ibdata.dynamics.noise import DRIFT_SLOTS, DYNAMICS_SLOTS
from ibdata.environment.settings import Settings
from ibdata.environment.simulation import Indices, Simulation
from ibdata.errors import UsageError, excerpt, meant

if TYPE_CHECKING:
    from ibdata.dataset.dataset import Dataset
    from ibdata.evaluation.states import Addresses
    from ibdata.experiment import Experiment

AHEAD = 64  # steps of which the integers are computed at once
_KNOWN: WeakKeyDictionary[Dataset, Addresses] = WeakKeyDictionary()


class RecordedStream:
    """The random integers of an episode's steps, at their addresses, in the order in which a lane takes them.

    It stands in for the generator of a lane, and does not end where the episode of the dataset does.
    """

    def __init__(self, index: int, key: Raw, drifting: bool) -> None:
        self._index, self._key = np.array([index]), key[None]
        self._purposes = [(Purpose.DYNAMICS, DYNAMICS_SLOTS), (Purpose.DRIFT, DRIFT_SLOTS)][: 1 + drifting]
        self._step = 1  # the step from t to t + 1 has the address t + 1
        self._ahead, self._at = np.empty(0, dtype=np.uint64), 0

    def random_raw(self, count: int) -> Raw:
        """The next integers (count,)."""
        while self._at + count > len(self._ahead):
            self._ahead, self._at = np.concatenate([self._ahead[self._at :], self._next_steps()]), 0
        self._at += count
        return self._ahead[self._at - count : self._at]

    def _next_steps(self) -> Raw:
        parts = [
            integers(self._key, self._index, purpose, self._step, AHEAD, slots)[:, :, 0]
            for purpose, slots in self._purposes
        ]
        self._step += AHEAD
        return np.hstack(parts).ravel()


class Replay(NamedTuple):
    """Episodes of a dataset, one for each of n lanes."""

    addresses: Addresses
    episodes: Indices  # (n,)

    @classmethod
    def asked_for(cls, options: Any, settings: Settings, lanes: int, *others: str) -> Replay | None:
        """The episodes that the options of `reset` name; None if they name none.

        Raises UsageError for an option that is none of these or of the others, if there are no such episodes,
        or if the settings are not theirs; DatasetError if this ibdata cannot simulate them.
        """
        given, known = options or {}, ("dataset", "episode", *others)
        for name in given:
            if name not in known:
                raise UsageError(f"options: found {name!r}{meant(str(name), known)}")
        dataset, episode = given.get("dataset"), given.get("episode")
        if dataset is None and episode is None:
            return None
        if dataset is None or episode is None:
            raise UsageError("options: found only one of dataset and episode, expected both or neither")
        addresses = _addresses(dataset)
        episodes = addresses.episodes(episode)
        if len(episodes) not in (1, lanes):
            expected = "one episode" + (f", or one for each of {lanes} lanes" if lanes > 1 else "")
            raise UsageError(f"episode: found {len(episodes)} episodes, expected {expected}")
        for experiment, _, _ in addresses.by_experiment(np.unique(episodes)):
            _refuse_other_settings(experiment, settings)
        return cls(addresses, np.broadcast_to(episodes, lanes))

    def begin(self, simulation: Simulation, which: Indices) -> list[RecordedStream]:
        """Begin the episodes of these lanes (k,). Returns the noise of each."""
        from ibdata.plan.rollout import episodes_of

        noise = {}
        for experiment, positions, numbers in self.addresses.by_experiment(self.episodes[which]):
            episodes = episodes_of(experiment, numbers)
            lanes = episodes.world, episodes.draw, episodes.lanes, episodes.setpoint
            carry = begin_lanes(*lanes, simulation.needs, simulation.observed_rows)
            simulation.place(which[positions], carry, self.episodes[which[positions]])
            addresses = zip(positions.tolist(), episodes.index.tolist(), episodes.keys, strict=True)
            for position, index, key in addresses:
                noise[position] = RecordedStream(index, key, experiment.drifting)
        return [noise[position] for position in range(len(which))]


def _addresses(dataset: Any) -> Addresses:
    """The addresses of a dataset, which are kept as long as an opened one is."""
    from ibdata.dataset.dataset import Dataset, whole_dataset
    from ibdata.evaluation.states import Addresses

    if not isinstance(dataset, Dataset | str | os.PathLike):
        raise UsageError(f"dataset: found {excerpt(dataset)}, expected a Dataset, or its folder or URL")
    ds = whole_dataset(dataset)
    if ds not in _KNOWN:
        _KNOWN[ds] = Addresses(ds.stored)
    return _KNOWN[ds]


def _refuse_other_settings(experiment: Experiment, settings: Settings) -> None:
    """Raise UsageError if steps of the episodes would be others than those of the environment."""
    if experiment.scenario.variant != settings.world.variant:
        of_dataset = experiment.plain()["dynamics"]
        raise UsageError(
            f"dataset: found the dynamics {of_dataset!r}; make the environment with dynamics={of_dataset!r}"
        )
    if experiment.drifting != settings.world.drifting:
        of_dataset, option = ("moving", '"drifting"') if experiment.drifting else ("constant", "a number")
        raise UsageError(
            f"dataset: found {of_dataset} setpoints; make the environment with setpoint={option}"
        )
