"""The vector environment as Stable-Baselines3 takes environments, a `VecEnv`. Needs the extra `sb3`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from ibdata.arguments import public
from ibdata.dynamics import State
from ibdata.environment import STEPS
from ibdata.environment.simulation import Float32s
from ibdata.environment.streams import refuse_negative
from ibdata.environment.vector import SAME_STEP, Flags, IndustrialBenchmarkVectorEnv
from ibdata.errors import missing

try:
    from stable_baselines3.common.vec_env import VecEnv
except ModuleNotFoundError:
    raise missing("ibdata.environment.sb3", "stable-baselines3", "sb3") from None

Infos = list[dict[str, Any]]
Lanes = int | Iterable[int] | None


class IndustrialBenchmarkVecEnv(VecEnv):
    """`num_envs` environments for Stable-Baselines3, which advance together.

    It gives the same bits as `DummyVecEnv` over as many environments of `gymnasium.make`. `set_options` takes
    what `reset` of `IndustrialBenchmarkEnv` takes; `env_method` calls `reset` or `set_state` of single lanes.

    Args:
        num_envs: the number of lanes.
        max_episode_steps: the length of episodes; None for no end.
        **settings: the settings of `IndustrialBenchmarkEnv`, without `render_mode`.

    Raises:
        ConfigError: a setting is invalid.
        UsageError: another argument or an action is invalid.
    """

    @public
    def __init__(self, num_envs: int = 1, max_episode_steps: int | None = STEPS, **settings: Any) -> None:
        self._env = IndustrialBenchmarkVectorEnv(num_envs, max_episode_steps, SAME_STEP, **settings)
        self._lanes = [_Lane(self._env, number) for number in range(num_envs)]
        super().__init__(num_envs, self._env.single_observation_space, self._env.single_action_space)

    @public
    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Keep the seeds of the next `reset`: this one and those after it, or random ones. Returns them."""
        refuse_negative([seed])
        seeds: Sequence[int | None] = super().seed(seed)
        return seeds

    def reset(self) -> Float32s:
        """Begin an episode in every lane, with the seeds of `seed` and the options of `set_options`."""
        plain = np.array([not options for options in self._options])
        seen = np.empty(self._env.observation_space.shape, dtype=np.float32)
        if plain.any():
            begun, info = self._env.reset(seed=self._seeds, options={"reset_mask": plain})
            seen[plain] = begun[plain]
            self._keep(plain, _each(info))
        for i in np.flatnonzero(~plain).tolist():
            seen[i], self.reset_infos[i] = self._lanes[i].reset(seed=self._seeds[i], options=self._options[i])
        self._reset_seeds()
        self._reset_options()
        return seen

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Keep the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Float32s, npt.NDArray[np.float32], Flags, Infos]:
        """Make the step. Returns observations, rewards, whether the episodes ended (n,), and infos.

        Where an episode ended, the observation is the first of the next one; the info has the last one.
        """
        seen, rewards, _, ended, info = self._env.step(self._actions)
        infos = _each(info)
        if ended.any():
            self._keep(ended, infos)
            last = _each(info["final_info"])
            for lane in np.flatnonzero(ended).tolist():
                infos[lane] = {**last[lane], "terminal_observation": info["final_obs"][lane]}
        for lane_info, end in zip(infos, ended.tolist(), strict=True):
            lane_info["TimeLimit.truncated"] = end
        return seen, rewards.astype(np.float32), ended, infos

    def _keep(self, begun: Flags, infos: Infos) -> None:
        for lane in np.flatnonzero(begun).tolist():
            self.reset_infos[lane] = infos[lane]

    def close(self) -> None:
        """Close the vector environment."""
        self._env.close()

    def get_attr(self, attr_name: str, indices: Lanes = None) -> list[Any]:
        """An attribute of each lane."""
        return [getattr(lane, attr_name) for lane in self._some(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Lanes = None) -> None:
        """Give lanes an attribute, which `get_attr` returns."""
        for lane in self._some(indices):
            setattr(lane, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Lanes = None, **kwargs: Any) -> list[Any]:
        """Call a method of each lane."""
        return [getattr(lane, method_name)(*args, **kwargs) for lane in self._some(indices)]

    def env_is_wrapped(self, wrapper_class: type, indices: Lanes = None) -> list[bool]:
        """No lane has a wrapper."""
        return [False for _ in self._some(indices)]

    def _some(self, indices: Lanes) -> list[_Lane]:
        return [self._lanes[i] for i in self._get_indices(indices)]


class _Lane:
    """A lane as Stable-Baselines3 sees an environment: attributes, and methods that concern it alone."""

    render_mode = None

    def __init__(self, env: IndustrialBenchmarkVectorEnv, number: int) -> None:
        self._env, self._number, self.view = env, number, env.view
        self.observation_space, self.action_space = env.single_observation_space, env.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32s, dict[str, Any]]:
        """Begin an episode. Returns the first observation and the hidden state."""
        mask = np.arange(self._env.num_envs) == self._number
        seeds = [seed] * self._env.num_envs
        return self._own(*self._env.reset(seed=seeds, options={**(options or {}), "reset_mask": mask}))

    def set_state(self, state: State) -> tuple[Float32s, dict[str, Any]]:
        """Begin in a state of one lane, as `IndustrialBenchmarkEnv.set_state` does."""
        return self._own(*self._env.set_state(state, self._number))

    def _own(self, seen: Float32s, info: dict[str, Any]) -> tuple[Float32s, dict[str, Any]]:
        return seen[self._number], _each(info)[self._number]


def _each(info: dict[str, Any]) -> Infos:
    """What the agent is not meant to see in each lane, from that of all lanes."""
    names = [name for name in info if not name.startswith(("_", "final_"))]
    rows = zip(*(info[name].tolist() for name in names), strict=True)
    return [dict(zip(names, row, strict=True)) for row in rows]
