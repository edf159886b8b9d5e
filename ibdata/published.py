"""`IDS` and `IBGym` of the authors' package `industrial-benchmark-python` 2.0, for scripts that import it.

Names, arguments, attributes and numbers are that package's. Its draws, from NumPy's global generator and in
its order, become the noise of `ibdata.dynamics.step`. The page "Coming from the
published package" says what is different.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable
from functools import cached_property
from itertools import chain, product
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from ibdata._numerics.arrays import Floats
from ibdata.dynamics import SIEMENS, Noise, State, step
from ibdata.dynamics.consumption import FATIGUE_WEIGHT, PENALTY_WEIGHT
from ibdata.dynamics.setpoint import segment_rate
from ibdata.dynamics.state import NO_DRIFT, THETAS
from ibdata.dynamics.step import advance
from ibdata.errors import UsageError, excerpt, missing
from ibdata.views.variables import rows

try:
    import gymnasium
except ModuleNotFoundError:  # only the spaces need it
    gymnasium = None
Env: Any = gymnasium.Env if gymnasium else object

STATE_KEYS = {  # of ibdata, by the keys of the published state that follow "o", in their order
    "coc": "theta_0", "fb": "basic_fatigue", "oc": "convolved_cost", "hg": "mu_g", "hv": "mu_v",
    "he": "effective_shift", "gs_domain": "domain", "gs_sys_response": "response", "gs_phi_idx": "direction",
    "ge": "effective_gain", "ve": "effective_velocity", "MC": "penalty", "p": "setpoint", "v": "velocity",
    "g": "gain", "h": "shift", "f": "fatigue", "c": "consumption", "cost": "reward", "reward": "reward",
}  # fmt: skip
ROWS = list(rows(*STATE_KEYS.values()))
NEGATED, WHOLE = ("MC", "cost"), ("gs_domain", "gs_sys_response", "gs_phi_idx")
RATE, LEFT = rows("drift_rate", "drift_left")
START = {"v": 50.0, "g": 50.0, "h": 50.0, "gs_domain": 1, "gs_sys_response": 1, "gs_phi_idx": 0}
OBSERVED = {"setpoint": "p", "velocity": "v", "gain": "g", "shift": "h", "fatigue": "f", "consumption": "c"}
HIDDEN = {"ml1": "gs_domain", "ml2": "gs_sys_response", "ml3": "gs_phi_idx", "hv": "hv", "hg": "hg"}

# Of `allStates`, as in the authors' repository; the package does not have it.
ALL = ("p", "v", "g", "h", "f", "c", "reward", "coc", "he", "ge", "ve", "MC", "fb", "oc", "gs_domain",
       "gs_sys_response", "gs_phi_idx")  # fmt: skip

# What each step of the package's class calls or reads, and no step does here.
UNREAD = {"CRF", "CRC", "CRGS", "maxRequiredStep", "gsBound", "gsSetPointDependency", "gsScale", "init",
          "gsEnvironment", "updateSetPoint", "addAction", "updateFatigue", "updateCurrentOperationalCost",
          "updateGS", "updateOperationalCostConvolution", "updateOperationalCosts", "updateCost"}  # fmt: skip

QUIET = dict.fromkeys(Noise._fields, 0.0)
NO_EVENT = 1.0 - 2.0**-53  # the uniform draw that is below no probability


class IDS:
    """The simulator of the published package: one episode, whose `state` scripts read, and may write.

    Args:
        p: setpoint, in [0, 100].
        stationary_p: whether the setpoint is constant.
        inital_seed: seeds NumPy's global generator; None seeds it with entropy of the system.

    Raises:
        ValueError: the setpoint is out of range.
    """

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        _refuse_unread(cls, *map(vars, cls.__mro__))

    def __setattr__(self, name: str, value: Any) -> None:
        _refuse_unread(type(self), [name])
        super().__setattr__(name, value)

    def __init__(self, p: float = 50, stationary_p: bool = True, inital_seed: Any = None) -> None:
        np.random.seed(inital_seed)
        vars(self).update(CRF=FATIGUE_WEIGHT, CRC=1.0, CRGS=PENALTY_WEIGHT)
        self.stationary_p = stationary_p
        self.observable_keys = ["p", "v", "g", "h", "f", "c", "cost", "reward"]
        self.state: OrderedDict[str, Any] = OrderedDict(o=np.zeros(10), **dict.fromkeys(STATE_KEYS, 0.0))
        self.state.update(START, p=p)
        self.defineNewSequence()
        self.step(np.zeros(3))

    def visibleState(self) -> Floats:
        """The values of `observable_keys`: p, v, g, h, fatigue, consumption, cost and reward."""
        return np.hstack([self.state[key] for key in self.observable_keys])

    def markovState(self) -> Floats:
        """All values of `state`, in its order: first the ten operational costs, the oldest first."""
        return np.hstack(list(self.state.values()))

    def allStates(self) -> Floats:
        """17 values of `state` in the order of the authors' tests, see `ALL`."""
        return np.array([self.state[key] for key in ALL])

    def operational_cost_Buffer(self) -> Floats:
        """A copy of the ten operational costs, the oldest first."""
        return np.array(self.state["o"])

    def defineNewSequence(self) -> None:
        """Draw the next segment of a moving setpoint: its length and its rate."""
        self._p_steps, self._p_step = np.random.randint(1, 1 + SIEMENS.drift_length), 0
        self._p_ch = segment_rate(np.random.rand(), np.random.rand(), *SIEMENS.drift_rate)

    def step(self, delta: npt.ArrayLike) -> None:
        """Advance by one step.

        Args:
            delta: (Δv, Δg, Δh), clipped to [-1, 1].

        Raises:
            ValueError: delta or `state` is out of range, or something that no step reads was replaced.
        """
        _refuse_unread(type(self), *map(vars, type(self).__mro__))
        action = np.array(delta, dtype=np.float64)[None]
        flip = self._drift_flip()
        state = self._read()
        # Which draws follow depends on where the step leads, and that depends on no other draw.
        ahead = step(state, action, Noise(*_noise(uniform_drift_flip=flip)), SIEMENS)
        noise = _noise(uniform_drift_flip=flip, **_draws(ahead))
        advance(state.values, action, noise, SIEMENS.parameters)  # as `step`, which has checked the arguments
        self._write(state)

    def _drift_flip(self) -> float:
        if self.stationary_p:
            return 0.0
        if self._p_step == self._p_steps:
            self.defineNewSequence()
        leaves = not 0.0 <= self.state["p"] + self._p_ch <= 100.0
        return 0.0 if leaves and np.random.rand() > 0.5 else 0.5

    def _read(self) -> State:
        state = State.zeros(1)
        numbers = state.values[:, 0]
        numbers[ROWS] = [self.state[key] for key in STATE_KEYS]
        numbers[THETAS] = self.state["o"][::-1]
        numbers[RATE] = self._p_ch
        numbers[LEFT] = NO_DRIFT if self.stationary_p else self._p_steps - self._p_step
        return state

    def _write(self, state: State) -> None:
        numbers = state.values[:, 0]
        written = dict(zip(STATE_KEYS, numbers[ROWS], strict=True))
        written.update({key: -written[key] for key in NEGATED})
        written.update({key: int(written[key]) for key in WHOLE})
        if self.stationary_p:
            del written["p"]  # which stays as it was given
        else:
            self._p_ch, self._p_step = numbers[RATE], self._p_step + 1
        self.state.update(written)
        self.state["o"][:] = numbers[THETAS][::-1]


def _refuse_unread(cls: type[IDS], *names: Iterable[str]) -> None:
    if unread := UNREAD.intersection(chain.from_iterable(names)):
        raise UsageError(
            f"{cls.__name__}.{min(unread)}: found another one, which no step of ibdata reads; for other "
            "equations take `dynamics` of an experiment, for other weights `reward` of a view"
        )


def _draws(ahead: State) -> dict[str, float]:
    """The draws of a step in the package's order; `ahead` is the state to which it leads without them."""
    draws = {
        "exp_g": np.random.standard_exponential(),
        "exp_v": np.random.standard_exponential(),
        "uniform_g": np.random.rand(),
        "uniform_v": np.random.rand(),
        "bernoulli_g": _event(ahead.effective_gain[0]),
        "bernoulli_v": _event(ahead.effective_velocity[0]),
    }
    # No draw lifts a μ to 5: those that depend on one are below 0.9 · 1.2 + 1/3.
    if max(ahead.mu_v[0], ahead.mu_g[0]) >= SIEMENS.alpha_threshold:
        draws["normal_alpha"] = np.random.randn()
    draws["normal_consumption"] = -np.random.randn()  # which the package subtracts
    return draws


def _event(effective: float) -> float:
    low, high = SIEMENS.bernoulli_bounds
    return 0.0 if np.random.binomial(1, min(max(effective, low), high)) else NO_EVENT


def _noise(**draws: float) -> Floats:
    """A table (12, 1) of the draws of `Noise`, of which others do nothing."""
    return np.array(list({**QUIET, **draws}.values()))[:, None]


class IBGym(Env):
    """The environment of the published package.

    `step` after the end of an episode begins the next one silently, as there.

    Args:
        setpoint: in [0, 100], constant.
        reward_type: "classic", or "delta" for the difference from the reward of the step before.
        action_type: "continuous", or "discrete" for whole numbers from 0 to 26.
        observation_type: "classic" (6,), or "include_past" (6 · n_past_timesteps,), newest first.
        reset_after_timesteps: steps of an episode.
        init_seed: seeds NumPy's global generator; None seeds it with entropy of the system. Each later
            episode seeds it too, with a number below 100,000 that was drawn when the one before began.
        n_past_timesteps: the number of frames of "include_past".
        new_step_api: whether `step` and `reset` return what Gymnasium's do. The end of an episode then
            truncates it, and the observation space has float64 and bounds that hold.

    Raises:
        ValueError: an option is unknown, or the setpoint is out of range.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["human"]}

    def __init__(
        self,
        setpoint: float,
        reward_type: str = "classic",
        action_type: str = "continuous",
        observation_type: str = "classic",
        reset_after_timesteps: int = 1000,
        init_seed: Any = None,
        n_past_timesteps: int = 30,
        new_step_api: bool = False,
    ) -> None:
        self.setpoint, self.init_seed, self.new_step_api = setpoint, init_seed, new_step_api
        self.reward_function, self.action_type = reward_type, action_type
        self.observation_type, self.n_past_timesteps = observation_type, n_past_timesteps
        self.reset_after_timesteps = reset_after_timesteps
        self.last_action: Any = None
        if action_type == "discrete":
            self.env_action = [list(changes) for changes in product((-1, 0, 1), repeat=3)]
        self.reset()

    @cached_property
    def action_space(self) -> Any:
        """`Discrete(27)`, or a box (3,) from -1 to 1. Needs Gymnasium."""
        spaces = _spaces("IBGym.action_space")
        discrete = self.action_type == "discrete"
        return spaces.Discrete(27) if discrete else spaces.Box(-1.0, 1.0, (3,), np.float32)

    @cached_property
    def observation_space(self) -> Any:
        """A box with the published bounds, which consumption exceeds, or with valid ones. Needs Gymnasium."""
        spaces = _spaces("IBGym.observation_space")
        kind = np.float64 if self.new_step_api else np.float32
        bounds = np.array([[0.0] * 6, [100.0] * 4 + [1000.0] * 2], kind)
        if self.new_step_api:
            from ibdata.environment.settings import consumption_bounds

            bounds[:, 5] = consumption_bounds(SIEMENS)
        frames = self.n_past_timesteps if self.observation_type == "include_past" else 1
        low, high = np.tile(bounds, frames)
        return spaces.Box(low, high, dtype=kind)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Begin an episode. Returns the observation; with `new_step_api` also `info`.

        Args:
            seed: seeds NumPy's global generator, in place of the number that was drawn for it.
            options: none are known.
        """
        self._check_settings()
        if options:
            raise UsageError(f"options: found {excerpt(options)}, expected no options")
        if gymnasium is not None:
            super().reset(seed=seed)
        self.IB = IDS(self.setpoint, inital_seed=self.init_seed if seed is None else seed)
        self.init_seed = np.random.randint(0, 100000)
        self.observation: Any = []
        observation = self._update_observation()
        self.info = self._markovian_state()
        self.reward = self.smoothed_reward = self.IB.state["reward"]
        self.delta_reward = 0.0
        self.env_steps, self.done = 0, False
        return (observation, self.info) if self.new_step_api else observation

    def step(self, action: Any) -> tuple[Any, ...]:
        """Advance by one step. Returns observation, reward, whether the episode ended, and the Markov state.

        With `new_step_api`, False stands before whether the episode ended.
        """
        self._check_settings()
        if self.done:
            self.reset()
        self.last_action = action
        self.IB.step(self.env_action[action] if self.action_type == "discrete" else action)
        observation, reward = self._update_observation(), self.IB.state["reward"]
        self.delta_reward, self.reward = reward - self.reward, reward
        self.smoothed_reward = 0.9 * self.smoothed_reward + 0.1 * reward
        self.env_steps += 1
        self.done = self.env_steps >= self.reset_after_timesteps
        self.info = self._markovian_state()
        rewarded = self.delta_reward if self.reward_function == "delta" else reward
        ended = (False, self.done) if self.new_step_api else (self.done,)
        return observation, rewarded, *ended, self.info

    def render(self, mode: str = "human") -> None:
        """Print reward, velocity, gain and shift, and the last action."""
        steerings = self.IB.visibleState()[1:4]
        print("Reward:", self.reward, "State (v,g,s):", steerings, "Action: ", self.last_action)

    def close(self) -> None:
        """Do nothing."""

    def _check_settings(self) -> None:
        _check("reward_type", self.reward_function, "classic", "delta")
        _check("action_type", self.action_type, "discrete", "continuous")
        _check("observation_type", self.observation_type, "classic", "include_past")

    def _update_observation(self) -> Floats:
        frame = self.IB.visibleState()[:-2]
        if self.observation_type == "classic":
            self.observation = frame
            return frame
        n = self.n_past_timesteps
        self.observation = [frame, *(self.observation or [frame] * n)[: n - 1]]
        return np.hstack(self.observation)

    def _markovian_state(self) -> OrderedDict[str, Any]:
        state = self.IB.state
        costs = {f"op_cost_t{i}": cost for i, cost in enumerate(state["o"])}  # the oldest first
        observed, hidden = ({name: state[key] for name, key in keys.items()} for keys in (OBSERVED, HIDDEN))
        return OrderedDict({**observed, **costs, **hidden})


def _spaces(what: str) -> Any:
    if gymnasium is None:
        raise missing(what, "gymnasium", "gymnasium")
    return gymnasium.spaces


def _check(name: str, value: str, *known: str) -> None:
    if value not in known:
        raise UsageError(f"{name}: found {excerpt(value)}, expected {' or '.join(known)}")
