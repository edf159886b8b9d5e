"""Reading exports back as the arrays of `Dataset.arrays`: by their snippet, or by the form of the files."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from ibdata import Dataset
from ibdata.exporters import Exported

ACTIONS = ["act_velocity", "act_gain", "act_shift"]
TRANSITION = {"observations", "actions", "rewards", "next_observations"}
D4RL = {"terminals": "terminated", "timeouts": "truncated"}
RLLIB = {"observation": "observations", "action": "actions", "reward": "rewards"}
RLLIB |= {"next_observation": "next_observations"}
LEROBOT = {
    "observation.state": "observations",
    "action": "actions",
    "next.observation.state": "next_observations",
    "next.reward": "rewards",
    "next.cost": "costs",
    "next.terminated": "terminated",
    "next.truncated": "truncated",
}


def files(folder: Path) -> dict[Path, bytes]:
    """The content of all files below a folder."""
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def equal(found: Any, expected: Any) -> None:
    """The same bits in the same form; where the export has float32, float64 is rounded first."""
    found, expected = np.asarray(found), np.asarray(expected)
    if expected.dtype == np.float64 and found.dtype == np.float32:
        expected = expected.astype(np.float32)
    assert found.dtype == expected.dtype
    assert found.shape == expected.shape
    assert found.tobytes() == expected.tobytes()


def ran(made: Exported) -> dict[str, Any]:
    """The variables of an export's snippet."""
    names: dict[str, Any] = {}
    exec(made.snippet, names)
    return names


def parquet(path: str) -> dict[str, Any]:
    """The columns of a file, or of the files of a folder; those of lists are matrices."""
    table = pq.read_table(path)
    found = {name: table[name].to_numpy() for name in table.column_names}
    return {name: np.stack(x) if x.dtype == object else x for name, x in found.items()}


def csv(made: Exported) -> dict[str, Any]:
    data = ran(made)["data"]
    lags = ["", *(f"_lag_{lag}" for lag in range(1, made.history))]
    now, later = ([f"{prefix}{name}{lag}" for lag in lags for name in made.frame] for prefix in ("", "next_"))
    hidden = [name for name in data if name.startswith(("latent", "next_latent", "action_log", "clean"))]
    floats = {name: data[name].to_numpy(np.float32) for name in {*hidden} - {*now, *later}}
    return floats | {
        "observations": data[now].to_numpy(np.float32),
        "actions": data[ACTIONS].to_numpy(np.float32),
        "rewards": data["reward"].to_numpy(np.float32),
        "next_observations": data[later].to_numpy(np.float32),
        **({"costs": data["cost"].to_numpy(np.float32)} if "cost" in data else {}),
        **{name: data[name].to_numpy() for name in ("terminated", "truncated", "episode")},
        "step": data["step"].to_numpy(np.int32),
    }


def d3rlpy(made: Exported) -> dict[str, Any]:
    """By its rule: the next observation is that of the next row, and the last row is no transition."""
    import h5py

    with h5py.File(made.path) as file:
        observations, actions, rewards = (
            [file[f"{key}_{i}"][()] for i in range(made.episodes)]
            for key in ("observations", "actions", "rewards")
        )
    return {
        "observations": np.concatenate([one[:-1] for one in observations]),
        "actions": np.concatenate([one[:-1] for one in actions]),
        "rewards": np.concatenate([one[:-1, 0] for one in rewards]),
        "next_observations": np.concatenate([one[1:] for one in observations]),
    }


def d4rl(made: Exported) -> dict[str, Any]:
    """All arrays of the file; the snippet has the transitions."""
    import h5py

    data = ran(made)["data"]
    assert {D4RL.get(name, name) for name in data} == TRANSITION | {"terminated", "truncated"}
    with h5py.File(made.path) as file:
        infos = {name: array[()] for name, array in file["infos"].items()}
        return named(
            {**{name: array[()] for name, array in file.items() if name != "infos"}, **infos, **data}
        )


def npz(made: Exported) -> dict[str, Any]:
    return named({name.removeprefix("infos/"): array for name, array in ran(made)["data"].items()})


def named(found: dict[str, Any]) -> dict[str, Any]:
    """The arrays of D4RL under the names of `Dataset.arrays`."""
    return {D4RL.get(name, name): array for name, array in found.items()}


def neorl(made: Exported) -> dict[str, Any]:
    data = ran(made)["data"]
    assert data["done"].dtype == np.float32
    return {
        "observations": data["obs"],
        "actions": data["action"],
        "rewards": data["reward"][:, 0],
        "next_observations": data["next_obs"],
        "truncated": data["done"][:, 0] == 1,
    }


def rllib(made: Exported) -> dict[str, Any]:
    return {RLLIB.get(name, name): array for name, array in parquet(made.path).items()}


def lerobot(made: Exported) -> dict[str, Any]:
    found = parquet(f"{made.path}/data")
    assert found["frame_index"].dtype == np.int64
    return {**of_lerobot(found), "step": found["frame_index"].astype(np.int32)}


def of_lerobot(found: dict[str, Any]) -> dict[str, Any]:
    """The arrays of LeRobot's columns, among which a vector of one entry is a number."""
    arrays = {LEROBOT[name]: array for name, array in found.items() if name in LEROBOT}
    frames = {name: array.reshape(len(array), -1) for name, array in arrays.items() if "observations" in name}
    return {**arrays, **frames}


READERS = {
    "csv": csv,
    "d3rlpy": d3rlpy,
    "d4rl": d4rl,
    "lerobot": lerobot,
    "neorl": neorl,
    "npz": npz,
    "rllib": rllib,
}


def read(made: Exported) -> dict[str, Any]:
    """What a reader of the files finds in an export."""
    return READERS[made.format](made)


def holds(
    made: Exported,
    dataset: Dataset,
    split: str | None = None,
    history: int = 1,
    view: Any = None,
    read: Any = read,
) -> dict[str, Any]:
    """An export holds every value of the dataset's arrays, or of its columns. Return what was read."""
    found = read(made)
    columns = {name.removeprefix("clean_") for name in found} & {x["name"] for x in dataset.info["columns"]}
    expected = dataset.arrays(history, split, columns=sorted(columns), view=view)
    assert made.rows == len(expected["rewards"])
    assert made.episodes == np.count_nonzero(expected["step"] == 0)
    assert found.keys() >= TRANSITION
    for name, array in found.items():
        equal(array, expected[name.removeprefix("clean_")])
    return found
