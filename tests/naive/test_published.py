"""What people do with the published package's classes: a row says what somebody does, and what is right."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from ibdata import published
from ibdata.errors import UsageError
from ibdata.published import IDS, IBGym

pytestmark = pytest.mark.usefixtures("global_generator")

# What the authors' class has, and reads or calls in each step. Here, nothing would.
PARTS = ["updateSetPoint", "addAction", "updateFatigue", "updateCurrentOperationalCost"]
PARTS += ["updateOperationalCostConvolution", "updateGS", "updateOperationalCosts", "updateCost"]
WEIGHTS = [
    "CRF",
    "CRC",
    "CRGS",
    "maxRequiredStep",
    "gsBound",
    "gsSetPointDependency",
    "gsScale",
    "gsEnvironment",
]
UNREAD = [*PARTS, *WEIGHTS, "init"]
ACTION = [0.1, -0.1, 0.5]


def part(self, *arguments):
    """A part of the step, as somebody writes it."""


@pytest.mark.parametrize("name", UNREAD)
def test_a_subclass_that_replaces_a_part(name):
    """Somebody's subclass makes the consumption noiseless. It is refused, because nothing would call it."""
    with pytest.raises(UsageError, match=f"^Mine.{name}: found another one, which no step of ibdata reads"):
        type("Mine", (IDS,), {name: part})


@pytest.mark.parametrize("name", UNREAD)
def test_a_weight_that_is_set_on_an_object(name):
    """Somebody sets a weight of the reward, or the bound of the shift. It is refused."""
    ids = IDS(70, inital_seed=3)
    with pytest.raises(UsageError, match=f"^IDS.{name}: found another one, which no step of ibdata reads"):
        setattr(ids, name, 0.0)
    ids.step(ACTION)


@pytest.mark.parametrize("name", UNREAD)
def test_a_weight_that_is_set_on_the_class(name, monkeypatch):
    """Somebody sets it on the class, for all objects. The next step, and a new object, are refused."""
    ids, env = IDS(70, inital_seed=3), IBGym(70, init_seed=1)
    with monkeypatch.context() as patch:
        patch.setattr(IDS, name, part, raising=False)
        for step in (lambda: ids.step(ACTION), lambda: env.step(ACTION), lambda: IDS(70)):
            with pytest.raises(UsageError, match=f"^IDS.{name}: found "):
                step()
    ids.step(ACTION)
    env.step(ACTION)


def test_a_weight_that_is_set_through_the_environment():
    """Somebody writes `env.IB.CRF = 0`. It is refused."""
    env = IBGym(70, init_seed=1)
    with pytest.raises(UsageError, match=r"IDS.CRF: found another one"):
        env.IB.CRF = 0


def test_parts_of_a_mixin():
    """Somebody keeps the replaced part in another class. It is refused where both meet."""

    class Quiet:
        updateCost = part

    with pytest.raises(UsageError, match=r"Both.updateCost: found "):

        class Both(Quiet, IDS):
            pass


def test_a_subclass_with_a_step_of_two_actions():
    """Somebody fixes the shift and gives two actions. `step` itself may be replaced."""

    class Lite(IDS):
        def step(self, delta):
            super().step([*delta[:2], 0.0])

    lite, full = Lite(70, inital_seed=3), IDS(70, inital_seed=3)
    state = np.random.get_state()  # noqa: NPY002
    full.step([0.1, -0.1, 0.0])
    np.random.set_state(state)  # noqa: NPY002
    lite.step([0.1, -0.1])
    np.testing.assert_array_equal(lite.markovState(), full.markovState())
    assert lite.state["h"] == 50.0


def test_a_subclass_with_another_sequence_of_setpoints():
    """Somebody replaces `defineNewSequence`, by a setpoint that rises. It is called."""

    class Rising(IDS):
        def defineNewSequence(self):
            self._p_steps, self._p_step, self._p_ch = 10, 0, 0.5

    ids = Rising(20, stationary_p=False, inital_seed=1)
    setpoints = [ids.state["p"]]
    for _ in range(25):
        ids.step(ACTION)
        setpoints.append(ids.state["p"])
    np.testing.assert_allclose(np.diff(setpoints), 0.5)


def test_attributes_of_ones_own():
    """Somebody keeps notes on the object and adds methods to a subclass. Both may be there."""

    class Counting(IDS):
        steps = 0

        def step(self, delta):
            self.steps += 1
            super().step(delta)

    ids = Counting(70, inital_seed=3)
    ids.step(ACTION)
    ids.mine = "a note"
    assert (ids.steps, ids.mine) == (2, "a note")


def test_reading_the_weights():
    """Somebody computes the reward from the weights. They are there, on the object."""
    ids = IDS(70, inital_seed=3)
    ids.step(ACTION)
    assert ids.state["reward"] == pytest.approx(-ids.CRC * ids.state["c"] - ids.CRF * ids.state["f"])


def test_a_setpoint_that_is_written():
    """Somebody moves the setpoint by hand. The next step has it."""
    ids = IDS(70, inital_seed=3)
    ids.state["p"] = 20.0
    ids.step(ACTION)
    assert ids.state["p"] == 20.0
    assert ids.state["he"] == pytest.approx(0.05 * ids.state["h"] - 0.4 - 1.5)


def test_observed_keys_that_are_chosen():
    """Somebody writes `observable_keys`. `visibleState` has them."""
    ids = IDS(70, inital_seed=3)
    ids.observable_keys = ["p", "ve"]
    assert ids.visibleState().tolist() == [70.0, ids.state["ve"]]


def test_copies_of_a_simulator():
    """Somebody tries actions on copies. A copy goes on from the same state, and the first one stays."""
    ids = IDS(70, inital_seed=3)
    ids.step(ACTION)
    before = ids.markovState()
    for other in (copy.deepcopy(ids), pickle.loads(pickle.dumps(ids))):
        np.testing.assert_array_equal(other.markovState(), before)
        other.step(ACTION)
        assert (other.markovState() != before).any()
    np.testing.assert_array_equal(ids.markovState(), before)


def test_settings_of_the_environment_that_are_changed():
    """Somebody changes reward and length between episodes. They hold from then on."""
    env = IBGym(70, init_seed=1)
    env.setpoint, env.reset_after_timesteps, env.reward_function = 20, 3, "delta"
    assert env.reset()[0] == 20
    before = env.reward
    _, reward, _, _ = env.step(ACTION)
    assert reward == pytest.approx(env.reward - before)
    assert [env.step(ACTION)[2] for _ in range(2)] == [False, True]


@pytest.mark.parametrize(
    ("name", "value"),
    [("reward_function", "Delta"), ("action_type", "box"), ("observation_type", "past")],
)
def test_a_setting_of_the_environment_that_is_misspelled_later(name, value):
    """Somebody changes a setting to a word that it does not know. The next step is refused, as there."""
    env = IBGym(70, init_seed=1)
    setattr(env, name, value)
    with pytest.raises(ValueError, match=f"{name.removesuffix('_function')}.*: found '{value}', expected "):
        env.step(ACTION)


def test_another_simulator_in_the_environment():
    """Somebody puts a simulator of their own into the environment. It is stepped, until `reset`."""

    class Doubled(IDS):
        def step(self, delta):
            super().step(2 * np.asarray(delta))

    env = IBGym(70, init_seed=1)
    env.IB = Doubled(70, inital_seed=3)
    env.step([0.25, 0.0, 0.0])
    assert env.IB.state["v"] == 50.5


def test_a_subclass_of_the_environment():
    """Somebody changes what is observed in a subclass. It is called."""

    class Scaled(IBGym):
        def _update_observation(self):
            return super()._update_observation() / 100.0

    env = Scaled(70, init_seed=1)
    assert env.reset()[0] == 0.7
    assert env.step(ACTION)[0][0] == 0.7


def test_options_of_a_reset():
    """Somebody gives options to `reset`, which has none. They are refused; an empty mapping is not."""
    env = IBGym(70, init_seed=1)
    assert env.reset(options={})[0] == 70
    with pytest.raises(ValueError, match=r"^options: found {'setpoint': 20}, expected no options"):
        env.reset(options={"setpoint": 20})


def test_a_loop_with_seeds():
    """Somebody resets with seeds in a loop, twice. The episodes are the same."""
    env, seen = IBGym(70), []
    for seed in (1, 2, 1, 2):
        env.reset(seed=seed)
        seen.append(env.step(ACTION)[0].tolist())
    assert seen[:2] == seen[2:]
    assert seen[0] != seen[1]


def test_two_simulators_at_once():
    """Somebody steps two simulators in turn. They share NumPy's stream, as there, and nothing else."""
    one, two = IDS(70, inital_seed=3), IDS(20, inital_seed=3)
    one.step(ACTION)
    before = one.markovState()
    two.step(ACTION)
    np.testing.assert_array_equal(one.markovState(), before)
    assert published.IDS is IDS
