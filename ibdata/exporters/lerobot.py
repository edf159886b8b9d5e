"""A LeRobotDataset v3.0 without images: a folder with data/ and meta/. A frame has its next observation, as
`next.observation.state`, so that no transition is lost. `next.done` marks the last frame of each episode, as
in LeRobot's recordings; bootstrap unless `next.terminated`. One step is one second. The task of an episode
names its setpoint. Episodes are numbered from 0. There is nothing beside what is observed: no
latent state, no log density, no clean values. Written in
constant memory.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from ibdata.exporters._arrays import PARQUET, vectors
from ibdata.exporters._view import Array, Arrays, Block, View
from ibdata.numerics.naming import exact
from ibdata.views.options import ACTIONS
from ibdata.writing.metadata import as_json

COSTS = True  # it has a place for them
VERSION = "v3.0"
FPS = 1  # frames per second; a step of the benchmark has no duration
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
CHUNK_FILES = 1000
FILE_MB = 100
VIDEO_MB = 200  # of videos that others may add
EPISODES = 100  # rows of a row group in meta/episodes
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}

Statistics = dict[str, Arrays]  # of each feature, by their names


class _Files:
    """Numbered Parquet files of a folder. A table that would make a file too large goes to the next one."""

    def __init__(self, folder: Path, metadata: dict[str, str]) -> None:
        self.folder = folder
        self.metadata = metadata
        self.number = 0
        self.writer: Any = None

    def __enter__(self) -> _Files:
        return self

    def __exit__(self, *failure: object) -> None:
        if self.writer:
            self.writer.close()

    @property
    def path(self) -> Path:
        chunk, file = divmod(self.number, CHUNK_FILES)
        return self.folder / FILE.format(chunk_index=chunk, file_index=file)

    def place(self, table: pa.Table) -> tuple[int, int]:
        """The numbers of the chunk and the file that the table goes to."""
        if self.writer and self.path.stat().st_size + table.nbytes > FILE_MB * 2**20:
            self.writer.close()
            self.writer = None
            self.number += 1
        return divmod(self.number, CHUNK_FILES)

    def write(self, table: pa.Table) -> None:
        """Write the table as a row group to its place."""
        table = table.replace_schema_metadata(self.metadata)
        if self.writer is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.writer = pq.ParquetWriter(self.path, table.schema, **PARQUET)
        self.writer.write_table(table)


def export(view: View, path: Path, target: Path) -> str:
    """Write the folder."""
    view.refuse_no_rows()
    metadata = {"view": json.dumps(view.plain())}
    meta = path / "meta"
    start = 0
    tasks: dict[str, int] = {}
    total: Statistics = {}
    rows: list[dict[str, Any]] = []
    with _Files(path / "data", metadata) as data, _Files(meta / "episodes", metadata) as episodes:
        for number, block in enumerate(view.episode_blocks()):
            task = _task(view, block)
            columns = _columns(block, number, start, tasks.setdefault(task, len(tasks)))
            frames = pa.table({name: _column(array) for name, array in columns.items()})
            place = data.place(frames)
            data.write(frames)
            statistics = {name: _statistics(array) for name, array in columns.items()}
            total = _combined(total, statistics) if total else statistics
            rows.append(_episode(number, task, place, range(start, start + len(frames)), statistics))
            start += len(frames)
            if len(rows) == EPISODES or start == view.rows:
                _write_episodes(rows, episodes)
                rows.clear()
    _write_tasks(tasks, meta / "tasks.parquet", metadata)
    (meta / "stats.json").write_bytes(as_json(_lists(total)))
    (meta / "info.json").write_bytes(as_json(_info(view, columns, len(tasks))))
    return f"""\
from lerobot.datasets.lerobot_dataset import LeRobotDataset

dataset = LeRobotDataset({f"ibdata/{view.info.name}"!r}, root={str(target)!r})
"""


def _task(view: View, block: Block) -> str:
    setpoint = view.table["setpoint"].loc[int(block.episode[0])]
    where = "a moving setpoint" if view.info.drifting else f"setpoint {exact(setpoint)}"
    return f"Operate the Industrial Benchmark at {where}"


def _columns(block: Block, number: int, start: int, task: int) -> Arrays:
    """The features of an episode; `start` is the number of its first frame."""
    steps = block.step.astype(np.int64)
    costs = {"next.cost": block.extras["cost"]} if "cost" in block.extras else {}
    return {
        "observation.state": block.observations,
        "action": block.actions,
        "next.observation.state": block.next_observations,
        "next.reward": block.rewards,
        **costs,
        "next.done": block.terminated | block.truncated,
        "next.terminated": block.terminated,
        "next.truncated": block.truncated,
        "timestamp": (steps / FPS).astype(np.float32),
        "frame_index": steps,
        "episode_index": np.full_like(steps, number),
        "index": start + steps,
        "task_index": np.full_like(steps, task),
    }


def _column(array: Array) -> pa.Array:
    """Lists of one size. LeRobot wants numbers, not lists, if the size is 1."""
    return pa.array(array.reshape(-1)) if array.size == len(array) else vectors(array)


def _statistics(array: Array) -> Arrays:
    """The statistics of a feature in an episode, as LeRobot names them."""
    numbers = array.reshape(len(array), -1)
    exactly = numbers.astype(np.float64)
    quantiles = np.quantile(exactly, list(QUANTILES.values()), axis=0)
    return {
        "min": numbers.min(axis=0),
        "max": numbers.max(axis=0),
        "mean": exactly.mean(axis=0),
        "std": exactly.std(axis=0),
        "count": np.array([len(numbers)]),
        **dict(zip(QUANTILES, quantiles, strict=True)),
    }


def _combined(total: Statistics, more: Statistics) -> Statistics:
    return {name: _combined_feature(total[name], more[name]) for name in total}


def _combined_feature(one: Arrays, other: Arrays) -> Arrays:
    """The statistics of both. A quantile is the mean of both quantiles, as LeRobot combines them."""
    count = one["count"] + other["count"]
    share = other["count"] / count
    variance = (1 - share) * one["std"] ** 2 + share * other["std"] ** 2
    variance += share * (1 - share) * (other["mean"] - one["mean"]) ** 2
    return one | {
        **{name: one[name] + share * (other[name] - one[name]) for name in ("mean", *QUANTILES)},
        "min": np.minimum(one["min"], other["min"]),
        "max": np.maximum(one["max"], other["max"]),
        "std": np.sqrt(variance),
        "count": count,
    }


def _lists(statistics: Statistics) -> dict[str, dict[str, list[Any]]]:
    return {
        feature: {name: values.tolist() for name, values in each.items()}
        for feature, each in statistics.items()
    }


def _episode(
    number: int, task: str, place: tuple[int, int], frames: range, statistics: Statistics
) -> dict[str, Any]:
    """The row of an episode in meta/episodes."""
    lists = _lists(statistics)
    return {
        "episode_index": number,
        "tasks": [task],
        "length": len(frames),
        "data/chunk_index": place[0],
        "data/file_index": place[1],
        "dataset_from_index": frames.start,
        "dataset_to_index": frames.stop,
        **{f"stats/{feature}/{name}": x for feature, each in lists.items() for name, x in each.items()},
    }


def _write_episodes(rows: list[dict[str, Any]], episodes: _Files) -> None:
    """Write rows, each with the place of its own."""
    table = pa.Table.from_pylist(rows)
    for name, number in zip(("chunk", "file"), episodes.place(table), strict=True):
        table = table.append_column(f"meta/episodes/{name}_index", pa.array([number] * len(rows)))
    episodes.write(table)


def _write_tasks(tasks: dict[str, int], path: Path, metadata: dict[str, str]) -> None:
    """Write the numbers of the tasks, whose texts are the index in pandas."""
    table = pa.Table.from_pandas(pd.Series(tasks, name="task_index").rename_axis("task").to_frame())
    pq.write_table(table.replace_schema_metadata({**table.schema.metadata, **metadata}), path, **PARQUET)


def _info(view: View, columns: Arrays, tasks: int) -> dict[str, Any]:
    lags = ["", *(f"_lag_{lag}" for lag in range(1, view.history))]
    frame = [f"{name}{lag}" for lag in lags for name in view.frame]
    names = {"observation.state": frame, "action": list(ACTIONS), "next.observation.state": frame}
    features = {
        name: {"dtype": str(array.dtype), "shape": [array.size // len(array)], "names": names.get(name)}
        for name, array in columns.items()
    }
    return {
        "codebase_version": VERSION,
        "robot_type": "industrial_benchmark",
        "total_episodes": view.episodes,
        "total_frames": view.rows,
        "total_tasks": tasks,
        "chunks_size": CHUNK_FILES,
        "data_files_size_in_mb": FILE_MB,
        "video_files_size_in_mb": VIDEO_MB,
        "fps": FPS,
        "splits": {"train": f"0:{view.episodes}"},
        "data_path": f"data/{FILE}",
        "video_path": None,
        "features": features,
    }
