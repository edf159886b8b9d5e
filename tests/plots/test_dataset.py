"""The pictures of a dataset show the numbers that pandas computes from its rows."""

from __future__ import annotations

from importlib import import_module

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from ibdata.plots.summary import Summary

pytestmark = pytest.mark.slow


def pictured(name, dataset):
    figure = Figure()
    import_module(f"ibdata.plots.dataset.{name}").draw(figure, Summary(dataset))
    return figure


def rows(dataset):
    """All rows, with the setpoint and the label of their episode."""
    labels = dataset.episodes[["episode", "setpoint"]]
    return dataset.to_pandas().merge(labels, on="episode")


def test_rewards_are_the_share_of_each_setpoint_s_steps(many):
    (axes,) = pictured("rewards", many).axes
    groups = rows(many).groupby("setpoint")["reward"]
    drawn = [patch.get_data() for patch in axes.patches]
    shares = [np.histogram(x.astype("float64"), drawn[0].edges)[0] / len(x) for _, x in groups]
    assert drawn[0].edges[[0, -1]].tolist() == [groups.min().min(), groups.max().max()]
    assert len(drawn) == 3
    for i, (data, share) in enumerate(zip(drawn, shares, strict=True)):
        assert np.allclose(data.values - i, 0.92 * share / np.max(shares), atol=1e-12)
    assert [label.get_text() for label in axes.get_yticklabels()] == ["20", "50", "80"]
    assert axes.get_xlabel() == "reward -c - 3f of the next observation (cost)"


def test_returns_are_quantiles_of_sums_of_rewards(many):
    (axes,) = pictured("returns", many).axes
    returns = (
        rows(many).astype({"reward": "float64"}).groupby(["policy", "setpoint", "episode"], observed=True)
    )
    returns = returns["reward"].sum()
    for line, label in zip(axes.get_lines(), ["random", "safe", "mediocre"], strict=True):
        assert line.get_label() == label
        assert np.allclose(line.get_xdata(), returns[label].groupby("setpoint").median(), rtol=1e-12)
    whiskers = [path.vertices[:, 0] for path in axes.collections[0].get_paths()]
    expected = returns["random"].groupby("setpoint").quantile([0.05, 0.95]).to_numpy().reshape(-1, 2)
    assert np.allclose(whiskers, expected, rtol=1e-12)


def test_returns_of_episodes_of_different_length_are_means(merged):
    (axes,) = pictured("returns", merged).axes
    means = merged.to_pandas().astype({"reward": "float64"})
    means = means.groupby(["policy", "episode"], observed=True)["reward"].mean()
    setpoints = merged.episodes["setpoint"]
    expected = means["safe"].groupby(setpoints[means["safe"].index].to_numpy()).median()
    assert np.allclose(axes.get_lines()[1].get_xdata(), expected, rtol=1e-12)
    assert axes.get_xlabel().startswith("mean reward of a step")


@pytest.mark.parametrize(
    ("panel", "x", "y"), [(0, "velocity", "gain"), (1, "velocity", "shift"), (2, "gain", "shift")]
)
def test_coverage_counts_the_visits_of_each_square(many, panel, x, y):
    axes = pictured("coverage", many).axes[panel]
    data = rows(many).astype("float64", errors="ignore")
    edges = np.arange(0, 101, 2)
    expected = pd.crosstab(
        pd.cut(data[f"obs_{y}"], edges, right=False, labels=False).fillna(49),  # 100 belongs to the last
        pd.cut(data[f"obs_{x}"], edges, right=False, labels=False).fillna(49),
    ).reindex(index=range(50), columns=range(50), fill_value=0)  # fmt: skip
    image = axes.get_images()[0]
    assert np.array_equal(image.get_array().filled(0), expected)
    assert image.get_extent() == [0, 100, 0, 100]
    assert axes.get_title() == f"{(expected > 0).to_numpy().sum()} of 2500 squares visited"


def test_the_trade_off_shows_every_step_and_the_means(many):
    axes = pictured("tradeoff", many).axes[0]
    data = rows(many).astype({"next_obs_consumption": "float64", "next_obs_fatigue": "float64"})
    image = axes.get_images()[0]
    c, f = data["next_obs_consumption"], data["next_obs_fatigue"]
    box = [[c.min(), c.max()], [f.min(), f.max()]]
    assert np.array_equal(image.get_array().filled(0), np.histogram2d(c, f, 60, box)[0].T)
    assert np.allclose(image.get_extent(), np.ravel(box))
    means = data.groupby(["policy", "setpoint"], observed=True)[[c.name, f.name]].mean()
    for line, label in zip(axes.get_lines()[:3], ["random", "safe", "mediocre"], strict=True):
        assert line.get_label() == label
        assert np.allclose(np.transpose(line.get_data()), means.loc[label], rtol=1e-12)


def test_lines_of_equal_reward_have_equal_reward(many):
    for line in pictured("tradeoff", many).axes[0].get_lines()[3:]:
        (c1, c2), (f1, f2) = np.transpose([line.get_xy1(), line.get_xy2()])
        assert c1 + 3 * f1 == pytest.approx(c2 + 3 * f2)


def test_actions_are_the_share_of_each_policy_s_steps(many):
    figure = pictured("actions", many)
    data = rows(many)
    for axes, column in zip(figure.axes, ["act_velocity", "act_gain", "act_shift"], strict=True):
        for patch, label in zip(axes.patches, ["random", "safe", "mediocre"], strict=True):
            own = data[column][data["policy"] == label].astype("float64")
            share = 100 * np.histogram(own, np.linspace(-1, 1, 42))[0] / len(own)
            drawn = patch.get_data()
            assert np.allclose(drawn.values, np.maximum(share, drawn.baseline), rtol=1e-12)


@pytest.mark.parametrize("name", ["many", "moving", "bare"])
def test_the_traces_are_those_of_the_episode_with_the_median_return(formed, name):
    dataset = formed(name)
    figure = pictured("traces", dataset)
    returns = dataset.episodes["return"]
    episode = returns[returns == returns.sort_values().iloc[(len(returns) - 1) // 2]].index[0]
    data = dataset.to_pandas().query(f"episode == {episode}")
    shown = [line for axes in figure.axes for line in axes.get_lines()]
    expected = ["obs_velocity", "obs_gain", "obs_shift", "obs_setpoint", "obs_consumption", "obs_fatigue"]
    expected += [] if name == "bare" else ["latent_mu_v", "latent_mu_g", "latent_direction"]
    for line, column in zip(shown, expected, strict=True):
        assert np.array_equal(line.get_ydata(), data[column])
    assert figure.get_suptitle().startswith(f"episode {episode}, ")


def test_splits_are_the_shares_of_cells_and_the_episodes_that_are_shared(many):
    upper, lower = pictured("splits", many).axes[:2]
    names = ["source", "target", "target-rest", "random", "safe", "mediocre", "(none)"]
    assert [label.get_text() for label in upper.get_xticklabels()] == names
    inside = pd.DataFrame({name: [name in own for own in many.episodes["splits"]] for name in names[:-1]})
    inside["(none)"] = ~inside.any(axis=1)
    episodes = many.episodes.astype({"policy": str})
    order = pd.Categorical(episodes["policy"], ["random", "safe", "mediocre"])
    share = inside.groupby([episodes["setpoint"], order], observed=False).mean()
    assert np.array_equal(upper.get_images()[0].get_array().filled(np.nan), share)
    numbers = np.array([int(text.get_text()) for text in lower.texts]).reshape(7, 7)
    assert np.array_equal(numbers, inside.astype(int).T @ inside.astype(int))


def test_many_setpoints_and_policies_are_drawn_in_groups(formed):
    dataset = formed("crowd")
    episodes = Summary(dataset).episodes
    assert episodes.setpoints[:2] == ["1 – 3", "4 – 6"]
    assert len(episodes.setpoints) == 12
    assert episodes.policies == ["c0", "c1", "c2", "c3", "c4", "c5", "4 others"]
    assert np.bincount(episodes.policy).tolist() == [60] * 6 + [240]
    spans = [[float(end) for end in name.split(" – ")] for name in episodes.setpoints]
    for group, setpoint in zip(episodes.setpoint, dataset.episodes["setpoint"], strict=True):
        assert spans[group][0] <= setpoint <= spans[group][1]
