"""The vector environment of ibdata as Stable-Baselines3 expects one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnv

from ibdata.environment import IndustrialBenchmarkVectorEnv
from ibdata.policies.optimized import MEAN, STD

HISTORY = 30
LANES = 20
STEPS = 1000  # of an episode
CLIP = 10.0
Float32s = npt.NDArray[np.float32]


class Lanes(VecEnv):
    """Lanes with standardised observations and rewards times 0.01, in equal parts for each setpoint.

    Episodes end in different lanes at different times, so that the buffer never holds equal steps alone.
    """

    def __init__(self, setpoints: Sequence[float], seed: int) -> None:
        size = LANES // len(setpoints)
        self.parts = [
            IndustrialBenchmarkVectorEnv(
                size, None, "Disabled", setpoint=p, history=HISTORY, view={"reward_scale": 0.01}
            )
            for p in setpoints
        ]
        self.first_seed = seed
        self.mean, self.std = (np.tile(np.float32(x), HISTORY) for x in (MEAN, STD))
        seen = gym.spaces.Box(-CLIP, CLIP, (6 * HISTORY,), np.float32)
        super().__init__(LANES, seen, gym.spaces.Box(-1.0, 1.0, (3,), np.float32))

    def _standardised(self, observations: Float32s) -> Float32s:
        flat = observations.reshape(len(observations), -1)
        return np.clip((flat - self.mean) / self.std, -CLIP, CLIP).astype(np.float32)

    def reset(self) -> Float32s:
        """Begin an episode in every lane."""
        begun = [env.reset(seed=1000 * self.first_seed + 100 * i)[0] for i, env in enumerate(self.parts)]
        self.elapsed = np.arange(LANES) * (STEPS // LANES)
        return self._standardised(np.concatenate(begun))

    def step_async(self, actions: Float32s) -> None:
        """Keep the actions of the next step."""
        self.actions = np.asarray(actions, dtype=np.float32)

    def step_wait(self) -> tuple[Float32s, Float32s, npt.NDArray[np.bool_], list[dict[str, Any]]]:
        """Advance every lane by one step, and begin anew where an episode has ended."""
        split = np.split(self.actions, len(self.parts))
        moved = [env.step(actions) for env, actions in zip(self.parts, split, strict=True)]
        seen = self._standardised(np.concatenate([step[0] for step in moved]))
        rewards = np.concatenate([step[1] for step in moved]).astype(np.float32)
        self.elapsed += 1
        ended = self.elapsed >= STEPS
        infos: list[dict[str, Any]] = [{} for _ in range(LANES)]
        for lane in np.flatnonzero(ended):
            infos[lane] = {"terminal_observation": seen[lane].copy(), "TimeLimit.truncated": True}
        for env, mask, part in zip(
            self.parts,
            np.split(ended, len(self.parts)),
            np.split(np.arange(LANES), len(self.parts)),
            strict=True,
        ):
            if mask.any():
                new, _ = env.reset(options={"reset_mask": mask})
                seen[part[mask]] = self._standardised(new)[mask]
        self.elapsed[ended] = 0
        return seen, rewards, ended, infos

    def close(self) -> None:
        """Do nothing, because nothing is open."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The same attribute for every lane."""
        return [getattr(self, attr_name)] * LANES

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Not needed for training."""
        raise NotImplementedError

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Not needed for training."""
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """No lane has a wrapper."""
        return [False] * LANES
