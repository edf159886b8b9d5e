"""Reading exports back with the libraries that they are for, as the arrays of `Dataset.arrays`."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow.parquet as pq
from pyarrow import csv

from ibdata import Dataset
from ibdata.exporters import Exported

ACTIONS = ("act_velocity", "act_gain", "act_shift")
D4RL = {"terminated": "terminals", "truncated": "timeouts", "episode": "infos/episode", "step": "infos/step"}
RLLIB = {
    "observations": "observation",
    "actions": "action",
    "rewards": "reward",
    "next_observations": "next_observation",
}
LEROBOT = {
    "observations": "observation.state",
    "actions": "action",
    "rewards": "next.reward",
    "next_observations": "next.observation.state",
    "terminated": "next.terminated",
    "truncated": "next.truncated",
    "step": "frame_index",
}
SAME = ("terminated", "truncated", "episode", "step")


def one_setpoint(to: str) -> str | None:
    """The split to export: NeoRL's format holds one setpoint."""
    return "target" if to == "neorl" else None


def equal(found: Any, expected: Any) -> None:
    """The same bits in the same form; where the export has float32, float64 is rounded first."""
    found, expected = np.asarray(found), np.asarray(expected)
    if expected.dtype == np.float64 and found.dtype == np.float32:
        expected = expected.astype(np.float32)
    assert found.dtype == expected.dtype
    assert found.shape == expected.shape
    assert found.tobytes() == expected.tobytes()


def holds(
    made: Exported, dataset: Dataset, split: str | None = None, history: int = 1, view: Any = None
) -> None:
    """An export holds every value of the dataset's arrays."""
    expected = dataset.arrays(history, split, view=view)
    assert made.rows == len(expected["rewards"])
    assert made.episodes == np.count_nonzero(expected["step"] == 0)
    for name, array in READERS[made.format](made.path, made).items():
        equal(array, expected[name])


def hdf5(path: str) -> dict[str, Any]:
    """All datasets of an HDF5 file by their paths."""
    found = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: found.update({name: item[()]} if hasattr(item, "shape") else {}))
    return found


def csv_file(path: str, made: Exported) -> dict[str, Any]:
    table = csv.read_csv(path, convert_options=csv.ConvertOptions(column_types={"step": "int32"}))

    def columns(names: Any) -> Any:
        return np.stack([table[name].to_numpy().astype(np.float32) for name in names], axis=1)

    lags = ["", *(f"_lag_{lag}" for lag in range(1, made.history))]
    return {
        "observations": columns([f"{name}{lag}" for lag in lags for name in made.frame]),
        "actions": columns(ACTIONS),
        "rewards": columns(["reward"])[:, 0],
        "next_observations": columns([f"next_{name}{lag}" for lag in lags for name in made.frame]),
        **{name: table[name].to_numpy() for name in SAME},
    }


def d3rlpy(path: str, made: Exported) -> dict[str, Any]:
    """By its rule: the next observation is that of the next row, and the last row is no transition."""
    file = hdf5(path)
    observations, actions, rewards = (
        [file[f"{key}_{i}"] for i in range(made.episodes)] for key in ("observations", "actions", "rewards")
    )
    return {
        "observations": np.concatenate([one[:-1] for one in observations]),
        "actions": np.concatenate([one[:-1] for one in actions]),
        "rewards": np.concatenate([one[:-1, 0] for one in rewards]),
        "next_observations": np.concatenate([one[1:] for one in observations]),
    }


def d4rl(path: str, made: Exported) -> dict[str, Any]:
    return by_name(dict(np.load(path)) if made.format == "npz" else hdf5(path), D4RL)


def neorl(path: str, made: Exported) -> dict[str, Any]:
    data = np.load(path)
    assert data["done"].dtype == np.float32
    return {
        "observations": data["obs"],
        "actions": data["action"],
        "rewards": data["reward"][:, 0],
        "next_observations": data["next_obs"],
        "truncated": data["done"][:, 0] == 1,
    }


def rllib(path: str, made: Exported) -> dict[str, Any]:
    return by_name(parquet(path), RLLIB)


def lerobot(path: str, made: Exported) -> dict[str, Any]:
    found = parquet(f"{path}/data")
    assert found["frame_index"].dtype == np.int64
    found["frame_index"] = found["frame_index"].astype(np.int32)
    return {name: found[column] for name, column in LEROBOT.items()}


def parquet(path: str) -> dict[str, Any]:
    """The columns of a file, or of the files of a folder; those of lists are matrices."""
    table = pq.read_table(path)
    found = {name: table[name].to_numpy() for name in table.column_names}
    return {name: np.stack(x) if x.dtype == object else x for name, x in found.items()}


def minari(path: str, made: Exported) -> dict[str, Any]:
    from minari import MinariDataset

    episodes = list(MinariDataset(Path(path) / "data"))
    return {
        "observations": np.concatenate([one.observations[:-1] for one in episodes]),
        "actions": np.concatenate([one.actions for one in episodes]),
        "rewards": np.concatenate([one.rewards for one in episodes]),
        "next_observations": np.concatenate([one.observations[1:] for one in episodes]),
        "terminated": np.concatenate([one.terminations for one in episodes]),
        "truncated": np.concatenate([one.truncations for one in episodes]),
    }


def by_name(found: dict[str, Any], names: dict[str, str]) -> dict[str, Any]:
    """The arrays by the names that `Dataset.arrays` gives them."""
    return {name: found[names.get(name, name)] for name in (*RLLIB, *SAME)}


READERS = {
    "csv": csv_file,
    "d3rlpy": d3rlpy,
    "d4rl": d4rl,
    "lerobot": lerobot,
    "minari": minari,
    "neorl": neorl,
    "npz": d4rl,
    "rllib": rllib,
}
