"""Ways of reading × selections × views, compared with one naive reader of the files, by loops over rows."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from helpers.splits import by_policy

import ibdata
from ibdata.views.imperfections import Measurement, imperfections_of

pytestmark = pytest.mark.portable

ACTIONS = ["act_velocity", "act_gain", "act_shift"]
OBSERVED = [f"obs_{name}" for name in ("setpoint", "velocity", "gain", "shift", "fatigue", "consumption")]
HIDDEN = [f"latent_theta_{lag}" for lag in range(1, 10)]
HIDDEN += [
    f"latent_{x}" for x in ("domain", "response", "direction", "mu_v", "mu_g", "drift_rate", "drift_left")
]
EXPERT = [f"expert_{name}" for name in ACTIONS]
SPLITS = {"source": {"policy": "random"}, "target": {"policy": "calm", "episodes": 1}}
SETS = {
    "files": {"output": {"latent": "next", "shard_rows": 30}, "splits": SPLITS},
    # In one file, the episodes of a selection lie apart. The hidden states at the end are not there.
    "one file": {"output": {"expert_action": True}},
    "moving": {
        "dynamics": "paper",
        "setpoints": {"drifting": [0.5, 99.5]},
        "start": {"burn_in": [0, 9]},
        "output": {"latent": "full", "dtype": "float64", "shard_rows": 50},
    },
}
TROUBLES = {
    "delay": {"obs_fatigue": 3},
    "noise": {"obs_consumption": 2.0},
    "missing": {"obs_velocity": 0.2, "obs_gain": 0.1},
    "mask": True,
}
WEIGHTS = {"consumption": 0.7, "fatigue": 2.2}
VIEWS = [  # history, pad, view
    (1, "repeat", {}),
    (5, "drop", {}),
    (1, "repeat", {"observe": "markov", "actions": True, "cost": "runaway"}),
    (4, "drop", {"observe": "markov", "reward": "delta"}),
    (1, "repeat", {"imperfections": TROUBLES, "reward_scale": 0.01}),
    (50, "repeat", {"imperfections": TROUBLES, "reward": "delta", "actions": True}),
    (1, "repeat", {"observe": ["latent_mu_v", "obs_gain"], "reward": WEIGHTS, "cost": {"fatigue": 20}}),
    (2, "repeat", {"reward": {"fatigue": 2}, "reward_scale": 0.1, "cost": "runaway"}),
]


def choices(table):
    """Conditions of a selection, and the episodes that meet them. The limits of returns belong to them."""
    low, second, third, *_ = sorted(table["return"])
    points, calm = table["setpoint"].unique(), table["policy"] == "calm"
    return [
        ({}, calm | True),
        ({"setpoint": points.tolist()}, calm | True),
        ({"setpoint": pd.Series(points[:1]), "policy": "calm"}, calm & (table["setpoint"] == points[0])),
        ({"setpoint": points[1], "split": "calm"}, calm & (table["setpoint"] == points[1])),
        ({"split": ["target", "source"]}, ~calm | (table["index"] < 1)),
        ({"split": "target"}, calm & (table["index"] < 1)),
        ({"episodes": [0, 7], "policy": ["random", "calm"]}, table["episode"].isin([0, 7])),
        ({"returns": (second, third)}, table["return"].between(second, third)),
        ({"returns": (None, low)}, table["return"] <= low),
        ({"returns": (second, None), "split": "source"}, ~calm & (table["return"] >= second)),
    ]


def after(rows, name):
    """A column one step later; unknown after the last row of an episode, if the files do not have it."""
    return rows[f"next_{name}"] if f"next_{name}" in rows else rows.groupby("episode")[name].shift(-1)


def rewards(rows, reward="classic", reward_scale=1.0, **_):
    """In float64 from what float32 holds, and rounded once."""

    def exact(name):
        return rows[name].astype(np.float32).astype(float)

    if reward == "classic":
        return rows["reward"] if reward_scale == 1 else (exact("reward") * reward_scale).astype(np.float32)
    weights = {"consumption": 1, "fatigue": 3} if reward == "delta" else reward
    found = -sum(weight * exact(f"next_obs_{name}") for name, weight in weights.items())
    if reward == "delta":
        found += sum(weight * exact(f"obs_{name}") for name, weight in weights.items())
    return (found * reward_scale).astype(np.float32)


def costs(rows, cost=None, **_):
    """Of the states that follow; unknown where these are."""
    if cost == "runaway":
        highest = np.maximum(*(after(rows, f"latent_mu_{x}").astype(np.float32) for x in "vg"))
        return (highest >= np.float32(1.2)).astype(np.float32).where(highest.notna())
    return (rows["next_obs_fatigue"] > (cost or {"fatigue": 0})["fatigue"]).astype(np.float32)


def naive(rows, history, pad, view):
    """The transitions of all rows, by a loop over episodes, steps and ages; and the names in a frame."""
    hidden = [name for name in HIDDEN if name in rows]
    observe = view.get("observe", "classic")
    columns = {"classic": OBSERVED, "markov": OBSERVED + hidden}.get(str(observe), observe)
    flagged = [name for name in columns if "imperfections" in view and name in TROUBLES["missing"]]
    acted = ACTIONS if "actions" in view else []
    dtype = np.float32 if {"observe", "actions", "imperfections"} & view.keys() else rows["reward"].dtype
    later = pd.DataFrame({name: after(rows, name) for name in columns} | {"cost": costs(rows, **view)})
    unknown = later.isna().any(axis=1)
    found = []
    for number, one in rows.groupby("episode"):
        seen = np.concatenate([one[columns], later.loc[one.index[-1:], columns]]).astype(dtype)
        lost = np.zeros(seen.shape)
        if "imperfections" in view:
            seen, lost = Measurement(imperfections_of(TROUBLES), tuple(columns)).episode(seen, number)
        flags = lost[:, [columns.index(name) for name in flagged]]
        before = np.concatenate([np.zeros((1, len(acted))), one[acted]])
        frames = np.concatenate([seen, flags, before], axis=1).astype(dtype)
        kept = one.index[~unknown[one.index]]
        for t in range(history - 1 if pad == "drop" else 0, len(kept)):
            now, then = (np.ravel([frames[max(t + i - age, 0)] for age in range(history)]) for i in (0, 1))
            found.append((kept[t], now, then, t + 1 == len(kept)))
    at, now, then, ends = map(np.array, zip(*found, strict=True))
    return [*columns, *(f"missing_{name}" for name in flagged), *(f"previous_{name}" for name in acted)], {
        **{name: rows[name].to_numpy()[at] for name in rows},
        "row": at,
        "observations": now,
        "next_observations": then,
        "actions": rows[ACTIONS].to_numpy(dtype)[at],
        "rewards": rewards(rows, **view).to_numpy()[at],
        "truncated": ends,
        "costs": later["cost"].to_numpy(np.float32)[at],
        **({"expert_actions": rows[EXPERT].to_numpy()[at]} if EXPERT[0] in rows else {}),
    }


def exported(chosen, path, history, view):
    ibdata.export(chosen, "npz", path, history=history, view=view, overwrite=True)
    names = {"terminals": "terminated", "timeouts": "truncated"}
    with np.load(path) as file:
        shown = {name.removeprefix("infos/"): array for name, array in file.items()}
    return {names.get(name, name): array for name, array in shown.items() if "clean" not in name}


def batches(chosen, view):
    found = list(chosen.iter_batches(batch_rows=7, view=view))
    assert max(batch.num_rows for batch in found) <= 7
    return pa.Table.from_batches(found).to_pandas(ignore_metadata=True)


def of_columns(found, frame, view):
    """The arrays of a table; without a view, it has all columns of the dataset."""
    parts = {"observations": frame, "next_observations": [f"next_{x}" for x in frame], "actions": ACTIONS}
    shown = [name for columns in parts.values() for name in columns] if view else []
    names = {"reward": "rewards", "cost": "costs"}
    own = {names.get(name, name): found[name].to_numpy() for name in found if name not in shown}
    return {name: found[columns].to_numpy() for name, columns in parts.items()} | own


COLUMNS = {
    "table": lambda d, view: d.table(view=view).to_pandas(ignore_metadata=True),
    "pandas": lambda d, view: d.to_pandas(view=view).rename_axis("row").reset_index(),
    "batches": batches,
}


@pytest.fixture(scope="module", params=SETS)
def known(request, describe, made_at, tmp_path_factory):
    """A dataset with splits, which are files or labels, and its rows as pandas reads them."""
    made = made_at(
        describe(episodes=2, steps=15, **SETS[request.param]), tmp_path_factory.mktemp("ways") / "made"
    )
    for splits in ({} if made.splits else SPLITS, by_policy("random", "calm")):
        made = ibdata.split(made, splits) if splits else made
    return made, pd.read_parquet(made.path / "data")


@pytest.mark.parametrize(("history", "pad", "view"), VIEWS)
def test_all_ways_to_read_give_the_values_of_the_rows(known, tmp_path, history, pad, view):
    """Each view meets two of the selections, and each selection a view of each set."""
    dataset, rows = known
    frame, whole = naive(rows, history, pad, view)
    ask = {"history": history, "pad": pad, "view": view}
    for conditions, inside in choices(dataset.episodes)[VIEWS.index((history, pad, view)) % 5 :: 5]:
        chosen, numbers = dataset.select(**conditions), np.flatnonzero(inside)
        assert chosen.episodes["episode"].tolist() == numbers.tolist()
        kept, windows = np.isin(whole["episode"], numbers), chosen.windows(**ask)
        found = {"arrays": chosen.arrays(columns=list(rows), **ask), "windows": windows[:]}
        assert windows.frame == tuple(frame)
        if pad == "repeat":  # as all exports have it
            assert windows.left_out == len(chosen) - kept.sum() < len(chosen)
            found["export"] = exported(chosen, tmp_path / "npz", history, view)
        if history == 1:
            found |= {x: of_columns(way(chosen, view or None), frame, view) for x, way in COLUMNS.items()}
        for way, values in found.items():
            for name, array in values.items():
                expected = whole[name][kept]
                if way in ("windows", "export") and expected.dtype == np.float64:
                    expected = expected.astype(np.float32)
                assert (array.dtype, array.shape) == (expected.dtype, expected.shape), (way, name)
                assert np.array_equal(array, expected), (way, name)
    stored = chosen.windows(**ask, folder=tmp_path / "windows")
    assert all(np.array_equal(stored[:][name], array) for name, array in found["windows"].items())
