"""The pictures of a dataset show the numbers that pandas computes from its rows."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from ibdata.plots import pictures
from ibdata.plots.summary import Summary

pytestmark = pytest.mark.slow
POLICIES = ["random", "safe", "mediocre"]


def pictured(name, dataset):
    figure = Figure()
    getattr(pictures, f"draw_{name}")(figure, Summary(dataset))
    return figure


def rows(dataset):
    """All rows, with the setpoint and the label of their episode."""
    labels = dataset.episodes[["episode", "setpoint"]]
    return dataset.to_pandas().merge(labels, on="episode")


def near(x):
    """The ends of an axis: ¾ of the distance of the 5 and 95 % quantiles beyond them, within the values."""
    first, last = np.quantile(x, [0.05, 0.95], method="inverted_cdf")
    room = 0.75 * (last - first)
    return max(x.min(), first - room), min(x.max(), last + room)


def test_rewards_are_quantiles_of_steps(many):
    (axes,) = pictured("rewards", many).axes
    data = rows(many).astype({"reward": "float64"})
    bin_width = np.ptp(data["reward"]) / 5000
    rewards = data.groupby(["policy", "setpoint"], observed=True)["reward"]
    for i, (line, label) in enumerate(zip(axes.get_lines(), POLICIES, strict=True)):
        assert line.get_label() == label
        assert np.allclose(line.get_xdata(), rewards.median()[label], atol=bin_width)
        for quantiles, lines in (([0.05, 0.95], 2 * i), ([0.25, 0.75], 2 * i + 1)):
            drawn = [path.vertices[:, 0] for path in axes.collections[lines].get_paths()]
            expected = rewards.quantile(quantiles)[label].to_numpy().reshape(-1, 2)
            assert np.allclose(drawn, expected, atol=bin_width)
    assert [label.get_text() for label in axes.get_yticklabels()] == ["20", "50", "80"]
    assert [text.get_text() for text in axes.get_legend().get_texts()] == POLICIES
    assert "minus the cost" in axes.get_xlabel()


def test_the_trade_off_shows_steps_and_means(many):
    figure = pictured("tradeoff", many)
    axes = figure.axes[0]
    data = rows(many).astype({"next_obs_consumption": "float64", "next_obs_fatigue": "float64"})
    image = axes.get_images()[0]
    c, f = data["next_obs_consumption"], data["next_obs_fatigue"]
    box = np.reshape(image.get_extent(), (2, 2))
    assert np.allclose(box, [near(c), near(f)], rtol=0.02)
    assert np.array_equal(image.get_array().filled(0), np.histogram2d(c, f, 60, box)[0].T)
    beyond = 1 - image.get_array().sum() / len(data)
    assert (f"{beyond:.2%}" in figure.get_suptitle()) == (beyond > 0)
    means = data.groupby(["policy", "setpoint"], observed=True)[[c.name, f.name]].mean()
    marks = {each.get_label(): each for each in axes.collections}
    for label in POLICIES:
        assert np.allclose(marks[label].get_offsets(), means.loc[label], rtol=1e-12)
        assert (np.diff(marks[label].get_sizes()) > 0).all()
    assert (axes.get_xlim()[0], axes.get_ylim()[0]) == (0.0, 0.0)
    assert not set(POLICIES) & {line.get_label() for line in axes.get_lines()}  # nothing joins the marks
    assert not axes.texts


NAMES = {"many": ["source", "target", "target-rest", "random", "safe", "mediocre"], "next": ["low", "(none)"]}


@pytest.mark.parametrize(("form", "names"), NAMES.items())
def test_splits_count_episodes_of_cells_and_shared_ones(formed, form, names):
    dataset = formed(form)
    upper, lower = pictured("splits", dataset).axes
    assert [label.get_text() for label in upper.get_xticklabels()] == names
    held = [list(own) or ["(none)"] for own in dataset.episodes["splits"]]
    inside = pd.DataFrame({name: [name in own for own in held] for name in names})
    episodes = dataset.episodes.astype({"policy": str})
    order = pd.Categorical(episodes["policy"], POLICIES)
    counted = inside.groupby([episodes["setpoint"], order], observed=False).sum()
    assert np.array_equal(written(upper, counted.shape), counted)
    assert np.array_equal(written(lower, (len(names),) * 2), inside.astype(int).T @ inside.astype(int))


def written(axes, shape):
    """The numbers in the squares; an empty square is 0."""
    found = np.zeros(shape, int)
    for text in axes.texts:
        column, row = text.get_position()
        found[row, column] = int(text.get_text())
    return found
