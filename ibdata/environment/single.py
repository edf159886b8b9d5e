"""The benchmark as a `gymnasium.Env`."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arguments import public
from ibdata._numerics.random import Purpose, Raw
from ibdata.dynamics import State
from ibdata.environment.actions import continuous_action, discrete_action
from ibdata.environment.replayed import RecordedStream, Replay
from ibdata.environment.settings import Fixed, settings
from ibdata.environment.simulation import Indices, Lane
from ibdata.environment.spaces import spaces
from ibdata.environment.streams import refuse_negative
from ibdata.errors import UsageError

# After the spaces, whose module says what to install where there is no Gymnasium.
import gymnasium as gym  # isort: skip

Observation = npt.NDArray[np.float32]


class IndustrialBenchmarkEnv(Fixed, gym.Env[Observation, npt.NDArray[np.float32]]):
    """The Industrial Benchmark as a Gymnasium environment.

    It never terminates; `gymnasium.make` adds a limit of steps, which truncates episodes. Observations are
    float32 (6 · history,): setpoint, velocity, gain, shift, fatigue, consumption, newest first. Actions are
    (Δv, Δg, Δh), clipped to [-1, 1] and rounded to float32. `info` holds the hidden part of the Markov state
    under the names of a dataset's columns. Unless `reset` replays an episode of a dataset, all random numbers
    come from `np_random`.

    Args:
        setpoint: a number, by default 70; "drifting" (starts at 50), or {"drifting": a number}.
        dynamics: "siemens", "paper", {"base": "paper", "eta_mean": 0.1}, or a `Variant`.
        start: "default" (velocity, gain, shift = 50), "uniform", or {"burn_in": [fewest, most]} random steps.
        history: the number of observations returned together, of a burn-in too; the first one is repeated.
        view: what is seen and rewarded, as the options of a view (the page "Views and costs"),
            such as {"reward_scale": 0.01}. The classic reward is -consumption - 3 · fatigue of the new state.
        discrete_actions: whether actions are whole numbers from 0 to 26, which name a change of -1, 0 or 1 of
            velocity, gain and shift: 0 is (-1, -1, -1), 1 is (-1, -1, 0), 26 is (1, 1, 1).
        render_mode: "rgb_array" or None.

    Raises:
        ConfigError: setpoint, dynamics or start are invalid.
        UsageError: another setting or an action is invalid.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"], "render_fps": 10}

    @public
    def __init__(self, render_mode: str | None = None, **options: Any) -> None:
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise UsageError(f"render_mode: found {render_mode!r}, expected rgb_array or None")
        chosen = settings(**options)
        self.render_mode, self.__dict__["view"] = render_mode, chosen.view
        self.observation_space, self.action_space = spaces(chosen)
        self._checked = discrete_action if chosen.discrete_actions else continuous_action
        self._lane = Lane(chosen)
        self._replayed: RecordedStream | None = None  # in place of np_random
        self._began = False
        self._seen: list[dict[str, float]] = []  # of the episode, for the picture

    @public
    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode. Returns the first observation and the hidden state.

        Args:
            seed: seeds `np_random`.
            options: {"dataset": ds, "episode": i} begins as episode i of a dataset, a `Dataset` or its place,
                with its setpoint and after its burn-in. Its random numbers replace those of `np_random` in
                all steps until the next `reset` or `set_state`. So its actions give its rows again, and
                other actions meet the same noise.

        Raises:
            UsageError: There is no such episode, or `dynamics` or `setpoint` do not fit it.
            DatasetError: This ibdata cannot simulate the dataset again.
        """
        refuse_negative([seed])
        replay = Replay.asked_for(options, self._lane.settings, 1)
        super().reset(seed=seed)
        self._replayed = None
        if replay is None:
            self._lane.reset(self._lane.everyone, self._draw)
        else:
            [self._replayed] = replay.begin(self._lane, self._lane.everyone)
        return self._begin()

    def set_state(self, state: State) -> tuple[Observation, dict[str, Any]]:
        """Go on from a state instead of that of `reset`.

        The wrappers of `gymnasium.make` want a `reset` before, from which they count the steps; so
        `env.reset(seed=0); env.unwrapped.set_state(state)`. Random numbers come from `np_random`.

        Args:
            state: A state of one lane, such as `ibdata.state_at` returns. Its setpoint replaces that of the
                environment. The dynamics should be those under which it arose; a published variant refuses a
                state of the other one.

        Returns:
            The observation, repeated if the environment returns several, and the hidden state.

        Raises:
            UsageError: It is no such state, or its setpoint moves and that of the environment does not, or
                the reverse.
        """
        self._lane.set_state(state, self._lane.everyone, self._draw)
        self._replayed = None
        return self._begin()

    @property
    def state(self) -> State:
        """A copy of the exact state, of one lane; `set_state` and `ibdata.rollouts` take it."""
        return self._lane.carry.state.take(self._lane.everyone)

    def _begin(self) -> tuple[Observation, dict[str, Any]]:
        self._began, self._seen = True, []
        if self.render_mode is not None:
            self._seen.append(self._lane.drawn())
        info = {name: values[0].item() for name, values in self._lane.info().items()}
        return self._lane.observations()[0], info

    def step(self, action: npt.NDArray[np.float32]) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Advance by one step. Returns the observation, the reward, False, False and the hidden state."""
        if not self._began:
            raise gym.error.ResetNeeded("step: found no episode, expected reset() before")
        lane, proposed = self._lane, self._checked(action)
        raw = (self._replayed or self.np_random.bit_generator).random_raw(lane.draws)
        seen, reward, info = lane.move(proposed, raw)
        if self.render_mode is not None:
            self._seen.append(lane.drawn())
        return seen, reward, False, False, info

    def _draw(self, lanes: Indices, purpose: Purpose, step: int, steps: int, slots: int) -> Raw:
        integers: Raw = self.np_random.bit_generator.random_raw(steps * slots)
        return integers.reshape(steps, slots, 1)

    def render(self) -> npt.NDArray[np.uint8] | None:
        """The episode so far as a picture (height, width, 3); needs the extra `plot`."""
        if self.render_mode is None:
            raise UsageError("render: found render_mode None, expected make(…, render_mode='rgb_array')")
        if not self._began:
            raise gym.error.ResetNeeded("render: found no episode, expected reset() before")
        from ibdata.plots.episode import frame

        return frame({name: [step[name] for step in self._seen] for name in self._seen[0]})
