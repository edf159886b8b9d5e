"""The vector environment as Stable-Baselines3 takes environments, a `VecEnv`. Needs the extra `sb3`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import public
from ibdata._numerics.arrays import Bools, Float32s
from ibdata.environment import STEPS
from ibdata.environment.settings import Fixed
from ibdata.environment.streams import refuse_negative
from ibdata.environment.vector import SAME_STEP, IndustrialBenchmarkVectorEnv
from ibdata.errors import UsageError, missing

try:
    from stable_baselines3.common.vec_env import VecEnv
except ModuleNotFoundError:
    raise missing("ibdata.environment.sb3", "stable-baselines3", "sb3") from None

ONE = "the lanes are one environment; DummyVecEnv over gymnasium.make has one for each"


class IndustrialBenchmarkVecEnv(Fixed, VecEnv):
    """`num_envs` environments for Stable-Baselines3, which advance together.

    It gives the same bits as `DummyVecEnv` over as many environments of `gymnasium.make`, but no hidden
    states in infos, and no lane has methods of its own. `set_options` takes what `reset` of
    `IndustrialBenchmarkEnv` takes.

    Args:
        num_envs: the number of lanes.
        max_episode_steps: the length of episodes; -1 for no end, None for 1000, as in `gymnasium.make`.
        **settings: the settings of `IndustrialBenchmarkEnv`, without `render_mode`.

    Raises:
        ConfigError: a setting is invalid.
        UsageError: another argument or an action is invalid.
    """

    @public
    def __init__(self, num_envs: int = 1, max_episode_steps: int | None = STEPS, **settings: Any) -> None:
        self._env = IndustrialBenchmarkVectorEnv(num_envs, max_episode_steps, SAME_STEP, **settings)
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
        masks = [plain, *(np.arange(self.num_envs) == lane for lane in np.flatnonzero(~plain))]
        for mask in masks:
            if mask.any():
                options = {**self._options[int(mask.argmax())], "reset_mask": mask}
                observations, _ = self._env.reset(seed=self._seeds, options=options)
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Keep the actions of the next step."""
        self._actions = actions

    def step_wait(self) -> tuple[Float32s, npt.NDArray[np.float32], Bools, list[dict[str, Any]]]:
        """Make the step. Returns observations, rewards, whether the episodes ended (n,), and infos.

        Where an episode ended, the observation is the first of the next one; the info has the last one.
        """
        observations, rewards, _, ended, info = self._env.step(self._actions)
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": end} for end in ended.tolist()]
        for lane in np.flatnonzero(ended).tolist():
            infos[lane]["terminal_observation"] = info["final_obs"][lane]
        return observations, rewards.astype(np.float32), ended, infos

    def close(self) -> None:
        """Close the vector environment."""
        self._env.close()

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of the vector environment, for each lane."""
        return [getattr(self._env, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> NoReturn:
        """Raise UsageError: lanes have no attributes of their own."""
        raise UsageError(f"set_attr: found {attr_name!r}, but {ONE}")

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> NoReturn:
        """Raise UsageError: lanes have no methods of their own."""
        raise UsageError(f"env_method: found {method_name!r}, but {ONE}")

    def env_is_wrapped(self, wrapper_class: type, indices: Any = None) -> list[bool]:
        """No lane has a wrapper."""
        return [False for _ in self._get_indices(indices)]
