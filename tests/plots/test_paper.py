"""The figures of the paper, and of a running episode, show the numbers of the dynamics."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from ibdata.dynamics import VARIANTS
from ibdata.experiment import load
from ibdata.experiment.rollout import rollout
from ibdata.plots.data import episodes
from ibdata.plots.episode import PANELS, draw_episode, frame
from ibdata.plots.paper import dynamics, landscape, policies, setpoints

pytestmark = pytest.mark.slow

UP_AND_BACK = [*range(7), *range(5, -7, -1)]


def drawn(module, variant="siemens"):
    """The axes of a figure, drawn but not rendered."""
    figure = Figure(layout="constrained")
    module.draw(figure, variant, module.SEED)
    return figure.axes


def lines(axes):
    """Label: values of the lines of some axes."""
    return {line.get_label(): line.get_ydata() for line in axes.get_lines()}


def test_the_landscape_s_numbers_are_the_penalty_s():
    phi, he, m = landscape.grid()
    assert phi.tolist() == [*range(-6, 7)]
    assert (he[0], he[150], he[-1]) == (-1.5, 0.0, 1.5)
    assert m.shape == (301, 13)
    assert abs(m[250, 12] + 1.0) < 1e-12  # hᵉ = 1, φ = 6: the best there is
    assert abs(m[300, 0] - 1.2303) < 5e-5  # hᵉ = 1.5, φ = -6: the worst
    assert np.array_equal(m[150], np.zeros(13))
    assert np.allclose(m, m[::-1, ::-1], rtol=0, atol=1e-12)


def test_the_three_policies_go_where_the_paper_says():
    optimal, given_up, bad = (policies.path(delta_h) for delta_h in policies.POLICIES.values())
    assert optimal.phi.tolist() == [*UP_AND_BACK, *range(-5, 1)]
    assert np.allclose(optimal.he, np.sin(np.pi * np.arange(25) / 12), rtol=0, atol=1e-12)
    assert given_up.phi.tolist() == [0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0]
    assert np.allclose(given_up.he[6:], 0.0, rtol=0, atol=1e-12)
    assert bad.phi.tolist() == [*UP_AND_BACK, -6, -6]
    assert np.allclose(bad.he, [*np.linspace(0, 1, 7), *[1.0] * 14], rtol=0, atol=1e-12)
    assert abs(bad.m[6] + 1.0) < 1e-12  # one of the global optima
    assert (np.diff(bad.m[6:19]) > 0).all()
    means = [x.m[-n:].mean() for x, n in zip((optimal, given_up, bad), policies.REPEATED, strict=True)]
    assert means[0] < means[1] < 0.0 < means[2]


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_200_steps_are_a_dataset_s_and_add_up(variant):
    config, seed = {"siemens": "random", "paper": "random-paper"}[variant], 11
    experiment = load(config, seed=seed)
    (episode,) = (i for i, cell in enumerate(experiment.cells) if cell.setpoint == 50.0)
    made = rollout(experiment, episode, episode + 1)
    data = {name: made.table[i, : dynamics.STEPS] for i, name in enumerate(made.names)}
    parts = dynamics.parts(variant, seed)
    for name in ("obs_fatigue", "obs_consumption", "latent_mu_g", "latent_mu_v"):
        drawn_name = name.removeprefix("obs_").removeprefix("latent_")
        assert np.array_equal(parts[drawn_name].astype(np.float32), data[name])
    assert np.array_equal(parts["theta"][:-1].astype(np.float32), data["latent_theta_1"][1:])
    assert np.allclose(-parts["cost"][1:], data["reward"][:-1], rtol=1e-6)
    assert np.array_equal(parts["cost"], parts["consumption"] + parts["weighted_fatigue"])
    whole = parts["convolved_cost"] + parts["miscalibration"]
    assert np.allclose(parts["expected_consumption"], whole, rtol=1e-12)
    spread = 1.0 + VARIANTS[variant].consumption_noise * parts["expected_consumption"]
    z = (parts["consumption"] - parts["expected_consumption"]) / spread
    assert 0.8 < z.std() < 1.2  # 200 standard normal draws: 4 standard errors


def test_the_seed_chosen_shows_what_the_paper_describes():
    """Spikes up to t = 80, then a run-away, and at its cap a change of the fatigue near t = 100."""
    parts = dynamics.parts("siemens", dynamics.SEED)
    mu = parts["mu_g"]
    assert np.flatnonzero(mu >= 1.2)[0] == 82
    assert np.flatnonzero(mu >= 5.0)[0] == 96
    assert (mu[96:] == 5.0).all()
    assert parts["fatigue"][96:176].min() > 1.5 * np.median(parts["fatigue"][:82])


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_four_panels_draw_these_numbers(variant):
    a, b, mu, c, d = drawn(dynamics, variant)
    parts = dynamics.parts(variant, dynamics.SEED)
    assert np.array_equal(lines(a).pop("f: fatigue"), parts["fatigue"])
    assert len(a.get_lines()) == 1
    assert np.array_equal(lines(mu)["μᵍ"], parts["mu_g"])
    assert np.array_equal(lines(mu)["μᵛ"], parts["mu_v"])
    assert mu.get_lines()[2].get_ydata() == [1.2, 1.2]  # the run-away, on the axis of μ alone
    assert mu.get_position().y1 < a.get_position().y0
    assert np.array_equal(lines(b)["θ: operational cost"], parts["theta"])
    assert np.array_equal(lines(b)["θᶜ: delayed and blurred"], parts["convolved_cost"])
    assert np.array_equal(lines(c)["c: consumption, with noise"], parts["consumption"])
    assert np.array_equal(lines(c)["25 (m + 1)" if variant == "siemens" else "25 m"], parts["miscalibration"])
    assert np.array_equal(lines(d)["−r = c + 3 f"], parts["cost"])
    assert [area.get_label() for area in d.collections] == ["c", "3 f"]
    assert all(axes.get_ylabel() for axes in (a, b, c, d, mu))


@pytest.mark.parametrize("variant", VARIANTS)
def test_the_setpoints_are_four_with_the_variant_s_rates(variant):
    paths = setpoints.paths(variant, setpoints.SEED)
    low, high = VARIANTS[variant].drift_rate
    rates = np.diff(paths, axis=1)
    inside = (paths[:, 1:] > 0) & (paths[:, 1:] < 100) & (paths[:, :-1] > 0) & (paths[:, :-1] < 100)
    assert paths.shape == (4, 1000)
    assert (abs(paths[:, 0] - 50.0) <= 1.0).all()
    assert len(np.unique(paths[:, 100])) == 4
    assert 0.0 <= paths.min() <= paths.max() <= 100.0
    assert max(abs(low), abs(high)) >= abs(rates[inside]).max() > 0.5
    assert np.count_nonzero(np.abs(np.diff(rates, axis=1)) > 1e-9) < 4 * 100  # straight but for few corners
    (axes,) = drawn(setpoints, variant)
    assert all(
        np.array_equal(line.get_ydata(), path) for line, path in zip(axes.get_lines(), paths, strict=True)
    )


def seen(steps):
    (columns,) = episodes("siemens", 70.0, "random", steps, 0)
    return {name.removeprefix("obs_").removeprefix("latent_"): x for name, x in columns.items()}


def test_the_panels_draw_what_is_seen_and_what_is_hidden():
    steps = seen(80)
    figure = Figure()
    draw_episode(figure, steps)
    for axes, (_, variables) in zip(figure.axes, PANELS, strict=True):
        assert len(axes.get_lines()) == len(variables)
        for line, (name, label, *_) in zip(axes.get_lines(), variables, strict=True):
            assert line.get_label() == label
            assert np.array_equal(line.get_ydata(), steps[name])
    assert figure.axes[-1].get_xlim() == (0, 79)


def test_a_frame_is_of_one_size_from_the_first_step_on():
    frames = [frame(seen(count)) for count in (1, 2, 60)]
    assert all((x.shape, x.dtype) == ((600, 900, 3), np.uint8) for x in frames)
    assert (frames[0] != frames[2]).any()
