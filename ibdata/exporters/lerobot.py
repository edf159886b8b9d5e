"""A LeRobotDataset v3.0 without images: a folder with data/ and meta/. A frame has its next observation, as
`next.observation.state`, so that no transition is lost. `next.done` marks the last frame of each episode, as
in LeRobot's recordings; bootstrap unless `next.terminated`. One step is one second. The task of an episode
names its setpoint. Episodes are numbered from 0. There is nothing beside what is observed: no
latent state, no log density, no clean values. The quantiles of more than 50,000 frames are those of an evenly
spaced sample. Written in constant memory.
"""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from ibdata._numerics.arrays import Array, Arrays
from ibdata._numerics.naming import exact
from ibdata.dataset.statistics import Matrix, Moments, RowStatistics
from ibdata.exporters._source import PARQUET, Source, vectors
from ibdata.generation.metadata import as_json
from ibdata.views.options import ACTIONS

HOLDS_COSTS = True  # it has a place for them
FPS = 1  # frames per second; a step of the benchmark has no duration
FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
CHUNK_FILES = 1000
FILE_MB = 100
ROW_GROUP_EPISODES = 100  # rows of a row group in meta/episodes
PLACE = ("meta/episodes/chunk_index", "meta/episodes/file_index")
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


class _Files:
    """Numbered Parquet files of a folder. A table that would make a file too large goes to the next one."""

    def __init__(self, folder: Path, metadata: dict[str, str]) -> None:
        self.folder = folder
        self.metadata = metadata
        self.number = 0
        self.writer: Any = None

    def close(self) -> None:
        if self.writer:
            self.writer.close()
            self.writer = None

    @property
    def path(self) -> Path:
        chunk, file = divmod(self.number, CHUNK_FILES)
        return self.folder / FILE.format(chunk_index=chunk, file_index=file)

    def write(self, table: pa.Table, *columns: str) -> tuple[int, int]:
        """Write the table as a row group. Return the numbers of its chunk and its file, also its columns."""
        if self.writer and self.path.stat().st_size + table.nbytes > FILE_MB * 2**20:
            self.close()
            self.number += 1
        place = divmod(self.number, CHUNK_FILES)
        for name, number in zip(columns, place, strict=False):
            table = table.append_column(name, pa.array([number] * len(table)))
        table = table.replace_schema_metadata(self.metadata)
        if self.writer is None:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.writer = pq.ParquetWriter(self.path, table.schema, **PARQUET)
        self.writer.write_table(table)
        return place


def export(source: Source, path: Path, target: Path) -> str:
    """Write the folder."""
    source.refuse_no_rows()
    metadata = {"view": json.dumps(source.plain())}
    meta = path / "meta"
    data, episodes = _Files(path / "data", metadata), _Files(meta / "episodes", metadata)
    start = 0
    tasks: dict[str, int] = {}
    total: dict[str, RowStatistics] = {}
    rows: list[dict[str, Any]] = []
    with closing(data), closing(episodes):
        for number, block in enumerate(source.episode_blocks()):
            task = _task(source, block)
            columns = _columns(block, number, start, tasks.setdefault(task, len(tasks)))
            frames = pa.table({name: _column(array) for name, array in columns.items()})
            place = data.write(frames)
            total = total or {name: RowStatistics(source.rows, source.rows) for name in columns}
            statistics = {}
            for name, array in columns.items():
                floats = np.result_type(array.dtype, np.float32)  # which have all the numbers
                numbers = array.reshape(len(array), -1).T.astype(floats, order="C")
                statistics[name] = _statistics(array.dtype, total[name].add(numbers), numbers)
            rows.append(_episode(number, task, place, range(start, start + len(frames)), statistics))
            start += len(frames)
            if len(rows) == ROW_GROUP_EPISODES or start == source.rows:
                episodes.write(pa.Table.from_pylist(rows), *PLACE)
                rows.clear()
    table = pa.Table.from_pandas(pd.Series(tasks, name="task_index").rename_axis("task").to_frame())
    table = table.replace_schema_metadata({**table.schema.metadata, **metadata})
    pq.write_table(table, meta / "tasks.parquet", **PARQUET)
    whole = {name: _statistics(columns[name].dtype, x.moments, x.sample) for name, x in total.items()}
    (meta / "stats.json").write_bytes(as_json(whole))
    (meta / "info.json").write_bytes(as_json(_info(source, columns, len(tasks))))
    return f"""\
from lerobot.datasets.lerobot_dataset import LeRobotDataset

dataset = LeRobotDataset({f"ibdata/{source.info.name}"!r}, root={str(target)!r})
"""


def _task(source: Source, block: Arrays) -> str:
    setpoint = source.table["setpoint"].loc[int(block["episode"][0])]
    where = "a moving setpoint" if source.info.drifting else f"setpoint {exact(setpoint)}"
    return f"Operate the Industrial Benchmark at {where}"


def _columns(block: Arrays, number: int, start: int, task: int) -> Arrays:
    """The features of an episode; `start` is the number of its first frame."""
    steps = block["step"].astype(np.int64)
    costs = {"next.cost": block["costs"]} if "costs" in block else {}
    return {
        "observation.state": block["observations"],
        "action": block["actions"],
        "next.observation.state": block["next_observations"],
        "next.reward": block["rewards"],
        **costs,
        "next.done": block["terminated"] | block["truncated"],
        "next.terminated": block["terminated"],
        "next.truncated": block["truncated"],
        "timestamp": (steps / FPS).astype(np.float32),
        "frame_index": steps,
        "episode_index": np.full_like(steps, number),
        "index": start + steps,
        "task_index": np.full_like(steps, task),
    }


def _column(array: Array) -> pa.Array:
    """Lists of one size. LeRobot wants numbers, not lists, if the size is 1."""
    return pa.array(array.reshape(-1)) if array.size == len(array) else vectors(array)


def _statistics(kind: Any, of: Moments, sample: Matrix) -> dict[str, list[Any]]:
    """The statistics of a feature, whose numbers have this type, by the names that LeRobot has."""
    quantiles = np.quantile(sample.astype(np.float64), list(QUANTILES.values()), axis=1)
    numbers = {
        "min": of.low.astype(kind),
        "max": of.high.astype(kind),
        "mean": of.mean,
        "std": np.sqrt(of.squares / of.rows),
        "count": np.array([of.rows]),
        **dict(zip(QUANTILES, quantiles, strict=True)),
    }
    return {name: values.tolist() for name, values in numbers.items()}


def _episode(
    number: int, task: str, place: tuple[int, int], frames: range, statistics: dict[str, Any]
) -> dict[str, Any]:
    """The row of an episode in meta/episodes."""
    return {
        "episode_index": number,
        "tasks": [task],
        "length": len(frames),
        "data/chunk_index": place[0],
        "data/file_index": place[1],
        "dataset_from_index": frames.start,
        "dataset_to_index": frames.stop,
        **{
            f"stats/{feature}/{name}": numbers
            for feature, each in statistics.items()
            for name, numbers in each.items()
        },
    }


def _info(source: Source, columns: Arrays, tasks: int) -> dict[str, Any]:
    lags = ["", *(f"_lag_{lag}" for lag in range(1, source.history))]
    frame = [f"{name}{lag}" for lag in lags for name in source.frame]
    names = {"observation.state": frame, "action": list(ACTIONS), "next.observation.state": frame}
    features = {
        name: {"dtype": str(array.dtype), "shape": [array.size // len(array)], "names": names.get(name)}
        for name, array in columns.items()
    }
    return {
        "codebase_version": "v3.0",
        "robot_type": "industrial_benchmark",
        "total_episodes": source.episodes,
        "total_frames": source.rows,
        "total_tasks": tasks,
        "chunks_size": CHUNK_FILES,
        "data_files_size_in_mb": FILE_MB,
        "video_files_size_in_mb": 200,  # of videos that others may add
        "fps": FPS,
        "splits": {"train": f"0:{source.episodes}"},
        "data_path": f"data/{FILE}",
        "video_path": None,
        "features": features,
    }
