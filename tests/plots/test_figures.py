"""`studies/figures` draws the shipped pictures, and the paper's figures show the numbers of the dynamics."""

from __future__ import annotations

import re
import runpy

import matplotlib
import numpy as np
import pytest
from helpers import ROOT
from matplotlib.figure import Figure
from PIL import Image

import measuring.documents
from ibdata.dynamics import SIEMENS
from ibdata.experiment import load
from ibdata.experiment.rollout import rollout
from paper import dynamics, landscape, policies, setpoints

pytestmark = pytest.mark.slow

NAMES = ["picture", *(f"figures/{name}" for name in ("landscape", "policies", "dynamics", "setpoints"))]
PINNED = re.findall(r"^matplotlib==(\S+)", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
UP_AND_BACK = [*range(7), *range(5, -7, -1)]


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """A folder in which the study has drawn."""
    folder = tmp_path_factory.mktemp("docs")
    (folder / "figures").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(measuring.documents, "DOCS", folder)
        runpy.run_path(str(ROOT / "studies/figures"), run_name="__main__")
    return folder


def greys(path):
    with Image.open(path) as picture:
        assert "Software" not in picture.info  # the version of matplotlib
        return np.array(picture.convert("L"), dtype=int)


@pytest.mark.parametrize("name", NAMES)
def test_the_study_draws_the_shipped_pictures(study, name):
    """Another seed changes at least 1 % of the pixels, and another matplotlib, whose fonts differ, 2 %."""
    made, shipped = greys(study / f"{name}.png"), greys(ROOT / f"docs/{name}.png")
    assert made.shape == shipped.shape
    if matplotlib.__version__ in PINNED:
        assert (abs(made - shipped) > 64).mean() < 0.001


def drawn(module):
    """The axes of a figure, drawn but not rendered."""
    figure = Figure(layout="constrained")
    module.draw(figure)
    return figure.axes


def lines(axes):
    """Label: values of the lines of some axes."""
    return {line.get_label(): np.asarray(line.get_ydata()) for line in axes.get_lines()}


def test_the_landscape_s_colours_are_the_penalty():
    axes, _ = drawn(landscape)
    m = axes.collections[0].get_array()
    assert m.shape == (301, 13)  # hᵉ from -1.5 to 1.5, φ from -6 to 6
    assert abs(m[250, 12] + 1.0) < 1e-12  # hᵉ = 1, φ = 6: the best there is
    assert abs(m[300, 0] - 1.2303) < 5e-5  # hᵉ = 1.5, φ = -6: the worst
    assert np.array_equal(m[150], np.zeros(13))
    assert np.allclose(m, m[::-1, ::-1], rtol=0, atol=1e-12)


def test_the_three_policies_go_where_the_paper_says():
    axes = drawn(policies)[:3]
    paths = [next(line for line in each.get_lines() if line.get_marker() == "o") for each in axes]
    (phi_a, he_a), (phi_b, he_b), (phi_c, he_c) = (path.get_data() for path in paths)
    assert phi_a.tolist() == [*UP_AND_BACK, *range(-5, 1)]
    assert np.allclose(he_a, np.sin(np.pi * np.arange(25) / 12), rtol=0, atol=1e-12)
    assert phi_b.tolist() == [0, 1, 2, 3, 4, 5, 4, 3, 2, 1, 0]
    assert np.allclose(he_b[6:], 0.0, rtol=0, atol=1e-12)
    assert phi_c.tolist() == [*UP_AND_BACK, -6, -6]
    assert np.allclose(he_c, [*np.linspace(0, 1, 7), *[1.0] * 14], rtol=0, atol=1e-12)
    means = [float(each.get_title().rpartition(": ")[2].replace("−", "-")) for each in axes]
    assert means[0] < means[1] < 0.0 < means[2]


def test_the_200_steps_are_a_dataset_s_and_add_up():
    experiment = load("random", seed=dynamics.SEED)
    (episode,) = (i for i, cell in enumerate(experiment.cells) if cell.setpoint == 50.0)
    made = rollout(experiment, episode, episode + 1)
    data = {name: made.table[i, : dynamics.STEPS] for i, name in enumerate(made.names)}
    a, b, mu, c, d = map(lines, drawn(dynamics))
    assert list(a) == ["f: fatigue"]
    assert np.array_equal(a["f: fatigue"].astype(np.float32), data["obs_fatigue"])
    assert np.array_equal(mu["μᵍ"].astype(np.float32), data["latent_mu_g"])
    assert np.array_equal(mu["μᵛ"].astype(np.float32), data["latent_mu_v"])
    assert mu["run-away from 1.2"].tolist() == [1.2, 1.2]
    assert np.array_equal(b["θ: operational cost"][:-1].astype(np.float32), data["latent_theta_1"][1:])
    consumption = c["c: consumption, with noise"]
    assert np.array_equal(consumption.astype(np.float32), data["obs_consumption"])
    assert np.array_equal(b["θᶜ: delayed and blurred"], c["θᶜ"])
    expected = c["θᶜ"] + c["25 (m + 1)"]
    z = (consumption - expected) / (1.0 + SIEMENS.consumption_noise * expected)
    assert 0.8 < z.std() < 1.2  # 200 standard normal draws: 4 standard errors
    assert np.array_equal(d["−r = c + 3 f"], consumption + 3 * a["f: fatigue"])
    assert np.allclose(-d["−r = c + 3 f"][1:], data["reward"][:-1], rtol=1e-6)


def test_the_seed_chosen_shows_what_the_paper_describes():
    """Spikes up to t = 80, then a run-away, and at its cap a change of the fatigue near t = 100."""
    fatigue, _, mu, *_ = map(lines, drawn(dynamics))
    assert np.flatnonzero(mu["μᵍ"] >= 1.2)[0] == 82
    assert np.flatnonzero(mu["μᵍ"] >= 5.0)[0] == 96
    assert (mu["μᵍ"][96:] == 5.0).all()
    assert fatigue["f: fatigue"][96:176].min() > 1.5 * np.median(fatigue["f: fatigue"][:82])


def test_the_setpoints_are_four_with_the_variant_s_rates():
    (axes,) = drawn(setpoints)
    paths = np.array(list(lines(axes).values()))
    rates = np.diff(paths, axis=1)
    inside = (paths[:, 1:] > 0) & (paths[:, 1:] < 100) & (paths[:, :-1] > 0) & (paths[:, :-1] < 100)
    assert paths.shape == (4, 1000)
    assert (abs(paths[:, 0] - 50.0) <= 1.0).all()
    assert len(np.unique(paths[:, 100])) == 4
    assert 0.0 <= paths.min() <= paths.max() <= 100.0
    assert max(map(abs, SIEMENS.drift_rate)) >= abs(rates[inside]).max() > 0.5
    assert np.count_nonzero(np.abs(np.diff(rates, axis=1)) > 1e-9) < 4 * 100  # straight but for few corners
