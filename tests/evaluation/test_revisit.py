"""Episodes that are simulated again with their recorded actions, and what a policy knows in them."""

from __future__ import annotations

from typing import ClassVar, Literal

import numpy as np
import pytest

from ibdata.errors import PolicyError
from ibdata.evaluation.revisit import revisited
from ibdata.experiment import Experiment
from ibdata.experiment.rollout import rollout
from ibdata.policies import Decision, Needs, Policy

STEPS = 11


class Recalling(Policy):
    """Records what it is given, and remembers a mixture of all of it."""

    needs: ClassVar[Needs] = Needs(history=3, step_draws=3, episode_draws=5, memory=1)
    given: ClassVar[list] = []

    kind: Literal["recalling"] = "recalling"

    def decide(self, given):
        self.given.append(given.apply(np.copy))
        actions = given.uniforms - given.episode_uniforms[:, :3] + 0.1 * given.memory
        memory = 0.5 * given.memory + given.actions[:, 0, :1] + given.uniforms[:, :1] + given.step[:, None]
        return Decision(actions, memory)


class Failing(Recalling):
    def decide(self, given):
        return Decision(np.full((len(given.step), 3), np.nan if given.step[0] == 4 else 0.0), given.memory)


@pytest.fixture(params=["default", {"burn_in": [2, 6]}], ids=str)
def played(request, monkeypatch):
    """An experiment of 8 episodes, its columns (columns, 8, steps), and what its policy was given."""
    monkeypatch.setattr(Recalling, "given", [])
    plain = {"name": "x", "setpoints": {"drifting": [20.0, 70.0]}, "episodes": 4, "steps": STEPS}
    output, policies = {"dtype": "float64", "latent": "full"}, [{"kind": "random"}]
    experiment = Experiment.model_validate(
        {**plain, "policies": policies, "start": request.param, "output": output}
    )
    experiment = Experiment.model_construct(**{**experiment.options(), "policies": [Recalling()]})
    made = rollout(experiment, 0, 8)
    return experiment, made.table.reshape(-1, 8, STEPS), list(Recalling.given)


def actions_of(experiment, table, episodes):
    first = rollout(experiment, 0, 1).names.index("act_velocity")
    return np.ascontiguousarray(table[first : first + 3, episodes].transpose(2, 1, 0), dtype=np.float32)


def test_its_own_policy_knows_at_every_row_what_it_knew_then(played):
    """And the columns are made again, without the log density, which is the last."""
    experiment, table, given = played
    episodes = np.array([6, 1, 3])
    lanes, steps = np.repeat(np.arange(3), STEPS), np.tile(np.arange(STEPS), 3)
    actions = actions_of(experiment, table, episodes)
    found, columns = revisited(experiment, episodes, Recalling(), episodes, actions, lanes, steps)
    np.testing.assert_array_equal(columns[:-1].reshape(-1, 3, STEPS), table[:-1, episodes])
    for i, (lane, step) in enumerate(zip(lanes, steps, strict=True)):
        then, episode = given[step], episodes[lane]
        assert (found.past.observations[i] == then.observations[episode]).all()
        assert (found.past.actions[i] == then.actions[episode]).all()
        assert (found.memory[i] == then.memory[episode]).all()
        assert (found.draws[i] == then.episode_uniforms[episode]).all()
        assert (found.state.floats[:6, i] == then.observations[episode, 0].astype(np.float64)).mean() < 1
        assert (found.state.floats[:6, i].astype(np.float32) == then.observations[episode, 0]).all()


def test_an_error_names_the_episode_and_the_step(played):
    experiment, table, _ = played
    episodes = np.array([6, 1, 3])
    faulty, actions = Failing(name="faulty"), actions_of(experiment, table, episodes)
    lanes, steps = np.array([0]), np.array([STEPS - 1])
    with pytest.raises(PolicyError, match=r"^policy faulty: episode 6: step 4: found action \[nan"):
        revisited(experiment, episodes, faulty, episodes, actions, lanes, steps)
