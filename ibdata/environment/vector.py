"""Many environments at once, moved by one compiled call a step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import public
from ibdata._numerics.arrays import Bools, Float32s
from ibdata._numerics.random import Raw
from ibdata.dataset.selection import checked_length, numbers_within
from ibdata.dynamics import State
from ibdata.environment import STEPS
from ibdata.environment.actions import continuous_actions, discrete_actions
from ibdata.environment.replayed import Replay
from ibdata.environment.settings import Fixed, settings
from ibdata.environment.simulation import Indices, Simulation
from ibdata.environment.spaces import spaces
from ibdata.environment.streams import Streams, refuse_negative
from ibdata.errors import UsageError, excerpt

# After the spaces, whose module says what to install where there is no Gymnasium.
import gymnasium as gym  # isort: skip
from gymnasium.vector.utils import batch_space  # isort: skip

NEXT_STEP, SAME_STEP, DISABLED = MODES = ("NextStep", "SameStep", "Disabled")


def _mode_of_gymnasium(mode: str) -> Any:
    """The member of `gymnasium.vector.AutoresetMode`, which 1.0 does not have."""
    modes = getattr(gym.vector, "AutoresetMode", None)
    return mode if modes is None else modes(mode)


class IndustrialBenchmarkVectorEnv(Fixed, gym.vector.VectorEnv[Float32s, Float32s, npt.NDArray[Any]]):
    """`num_envs` environments, the lanes, which advance together.

    With the seed s, lane i gives the same bits as an `IndustrialBenchmarkEnv` with the seed s + i. The
    arguments that are not listed are those of `IndustrialBenchmarkEnv`.

    Args:
        num_envs: the number of lanes.
        max_episode_steps: the length of episodes; -1 for no end, None for 1000, as in `gymnasium.make`.
        autoreset_mode: what follows a truncation. "NextStep": the next step ignores the action, which must be
            valid all the same, and returns the first observation of a new episode with reward 0, which is no
            transition to learn from.
            "SameStep": the truncated step itself returns that observation, and `info["final_obs"]` and
            `info["final_info"]` have the last ones, with the cost of the step. "Disabled": the caller must
            call `reset(options={"reset_mask": truncated})`.

    Raises:
        ConfigError: a setting is invalid.
        UsageError: another argument or an action is invalid.
    """

    @public
    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int | None = -1,
        autoreset_mode: Any = NEXT_STEP,
        **options: Any,
    ) -> None:
        mode = getattr(autoreset_mode, "value", autoreset_mode)
        if mode not in MODES:
            raise UsageError(f"autoreset_mode: found {autoreset_mode!r}, expected one of {', '.join(MODES)}")
        checked_length(num_envs, "num_envs")
        self._limit = np.iinfo(np.int64).max
        if max_episode_steps != -1:
            limit = STEPS if max_episode_steps is None else max_episode_steps
            self._limit = checked_length(limit, "max_episode_steps")
        chosen = settings(**options)
        self.autoreset_mode = _mode_of_gymnasium(mode)  # as Gymnasium's loops have it; TorchRL reads it there
        self.metadata = {"render_modes": [], "autoreset_mode": self.autoreset_mode}
        self.num_envs, self.__dict__["view"] = num_envs, chosen.view
        self.single_observation_space, self.single_action_space = spaces(chosen)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._mode = mode
        self._checked = discrete_actions if chosen.discrete_actions else continuous_actions
        self._simulation = Simulation(chosen, num_envs)
        self._streams = Streams(num_envs)
        self._elapsed = np.full(num_envs, -1)  # steps of the episode; -1: it has not begun
        self._done = np.zeros(num_envs, dtype=bool)

    @property
    def np_random(self) -> tuple[np.random.Generator, ...]:
        """The generator of each lane; some of its numbers are already read ahead."""
        return tuple(self._streams.generators)

    @property
    def np_random_seed(self) -> tuple[int, ...]:
        """The seed of each lane."""
        sources: list[Any] = [generator.bit_generator for generator in self._streams.generators]
        return tuple(source.seed_seq.entropy for source in sources)

    @public
    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Float32s, dict[str, Any]]:
        """Begin episodes in all lanes, or in those of the boolean array `options["reset_mask"]` (n,).

        Args:
            seed: the seed of lane 0, to which lane i adds i, or a list with one seed for each lane.
            options: see above. {"dataset": ds, "episode": [i, …]} begins as an `IndustrialBenchmarkEnv` does
                with these options, in each lane an episode; one number stands for all lanes. When the
                episode of a lane ends, the next one takes the random numbers of `np_random` again.

        Raises:
            UsageError: an option is invalid.
            DatasetError: this ibdata cannot simulate the dataset again.
        """
        mask = self._mask((options or {}).get("reset_mask"))
        replay = Replay.asked_for(options, self._simulation.settings, self.num_envs, "reset_mask")
        first = 0 if seed is None else seed
        seeds = first if isinstance(first, Sequence) else range(first, first + self.num_envs)
        if len(seeds) != self.num_envs:
            raise UsageError(f"seed: found {len(seeds)} seeds, expected {self.num_envs}")
        refuse_negative(seeds)
        which = np.flatnonzero(mask)
        if seed is not None:
            for lane in which.tolist():
                self._streams.seed(lane, seeds[lane])
        if replay is None:
            self._begin(which)
        else:
            for lane, noise in zip(which.tolist(), replay.begin(self._simulation, which), strict=True):
                self._streams.replay(lane, noise)
            self._began(which)
        return self._simulation.observations(), self._info(mask)

    def set_state(self, state: State, lanes: npt.ArrayLike | None = None) -> tuple[Float32s, dict[str, Any]]:
        """Begin in states instead of those of `reset`, as `IndustrialBenchmarkEnv.set_state` does.

        Args:
            state: A state of k lanes, such as `ibdata.state_at` returns for k rows.
            lanes: The lanes (k,) that begin; by default all.

        Returns:
            What `reset` returns.

        Raises:
            UsageError: It is no such state, or there are no such lanes.
        """
        which = self._simulation.everyone if lanes is None else numbers_within("lanes", lanes, self.num_envs)
        if len(np.unique(which)) < len(which):
            raise UsageError(f"lanes: found {excerpt(lanes)}, expected different ones")

        def draw(lanes: Indices, *place: Any) -> Raw:
            self._streams.resume(lanes)  # only now that the state is accepted
            return self._streams.draw(lanes, *place)

        self._simulation.set_state(state, which, draw)
        self._streams.resume(which)
        self._began(which)
        return self._simulation.observations(), self._info(np.isin(self._simulation.everyone, which))

    @property
    def state(self) -> State:
        """A copy of the exact states, of all lanes; `set_state` and `ibdata.rollouts` take it."""
        return self._simulation.carry.state.take(self._simulation.everyone)

    def _mask(self, mask: Any) -> Bools:
        if mask is None:
            return np.ones(self.num_envs, dtype=bool)
        fits = isinstance(mask, np.ndarray) and mask.dtype == bool and mask.shape == (self.num_envs,)
        if not fits or not mask.any():
            expected = f"a boolean array of shape ({self.num_envs},) that is true for some lane"
            raise UsageError(f"reset_mask: found {excerpt(mask)}, expected {expected}")
        lanes: Bools = mask
        return lanes

    def _begin(self, which: Indices) -> None:
        self._streams.resume(which)
        self._simulation.reset(which, self._streams.draw)
        self._began(which)

    def _began(self, which: Indices) -> None:
        self._elapsed[which] = 0
        self._done[which] = False

    def step(
        self, actions: Float32s
    ) -> tuple[Float32s, npt.NDArray[np.float64], Bools, Bools, dict[str, Any]]:
        """Advance every lane by one step. Returns observations, rewards, flags (n,) and the hidden states."""
        # count_nonzero is eight times as fast as any().
        if np.count_nonzero(self._elapsed < 0) or (self._mode == DISABLED and np.count_nonzero(self._done)):
            raise gym.error.ResetNeeded(
                "step: found lanes without a running episode, expected reset() before"
            )
        rewards = self._moved(self._checked(actions, self.num_envs))
        truncated, final = self._elapsed >= self._limit, {}
        if np.count_nonzero(truncated):
            if self._mode == SAME_STEP:
                final = self._final(truncated)
                self._begin(np.flatnonzero(truncated))
            else:
                self._done = truncated.copy()
        terminated = np.zeros(self.num_envs, dtype=bool)
        return self._simulation.observations(), rewards, terminated, truncated, final | self._info()

    def _moved(self, actions: Float32s) -> npt.NDArray[np.float64]:
        """Move the lanes whose episodes go on, and begin new ones in the others. Returns the rewards (n,)."""
        simulation, draw = self._simulation, self._streams.draw
        if not np.count_nonzero(self._done):
            rewards = simulation.step(simulation.everyone, actions, draw)
            self._elapsed += 1
            return rewards
        moving, rewards = np.flatnonzero(~self._done), np.zeros(self.num_envs)
        if len(moving):
            rewards[moving] = simulation.step(moving, actions[moving], draw)
            self._elapsed[moving] += 1
        self._begin(np.flatnonzero(self._done))
        return rewards

    def _final(self, ended: Bools) -> dict[str, Any]:
        """The last observations and infos of the episodes that ended, which an automatic reset hides."""
        last = np.full(self.num_envs, None, dtype=object)
        seen = self._simulation.observations()
        for lane in np.flatnonzero(ended).tolist():
            last[lane] = seen[lane].copy()
        return {
            "final_obs": last,
            "_final_obs": ended.copy(),
            "final_info": self._info(ended),
            "_final_info": ended.copy(),
        }

    def _info(self, mask: Bools | None = None) -> dict[str, Any]:
        """The hidden states as Gymnasium has them: arrays (n,), zero outside `_name`."""
        info: dict[str, Any] = {}
        hidden = self._simulation.info()
        masks = np.ones((len(hidden), self.num_envs), dtype=bool)
        if mask is not None:
            masks[:] = mask
        for (name, values), shown in zip(hidden.items(), masks, strict=True):
            info[name] = values if mask is None else np.where(mask, values, np.zeros(1, dtype=values.dtype))
            info[f"_{name}"] = shown
        return info
