"""What policies answer, worked out by hand, and laws that are no values. `test_recount` counts draws."""

from __future__ import annotations

from functools import partial
from statistics import NormalDist

import mpmath
import numpy as np
import pytest
from helpers.policies import BASE, distribution, drawn, played, playing, policy_of, proposed

from ibdata._numerics.exact import log_cdf
from ibdata.policies import POLICIES, baselines
from ibdata.policies.base import at_start
from ibdata.policies.checked import ask
from ibdata.policies.distributions import applied
from ibdata.policies.signals import TAPS, sequence, waves

near, about = (partial(pytest.approx, abs=tolerance) for tolerance in (1e-14, 1e-6))
BELOW, INSIDE, ABOVE = 20.0, 50.0, 80.0  # the range of safe
SD = 3**-0.5
Z_1 = NormalDist(0.5, SD).cdf(1.0)  # the draw that makes z = 1
STEERED = [Z_1, Z_1, 0.25, 0.75, 0.5]  # 1 or -1, or else -½ in velocity and ½ in gain; 0 in shift
HALF, EDGE, TOWARDS, AWAY = (
    getattr(baselines, f"LOG_{name}") for name in ("HALF", "MASS_AT_EDGE", "MASS_TOWARDS", "MASS_AWAY")
)
BEFORE_40, AFTER_60 = np.nextafter(np.float32([40, 60]), np.float32([0, 100]))
SMALLEST, LARGEST = 2.0**-53, 1.0 - 2.0**-53
OWN = np.float32(BASE["action"]).tolist()


def greedy(base, epsilon):
    return {"kind": "epsilon_greedy", "base": base, "epsilon": epsilon}


ANSWERS = [  # a policy, what it sees, its draws, and its action before it is clipped
    # The way to 100 or 25 in raw units, in doubles.
    ("bad", {"v": 50.0, "g": 99.5, "h": 100.0}, [], [50.0, 0.5, 0.0]),
    ("mediocre", {"v": 25.0, "g": 24.75, "h": 27.0}, [], [0.0, 0.25, -2.0]),
    ("mediocre", dict.fromkeys("vgh", np.float32(24.9)), [], [25.0 - float(np.float32(24.9))] * 3),
    ("optimized", {}, [], about([-0.91, 1.43, 0.81])),  # all z are 0
    ("optimized", {"v5": 36.44}, [], about([0.09, 1.43, 0.81])),  # z = (36.44 - 48.75) / 12.31 = -1, 1 - 0.91
    ("optimized", {"f3": 21.925}, [], about([-0.91, 0.43, 0.81])),  # z = -½, -1 + 1.43
    ("optimized", {"p0": 83.72}, [], about([-0.91, 0.43, 2.81])),  # z = 1, -1 + 1.43 and 2 + 0.81
    ("optimized", {"h3": 52.372}, [], about([-0.91, 1.43, 0.462])),  # z = 0.1, -0.348 + 0.81
    ("optimized", {"h4": 64.06}, [], about([-0.91, 1.43, 0.31])),  # z = 0.5, -0.5 + 0.81
    ("optimized", {"p0": 40.64}, [], about([-0.91, 1.93, -0.19])),  # z = -0.5, 0.5 + 1.43 and -1 + 0.81
    ("random", {}, [0.25, 0.5, 0.875], [-0.5, 0.0, 0.75]),
    ("random", {}, [SMALLEST, LARGEST, 0.5], [-1.0 + 2.0**-52, 1.0 - 2.0**-52, 0.0]),
    ("random", {}, [LARGEST, 0.5, SMALLEST], [1.0 - 2.0**-52, 0.0, -1.0 + 2.0**-52]),
    # The bounds of the range belong to it.
    *(
        ("safe", {"v": x, "g": INSIDE, "h": 90.0}, STEERED, near([moved or -0.5, 0.5, 0.0]))
        for x, moved in ((0, 1), (BEFORE_40, 1), (40, None), (60, None), (AFTER_60, -1), (100, -1))
    ),
    *(
        ("safe", {"v": INSIDE, "g": x, "h": 90.0}, STEERED, near([-0.5, moved or 0.5, 0.0]))
        for x, moved in ((0, 1), (BEFORE_40, 1), (40, None), (60, None), (AFTER_60, -1), (100, -1))
    ),
    # The draw after those of the base decides, and the others are the action; 0.2 is not below 0.2.
    (greedy(BASE, 0.2), {}, [0.2, 0.75, 0.25, 0.875], OWN),
    (greedy(BASE, 0.2), {}, [0.1999, 0.75, 0.25, 0.875], [0.5, -0.5, 0.75]),
    (greedy("safe", 0.5), {"v": BELOW}, [Z_1, 0.9, 0.9, 0.75, 0.5, 0.5, 0.1, 0.2, 0.3], near([1, 0.5, 0])),
]  # fmt: skip
DENSITIES = [  # a policy, velocity and gain, an action, its log density, and which numbers are point masses
    ("safe", 40.0, 60.0, [-0.9, 0.1, 0.7], 3 * HALF, []),
    ("safe", BELOW, INSIDE, [-0.25, 0.0, 0.0],
     -1.5 * 0.75**2 - 0.5 * np.log(2 * np.pi / 3) + 2 * HALF, []),
    ("safe", INSIDE, ABOVE, [0.0, -1.0, 0.0], TOWARDS + 2 * HALF, [1]),
    ("safe", BELOW, ABOVE, [1.0, 1.0, 0.0], TOWARDS + AWAY + HALF, [0, 1]),
    # Elsewhere float32 rounds a density to ±1, which `importance` must not take for a mass.
    ("safe", INSIDE, ABOVE, [1.0, -1.0, 1.0], EDGE + TOWARDS + EDGE, [1]),
    ("safe", INSIDE, INSIDE, [1.0, -1.0, 1.0], 3 * EDGE, []),
    ("random", BELOW, ABOVE, [1.0, -1.0, 1.0], 3 * EDGE, []),
]  # fmt: skip


def history(seen, frames):
    """The means of all columns, but for values such as h3=78.67, that of three steps ago."""
    found = np.tile(np.array(baselines.OBSERVATION_MEAN), (1, frames, 1))
    for name, value in seen.items():
        found[0, int(name[1:] or 0), "pvghfc".index(name[0])] = value
    return found.astype(np.float32)


@pytest.mark.parametrize(("block", "seen", "draws", "action"), ANSWERS)
def test_an_action_is_that_of_the_formula(block, seen, draws, action):
    policy = policy_of({"kind": block} if isinstance(block, str) else block)
    assert proposed(policy, history(seen, policy.needs.history), np.array([draws]))[0].tolist() == action


@pytest.mark.parametrize(("kind", "v", "g", "action", "density", "masses"), DENSITIES)
def test_a_log_density_is_that_of_the_formula(kind, v, g, action, density, masses):
    policy, action = policy_of({"kind": kind}), np.array([action], dtype=np.float32)
    found = distribution(policy, at_start(history({"v": v, "g": g}, 1), policy.needs))
    assert found.log_density(action) == near([density])
    assert np.flatnonzero(found.atoms(action)).tolist() == masses


@pytest.mark.parametrize(
    "options", [{"kind": "epsilon_greedy", "epsilon": 0.5}, {"kind": "gaussian", "scale": 0.5}]
)
def test_a_wrapper_has_the_history_of_its_base(options):
    assert policy_of({"base": {"kind": "optimized"}, **options}).needs.history == 6


@pytest.mark.parametrize("z", [-300.0, -38.0, -8.0, -3.0001, -2.9999, -1.0, -1e-9, 0.0, 0.5, 2.9, 3.1, 9.0])
def test_log_cdf_is_the_logarithm_of_the_normal_one(z):
    with mpmath.workprec(3000):
        exact = float(mpmath.log(mpmath.ncdf(z)))
    assert float(log_cdf(z)) == pytest.approx(exact, rel=1e-12, abs=2e-16)


# --- noise and signals


def test_an_ornstein_uhlenbeck_process_is_its_equation():
    # Φ⁻¹(0.975) = 1.959964; x = 0.2 · 1.959964, then 0.85 x + 0.2 · 0.
    policy = policy_of(
        {"kind": "ornstein_uhlenbeck", "base": {"kind": "constant", "action": [0.5, -0.25, 0]}}
    )
    given = next(given for given, _ in playing(policy, 1, 1))._replace(draws=np.full((1, 3), 0.975))
    first = policy.decide(given)
    [back] = drawn(policy, given._replace(draws=np.full((1, 3), 0.5), memory=first.memory))
    assert first.memory[0] == about([0.3919928] * 3)
    assert drawn(policy, given)[0] == about([0.8919928, 0.1419928, 0.3919928])
    assert back == about([0.8331939, 0.0831939, 0.3331939])


@pytest.mark.parametrize("order", TAPS)
def test_the_sequence_has_the_longest_period(order):
    """Golomb 1967: one 1 more than -1, and an autocorrelation of -1 at every lag."""
    signs, n = sequence(order), 2**order - 1
    assert (len(signs), signs.sum()) == (n, 1.0)
    spectrum = np.abs(np.fft.fft(signs)) ** 2
    np.testing.assert_allclose(np.fft.ifft(spectrum).real[1:], -np.ones(n - 1), atol=1e-9)


def test_a_multisine_has_equal_power_in_its_frequencies():
    for j, signal in enumerate(waves(4, 60).T):
        power = np.abs(np.fft.rfft(signal)) ** 2
        own = np.array([3 * i + j + 1 for i in range(4)])
        np.testing.assert_allclose(power[own] / power[own[0]], np.ones(4), atol=1e-9)
        assert np.delete(power, own).max() < 1e-20 * power[own[0]] + 1e-20


# --- policies that repeat, mix and switch others

UP, DOWN = ({"kind": "constant", "action": [x] * 3} for x in (0.5, -0.5))
N = 2000


def scheduled(*stages):
    return policy_of({"kind": "schedule", "stages": [*stages]})


def test_at_the_first_step_there_is_nothing_to_repeat():
    policy = policy_of({"kind": "sticky", "base": UP, "kappa": 1.0})
    assert (played(policy, 4, 3) == 0.5).all()
    up = np.full((4, 3), 0.5, np.float32)
    for given, _ in playing(policy, 4, 2):  # where the base takes the last action too, the probabilities add
        assert distribution(policy, given).log_density(up).tolist() == [0.0] * 4


@pytest.mark.parametrize(("weights", "share"), [(None, 0.5), ([1.0, 3.0], 0.25)])
def test_one_policy_of_a_mixture_acts_in_a_whole_episode(weights, share):
    action = played(policy_of({"kind": "mixture", "bases": [UP, DOWN], "weights": weights}), N, 3)
    assert (action == action[:, :1, :1]).all()
    assert (action[:, 0, 0] == 0.5).mean() == pytest.approx(share, abs=0.06)


def test_every_policy_of_a_mixture_acts_as_it_would_alone():
    kinds = ["prbs", "ornstein_uhlenbeck", "optimized"]
    mixture = policy_of({"kind": "mixture", "bases": kinds})
    steps = list(playing(mixture, 60, 8))
    which = mixture.chosen(steps[0][0])
    assert set(which.tolist()) == {0, 1, 2}
    for number, kind in enumerate(kinds):
        alone, mine = POLICIES[kind](), which == number
        memory = np.zeros((60, alone.needs.memory))
        for given, action in steps:
            # One draw of an episode chooses the policy; the next is that of prbs, which alone needs any.
            own = given._replace(episode_draws=given.episode_draws[:, 1:], memory=memory).cut(alone.needs)
            one, memory = ask(alone, own)
            np.testing.assert_array_equal(action[mine], applied(one.sample(own.draws))[mine])
            density, found = one.log_density(action), distribution(mixture, given).log_density(action)
            np.testing.assert_array_equal(found[mine], density[mine])


def test_the_stages_of_a_schedule_follow_one_another():
    policy = scheduled({"base": UP, "steps": 2}, {"base": DOWN, "steps": 3}, {"base": UP})
    assert played(policy, 2, 8)[0, :, 0].tolist() == [0.5, 0.5, -0.5, -0.5, -0.5, 0.5, 0.5, 0.5]


def test_a_stage_begins_as_an_episode_does():
    """With zero memory: the variance of the second process is again that of its first step, σ²."""
    noise = {"kind": "ornstein_uhlenbeck", "theta": 0.1, "sigma": 0.1}
    action = played(scheduled({"base": noise, "steps": 9}, {"base": noise}), N, 10)
    assert action[:, 8].std() > 0.2
    assert action[:, 9].std() == pytest.approx(0.1, rel=0.06)


@pytest.mark.parametrize(
    ("stages", "shares"),
    [
        ([{"base": UP, "steps": 3, "epsilon": [1.0, 0.5]}, {"base": UP}], [1.0, 0.75, 0.5, 0.0]),
        ([{"base": UP, "steps": 2, "epsilon": [1.0, 0.25]}], [1.0, 0.25, 0.25, 0.25]),
    ],
    ids=["linear", "the last share lasts"],
)
def test_a_share_of_random_actions_changes_with_the_step(stages, shares):
    policy = scheduled(*stages)
    for (given, action), epsilon in zip(playing(policy, N, len(shares)), shares, strict=True):
        assert policy.epsilon(given).tolist() == pytest.approx([epsilon] * N)
        assert (action != 0.5).any(axis=1).mean() == pytest.approx(epsilon, abs=0.07)
