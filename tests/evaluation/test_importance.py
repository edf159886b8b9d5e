"""Importance weights: which pairs of policies have support, and that the weights are right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers import ROOT, networks

import ibdata
from ibdata.errors import UsageError
from ibdata.evaluation.importance import of_ratios
from ibdata.evaluation.overlap import check_support, log_ratios
from ibdata.experiment import Experiment
from ibdata.policies import POLICIES
from ibdata.policies.support import INSIDE, each
from ibdata.simulation.rollout import rollout

N, FEW, STEPS = 100_000, 1000, 3
BAD = {"kind": "bad"}
HALF = {"base": BAD, "epsilon": 0.5}
BLOCKS = {
    "random": {"kind": "random"},
    "safe": {"kind": "safe"},
    "bad": BAD,
    "mediocre": {"kind": "mediocre"},
    "optimized": {"kind": "optimized"},
    "expert": {"kind": "expert"},
    "constant": {"kind": "constant"},
    "prbs": {"kind": "prbs"},
    "multisine": {"kind": "multisine"},
    "ε-greedy": {"kind": "epsilon_greedy", **HALF},
    "ε-greedy per dimension": {"kind": "epsilon_greedy", **HALF, "per_dimension": True},
    "ε-greedy of safe": {"kind": "epsilon_greedy", "base": {"kind": "safe"}, "epsilon": 0.5},
    "ε-greedy of expert": {"kind": "epsilon_greedy", "base": {"kind": "expert"}, "epsilon": 0.2},
    "gaussian": {"kind": "gaussian", "base": BAD, "scale": 1.0},
    "ornstein_uhlenbeck": {"kind": "ornstein_uhlenbeck", "sigma": 0.7},
    "coloured_noise": {"kind": "coloured_noise", "period": 4},
    "sticky random": {"kind": "sticky", "base": {"kind": "random"}, "kappa": 0.3},
    "sticky bad": {"kind": "sticky", "base": BAD, "kappa": 0.5},
    "sticky ε-greedy": {"kind": "sticky", "base": {"kind": "epsilon_greedy", **HALF}, "kappa": 0.3},
    "mixture": {"kind": "mixture", "bases": [{"kind": "random"}, {"kind": "safe"}]},
    "schedule": {"kind": "schedule", "stages": [{"base": BAD, "steps": 3, "epsilon": [0.9, 0.2]}]},
}


def policy_of(block):
    return POLICIES[block["kind"]](**block)


POLICY = {name: policy_of(block) for name, block in BLOCKS.items()}


class Data:
    """The episodes of a behaviour in memory."""

    def __init__(self, policy, episodes=N):
        plain = {"name": "x", "setpoints": 70, "episodes": episodes, "steps": STEPS, "start": "uniform"}
        self.experiment = Experiment(**plain, policies=[policy])
        columns = rollout(self.experiment, 0, episodes)
        found = dict(zip(columns.names, columns.table, strict=True))

        def grid(prefix):
            names = [name for name in columns.names if name.startswith(prefix)]
            return np.stack([found[name] for name in names], axis=1).reshape(episodes, STEPS, -1)

        self.observations, self.actions = (grid(role).astype(np.float32) for role in ("obs_", "act_"))
        self.log_prob, self.rewards = (
            found[name].astype(np.float64).reshape(episodes, STEPS) for name in ("action_log_prob", "reward")
        )

    def importance(self, target, episodes=None):
        """The estimates from all or from the first episodes."""
        notes = check_support(self.experiment.policies[0], target, STEPS)
        seen, actions, log_prob, rewards = (
            array[:episodes] for array in (self.observations, self.actions, self.log_prob, self.rewards)
        )
        ratios = log_ratios(self.experiment, 0, len(actions), seen, actions, log_prob, target)
        return of_ratios(target.label, ratios, rewards, 0.97, notes)


def supported(behaviour, target):
    try:
        return check_support(behaviour, target, STEPS) == []
    except UsageError:
        return False


@pytest.mark.slow
@pytest.mark.parametrize("name", POLICY)
def test_the_mean_weight_is_1_or_a_message_says_why_not(name):
    """Over all targets: there is no support, or the weights have the mean 1, or the result has a warning."""
    behaviour = POLICY[name]
    targets = [target for target in POLICY.values() if supported(behaviour, target)]
    data = Data(behaviour, N if len(targets) > 1 else FEW)
    if name == "coloured_noise":
        with pytest.raises(UsageError, match="policy coloured_noise: found no log density"):
            data.importance(behaviour)
        return
    own = data.importance(behaviour, FEW).weights
    assert own == pytest.approx(np.ones((FEW, STEPS)), rel=1e-5)  # stored as float32
    for target in targets:
        if target is behaviour:
            continue
        found = data.importance(target)
        last = found.weights[:, -1]
        if found.effective[-1] < 100:
            assert "below 100" in found.notes[-1]
        else:
            error = last.std(ddof=1) / np.sqrt(N)
            assert last.mean() == pytest.approx(1.0, abs=4.0 * error), target.label
            assert found.notes == []


def test_every_policy_takes_part():
    """Of custom policies nobody knows the support; networks have a test of their own."""
    kinds = {policy.kind for outer in POLICY.values() for policy in outer.everywhere()}
    assert set(POLICIES) - kinds == {"custom", "network", "sampled"}


@pytest.mark.slow
def test_draws_of_a_network_evaluate_its_mean_action_and_more_draws(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("actor.safetensors").write_bytes(networks.weights(frames=1))
    network = policy_of({"kind": "network", "file": "actor.safetensors"})
    few, more = (
        policy_of({"kind": "sampled", "base": network.options() | {"name": None}, "share": share})
        for share in (0.3, 0.6)
    )
    data = Data(few, 20_000)
    for target in (network, more):
        last = data.importance(target).weights[:, -1]
        assert last.mean() == pytest.approx(1.0, abs=4.0 * last.std(ddof=1) / np.sqrt(len(last)))
    with pytest.raises(UsageError, match="the action of network in the whole action"):
        check_support(policy_of({**few.options(), "share": 1.0}), network, STEPS)


# What the page says of pairs, by data and target; a base is always the same one.
TABLE = {
    "random": POLICY["random"],
    "safe": POLICY["safe"],
    "base": POLICY["bad"],
    "ε-greedy": POLICY["ε-greedy"],
    "per dimension": POLICY["ε-greedy per dimension"],
    "gaussian": POLICY["gaussian"],
    "sticky": POLICY["sticky bad"],
}


def test_the_page_says_which_pairs_have_support():
    shown = ["| data of \\ target | " + " | ".join(TABLE) + " |", "|---" * (len(TABLE) + 1) + "|"]
    for name, behaviour in TABLE.items():
        cells = ["yes" if supported(behaviour, target) else "–" for target in TABLE.values()]
        shown.append(f"| {name} | " + " | ".join(cells) + " |")
    page = (ROOT / "docs/off-policy-evaluation.md").read_text(encoding="utf-8")
    assert "\n".join(shown) in page


@pytest.mark.parametrize(
    ("name", "target", "said"),
    [
        (
            "random",
            "safe",
            "safe: found point masses at ±1 for some observations in velocity and gain,",
        ),
        ("safe", "gaussian", "found point masses at ±1 in velocity, gain and shift, where the data of safe"),
        ("random", "bad", "found a point mass at the action of bad in the whole action"),
        ("bad", "random", "found a density on (-1, 1) in the whole action, where the data of bad have none"),
        ("ε-greedy of safe", "ε-greedy", "found a point mass at the action of bad in the whole action"),
        ("random", "sticky random", "found a point mass at the last action in the whole action"),
        ("safe", "ε-greedy per dimension", "a point mass at the action of bad in velocity, gain and shift"),
        ("ε-greedy", "ε-greedy per dimension", "(-1, 1) in gain together with a point mass at the action of"),
        ("prbs", "ornstein_uhlenbeck", "which remembers its random numbers"),
        ("mixture", "safe", "found point masses at ±1"),  # in an episode of random
        ("schedule", "gaussian", "found point masses at ±1 in velocity, gain and shift"),
    ],
)
def test_missing_support_is_named(name, target, said):
    with pytest.raises(UsageError) as error:
        check_support(POLICY[name], POLICY[target], STEPS)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_support_changes_with_the_step():
    """At the first step of a schedule every action is random, and at the first of sticky none is repeated."""
    begin = policy_of({"kind": "schedule", "stages": [{"base": BAD, "steps": 3, "epsilon": [1.0, 0.5]}]})
    assert supported(POLICY["schedule"], begin)
    assert not supported(begin, POLICY["schedule"])
    for kappa, one_step in ((0.0, True), (1.0, False)):
        sticky = policy_of({"kind": "sticky", "base": {"kind": "random"}, "kappa": kappa})
        assert supported(POLICY["random"], sticky) is one_step
        assert check_support(POLICY["random"], sticky, steps=1) == []


def test_missing_support_at_some_steps_is_named_with_the_first():
    stages = [{"base": POLICY["ε-greedy"].model_dump(), "steps": 2}, {"base": {"kind": "random"}}]
    with pytest.raises(
        UsageError, match="found a point mass at the action of bad in the whole action at step 2,"
    ):
        check_support(policy_of({"kind": "schedule", "stages": stages}), POLICY["ε-greedy"], STEPS)


def test_a_density_of_mixed_measures_is_refused():
    """Half of the actions replaced around numbers that are replaced one by one."""
    inner = POLICY["ε-greedy per dimension"]
    stages = [{"base": inner.model_dump(), "epsilon": [0.5, 0.5]}]
    around = policy_of({"kind": "schedule", "stages": stages})
    for behaviour, target in ((around, inner), (POLICY["random"], around)):
        with pytest.raises(
            UsageError, match="found a schedule with epsilon around a policy with per_dimension"
        ):
            check_support(behaviour, target, STEPS)
    assert check_support(around, around, STEPS) == []
    without = policy_of({"kind": "schedule", "stages": [{"base": inner.model_dump()}]})
    assert check_support(without, inner, STEPS) == []


def test_an_action_drawn_for_the_episode_supports_only_itself():
    around = policy_of({"kind": "epsilon_greedy", "base": {"kind": "prbs"}, "epsilon": 0.5})
    with pytest.raises(UsageError, match="the action of prbs, drawn for each episode, in the whole action"):
        check_support(around, POLICY["prbs"], STEPS)
    assert supported(around, POLICY["random"])


def test_where_only_the_behaviour_has_a_mass_the_ratio_is_0():
    """A density of 1/8 at the base's action is not a probability of it."""
    data = Data(POLICY["ε-greedy"], 50)
    found = data.importance(POLICY["random"])
    kept = np.isclose(np.exp(data.log_prob), 0.5)
    assert 0 < kept.sum() < kept.size
    assert (found.ratios[kept] < 1e-12).all()
    assert found.ratios[~kept] == pytest.approx(2.0)


def test_the_estimates_are_those_of_the_equations():
    ratios, rewards = np.array([[2.0, 0.5], [1.0, 3.0]]), np.array([[-1.0, -2.0], [-4.0, -8.0]])
    found = of_ratios("x", np.log(ratios), rewards, 0.5)
    ordinary, per_decision, weighted = found.results
    assert ordinary.mean_return == pytest.approx((1.0 * -2.0 + 3.0 * -8.0) / 2)
    assert per_decision.mean_return == pytest.approx((2.0 * -1.0 + 1.0 * -1.0 + 1.0 * -4.0 + 3.0 * -4.0) / 2)
    assert weighted.mean_return == pytest.approx((2.0 * -1.0 + 1.0 * -4.0) / 3 + (-1.0 + 3.0 * -4.0) / 4)
    assert found.weights == pytest.approx(np.array([[2.0, 1.0], [1.0, 3.0]]))
    assert found.effective == pytest.approx([9 / 5, 16 / 10])
    assert ordinary.interval[0] < ordinary.mean_return < ordinary.interval[1]
    (note,) = found.notes
    assert note.startswith("warning: an effective sample size of 1.6 is below 100")
    assert note in repr(found)
    assert list(found.to_pandas()["method"]) == ["ordinary", "per decision", "weighted"]


def test_weights_that_are_all_0_have_no_weighted_estimate():
    found = of_ratios("x", np.full((3, 2), -np.inf), np.ones((3, 2)), 1.0)
    assert found.results[2] == ("weighted", None, None, None)
    assert found.effective.tolist() == [0.0, 0.0]
    assert found.notes[1].startswith("warning: all weights are 0 from step 0 on")


def test_steps_from_which_all_weights_are_0_are_named():
    ratios = np.array([[0.0, -np.inf, 0.0, 0.0], [0.0, 0.0, -np.inf, 0.0]])
    found = of_ratios("x", ratios, np.ones((2, 4)), 1.0)
    assert found.effective.tolist() == [2.0, 1.0, 0.0, 0.0]
    assert "are 0 from step 2 on" in found.notes[1]
    assert [each.mean_return for each in found.results] == [0.0, 1.5, None]


def test_the_weights_of_long_episodes_may_be_too_small_for_a_number():
    found = of_ratios("x", np.array([[-1000.0], [-1000.0 - np.log(3.0)]]), np.array([[-4.0], [-8.0]]), 1.0)
    assert found.weights.tolist() == [[0.0], [0.0]]
    assert found.results[2].mean_return == pytest.approx(-5.0)
    assert found.effective == pytest.approx([1.6])


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    """Two policies at two setpoints, in three shards, after a burn-in, with a split of scattered episodes."""
    experiment = Experiment(
        name="x", setpoints=[10, 70], episodes=20, steps=6, start={"burn_in": [2, 5]},
        policies=[POLICY["ε-greedy of expert"], POLICY["random"]], output={"shard_rows": 150},
        splits={"some": {"episodes": {"start": 3, "stop": 11}}},
    )  # fmt: skip
    return ibdata.generate(experiment, tmp_path_factory.mktemp("importance") / "x", workers=1)


def test_selected_episodes_keep_their_weights(dataset):
    """Whatever else is read with them, from any file."""
    whole = ibdata.importance(dataset, "random")
    assert whole.ratios.shape == (80, 6)
    assert whole.ratios[40:] == pytest.approx(np.ones((40, 6)))
    assert set(np.unique(whole.ratios[:40].round(4))) == {0.0, 5.0}
    numbers = dataset.table(["episode"], "some", setpoint=70)["episode"].to_numpy()[::6]
    part = ibdata.importance(dataset, "random", split="some", setpoint=70)
    assert 0 < len(numbers) < 80
    assert part.ratios.tolist() == whole.ratios[numbers].tolist()
    assert part.rewards.tolist() == whole.rewards[numbers].tolist()


def test_memory_is_replayed_along_the_recorded_episode(dataset):
    """The expert remembers what it saw, also of the burn-in; where it acted, the ratio is 1/(1 - ε)."""
    found = ibdata.importance(dataset, "expert", policy="epsilon_greedy")
    assert set(np.unique(found.ratios.round(4))) == {0.0, 1.25}
    log_prob = dataset.table(["action_log_prob"], policy="epsilon_greedy")["action_log_prob"].to_numpy()
    kept = np.isclose(log_prob, np.log(0.8)).reshape(-1, 6)
    assert (found.ratios > 0.0).tolist() == kept.tolist()
    same = ibdata.importance(dataset, POLICY["ε-greedy of expert"], policy="epsilon_greedy")
    assert same.weights == pytest.approx(np.ones((40, 6)), rel=1e-5)
    with pytest.raises(UsageError, match="where the data of random have none"):
        ibdata.importance(dataset, "expert")


class Corner:
    """Uniform on the corner [0, 1]³ of all actions."""

    def act(self, history, u):
        return np.full((len(history), 3), 0.5)

    def log_prob(self, history, action):
        return np.where((action > 0.0).all(axis=1), 0.0, -np.inf)


def test_an_object_may_say_its_support(dataset):
    found = ibdata.importance(dataset, Corner(), policy="random")
    assert set(np.unique(found.ratios.round(4))) == {0.0, 8.0}
    assert found.notes[0] == "support not checked: corner does not declare its support"
    declared = Corner()
    declared.support = each(INSIDE)
    assert ibdata.importance(dataset, declared, policy="random").notes[0].startswith("warning")


class Flat:
    """Uniform on (-1, 1)³, with a density that does not look where it is asked."""

    act = Corner.act

    def log_prob(self, history, action):
        return np.full(len(history), -np.log(8.0))


def test_a_declared_density_on_the_inside_is_0_at_the_edges(dataset):
    """The formula's clipped actions are at ±1, where the measure has point masses."""
    declared = Flat()
    declared.support = each(INSIDE)
    actions = dataset.table(["act_velocity", "act_gain", "act_shift"]).to_pandas().to_numpy()
    corner = (np.abs(actions) == 1.0).all(axis=1).reshape(80, 6)
    assert 0 < corner.sum() < corner.size
    random, found, undeclared = (ibdata.importance(dataset, x) for x in ("random", declared, Flat()))
    assert (found.ratios[corner] == 0.0).all()
    assert found.ratios == pytest.approx(random.ratios)
    assert (undeclared.ratios[corner] > 0.0).all()
    assert undeclared.notes[0] == "support not checked: flat does not declare its support"


def test_bad_arguments_are_named(dataset):
    for arguments, said in (
        ({"target": "random", "discount": 1.5}, "discount: found 1.5"),
        ({"target": "random", "discount": 10**400}, "discount: found 1000"),
        ({"target": lambda seen: np.zeros((len(seen), 3))}, "policy lambda: found no log density"),
        ({"target": "random", "policy": "safe"}, "policy: found 'safe'"),
        ({"target": "random", "history": 2}, "history: found 2, but no object"),
    ):
        with pytest.raises(UsageError, match=said):
            ibdata.importance(dataset, **arguments)


def test_episodes_of_different_lengths_are_refused(dataset, tmp_path):
    plain = {**dataset.manifest["experiments"][0], "steps": 5, "policies": [{"kind": "random"}]}
    other = ibdata.generate(Experiment(**{**plain, "seed": 1}), tmp_path / "other", workers=1)
    both = ibdata.merge([dataset.path, other.path], tmp_path / "both")
    with pytest.raises(UsageError, match="steps: found episodes of 5 and of 6, expected one length"):
        ibdata.importance(both, "random")
