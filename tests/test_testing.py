"""`ibdata.testing.check_policy` accepts correct policies and describes the faults of others."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
import pytest

from ibdata.errors import PolicyError
from ibdata.policies import POLICIES, Decision, Deterministic, Needs, Policy
from ibdata.testing import check_policy


class Coin(Policy):
    """Up or down, one as often as the other."""

    needs: ClassVar[Needs] = Needs(step_draws=1)
    kind: str = "coin"

    def decide(self, given):
        u = given.uniforms
        return Decision(np.where(u < 0.5, 0.5, -0.5) * np.ones(3), given.memory)

    def log_density(self, given, action):
        return np.where(np.isin(action, (0.5, -0.5)).all(axis=1), np.log(0.5), -np.inf)


class Changing(Coin):
    def decide(self, given):
        given.observations[:] = 0.0
        return Decision(super().decide(given).actions, given.memory)


class Batch(Coin):
    def decide(self, given):
        others = given.observations[:, 0].mean() / 1000.0
        return Decision(super().decide(given).actions - others, given.memory)


class Counting(Coin):
    calls: ClassVar[list[int]] = []

    def decide(self, given):
        self.calls.append(0)
        return Decision(np.full((len(given.step), 3), len(self.calls) / 10000.0), given.memory)


class Reusing(Coin):
    made: ClassVar[dict[int, np.ndarray]] = {}

    def decide(self, given):
        n = len(given.step)
        out = self.made.setdefault(n, np.empty((n, 3)))
        out[:] = super().decide(given).actions
        return Decision(out, given.memory)


class Infinite(Coin):
    def log_density(self, given, action):
        return np.full(len(action), -np.inf)


class Peak(Coin):
    def log_density(self, given, action):
        return np.where(np.isin(action, (0.5, -0.5)).all(axis=1), np.log(0.5), np.inf)


class Single(Coin):
    def log_density(self, given, action):
        return super().log_density(given, action).astype(np.float32)


class Unlikely(Coin):
    def log_density(self, given, action):
        return super().log_density(given, action) - 0.2


class Wide(Coin):
    def decide(self, given):
        return Decision(np.zeros((len(given.step), 4)), given.memory)


class Broken(Coin):
    def decide(self, given):
        return Decision(np.full((len(given.step), 3), np.nan), given.memory)


class Stubborn(Policy):
    """Keeps the side of the first coin of an episode, in its memory."""

    needs: ClassVar[Needs] = Needs(step_draws=1, memory=1)
    kind: str = "stubborn"

    def decide(self, given):
        drawn = np.where(given.uniforms < 0.5, 0.5, -0.5)
        side = np.where(given.step[:, None] == 0, drawn, given.memory)
        return Decision(side * np.ones(3), side)

    def log_density(self, given, action):
        first, kept = given.step == 0, (action == given.memory).all(axis=1)
        valid = np.isin(action, (0.5, -0.5)).all(axis=1) & (action[:, :1] == action).all(axis=1)
        return np.where(first, np.where(valid, np.log(0.5), -np.inf), np.where(kept, 0.0, -np.inf))


class Remembering(Stubborn):
    """Begins an episode with the side of the last one, which it keeps outside of its memory."""

    sides: ClassVar[dict[int, np.ndarray]] = {}

    def decide(self, given):
        _, side = super().decide(given)
        before = self.sides.setdefault(len(side), side)
        self.sides[len(side)] = side
        return Decision(np.where(given.step[:, None] == 0, before, side) * np.ones(3), side)


class Overwriting(Stubborn):
    def decide(self, given):
        answer = super().decide(given)
        given.memory[:] = answer.memory + 1.0
        return answer


class Shared(Stubborn):
    def decide(self, given):
        actions, side = super().decide(given)
        return Decision(actions, side + given.uniforms.mean())


class Peeking(Stubborn):
    def log_density(self, given, action):
        return super().log_density(given, action) - given.uniforms[:, 0]


class Surprised(Stubborn):
    """Says that every action is as likely as at the first step."""

    def log_density(self, given, action):
        return super().log_density(given._replace(step=0 * given.step), action)


@pytest.mark.parametrize(
    "policy", [Coin(), POLICIES["gaussian"](base={"kind": "bad"}, scale=0.5), "safe", Stubborn()]
)
def test_what_is_right_passes(policy):
    check_policy(policy)


def test_an_object_that_predicts_passes_with_its_history():
    class Learned:
        def predict(self, observations):
            return observations[:, 6:9] / 100.0, None

    check_policy(Learned(), history=2)
    with pytest.raises(
        PolicyError, match=r"found actions of shape \(32, 0\), .* given observations \(32, 1, 6\)"
    ):
        check_policy(Learned())


@pytest.mark.parametrize(
    "around",
    [{"kind": "gaussian", "scale": 0.1}, {"kind": "epsilon_greedy", "epsilon": 1.0}],
    ids=lambda block: block["kind"],
)
def test_noise_around_a_policy_of_ones_own_passes(tmp_path, monkeypatch, around):
    """No action is drawn twice, so there is no share to be compared."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_half.py").write_text(
        "import numpy as np\nclass Own:\n    def predict(self, seen): return np.full((len(seen), 3), 0.5)\n"
    )
    base = {"kind": "custom", "target": "own_half.py:Own", "deterministic": True}
    check_policy({**around, "base": base})


def test_a_policy_without_a_density_passes():
    class Still(Policy):
        kind: str = "still"

        def decide(self, given):
            return Decision(np.zeros((len(given.step), 3)), given.memory)

    class Sure(Still, Deterministic):
        kind: str = "sure"

    check_policy(Still())
    check_policy(Sure())


@pytest.mark.parametrize(
    ("policy", "message"),
    [
        (Changing, "decide changed the observations"),
        (Reusing, "changed an array that an earlier one returned"),
        (Infinite, "finite at the policy's own actions"),
        (Peak, r"log_density is \[inf\] at"),
        (Single, "must return float64"),
        (Overwriting, "decide changed the memory that it was given"),
        (Peeking, "depends on the random numbers of its own step"),
        (Surprised, "the probability 0.5000, but its share of 2000 draws was 1.0000"),
        (Unlikely, "the probability 0.4094, but its share of 2000 draws was 0.[45]"),
    ],
)
def test_what_is_wrong_is_said(policy, message):
    with pytest.raises(AssertionError, match=message):
        check_policy(policy())


@pytest.mark.parametrize(
    ("policy", "message"),
    [
        (Wide, "expected"),
        (Broken, "expected finite numbers"),
        (Batch, "for the same episodes in another order"),
        (Counting, "when the same was asked again"),
        (Remembering, "for the same episodes in another order"),
        (Shared, "for the same episodes without half of them"),
    ],
)
def test_an_invalid_or_impure_answer_is_a_policy_error(policy, message):
    with pytest.raises(PolicyError, match=message):
        check_policy(policy())
