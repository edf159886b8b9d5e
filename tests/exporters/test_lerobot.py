"""The folder of LeRobotDataset v3.0 by its published schema, read with pyarrow and pandas alone."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from exporters.reading import equal, holds, parquet

import ibdata
from ibdata.errors import UsageError
from ibdata.exporters import lerobot


def described(folder):
    return json.loads((folder / "meta" / "info.json").read_text())


def episode_rows(folder):
    return pq.read_table(folder / "meta" / "episodes").to_pylist()


def test_info_describes_each_column(dataset, tmp_path):
    """A vector is a list of fixed size, but a number if it has one entry; bridges/lerobot has the rest."""
    made = ibdata.export(dataset, "lerobot", tmp_path / "made", view={"observe": ["obs_fatigue"]})
    info = described(tmp_path / "made")
    schema = pq.read_schema(tmp_path / "made/data/chunk-000/file-000.parquet")
    assert info["codebase_version"] == "v3.0"
    assert (info["total_frames"], info["total_episodes"], info["splits"]) == (480, 12, {"train": "0:12"})
    assert list(info["features"]) == schema.names
    shown, action = (info["features"][name] for name in ("observation.state", "action"))
    assert (shown["shape"], tuple(shown["names"]), action["shape"]) == ([1], made.frame, [3])
    types = (schema.field("observation.state").type, schema.field("action").type)
    assert types == (pa.float32(), pa.list_(pa.float32(), 3))


def test_frames_are_numbered_and_timed_and_a_task_is_a_setpoint(dataset, tmp_path):
    """Of a split too, whose episodes are numbered anew; bridges/lerobot compares statistics and metadata."""
    made = tmp_path / "made"
    ibdata.export(dataset, "lerobot", made, split=["target", "source"])
    found, steps = parquet(made / "data"), np.tile(np.arange(40), 10)
    equal(found["index"], np.arange(400))
    equal(found["episode_index"], np.repeat(np.arange(10), 40))
    equal(found["timestamp"], steps.astype(np.float32) / np.float32(described(made)["fps"]))
    equal(found["next.done"], steps == 39)
    tasks = pd.read_parquet(made / "meta" / "tasks.parquet")
    texts = [f"Operate the Industrial Benchmark at setpoint {setpoint}" for setpoint in (20, 70)]
    assert tasks.to_dict() == {"task_index": dict(zip(texts, (0, 1), strict=True))}
    names = [row["tasks"][0] for row in episode_rows(made)]
    assert [texts[task] for task in found["task_index"][::40]] == names
    equal(found["task_index"], (found["observation.state"][:, 0] == 70).astype(np.int64))
    told = json.loads((made / "meta" / "stats.json").read_text())["action"]
    x = found["action"].astype(np.float64)
    assert (told["min"], told["max"], told["count"]) == (x.min(0).tolist(), x.max(0).tolist(), [400])
    np.testing.assert_allclose([told["mean"], told["std"]], [x.mean(0), x.std(0)], rtol=1e-9)
    for q in ("q01", "q50", "q90"):
        np.testing.assert_allclose(told[q], np.quantile(x, int(q[1:]) / 100, axis=0), rtol=1e-12)


def test_files_are_numbered_in_chunks_and_hold_whole_episodes(dataset, tmp_path, monkeypatch):
    """Episodes say in which file they are."""
    for name, size in (("FILE_MB", 0.008), ("CHUNK_FILES", 3), ("ROW_GROUP_EPISODES", 2)):
        monkeypatch.setattr(lerobot, name, size)
    made = tmp_path / "made"
    holds(ibdata.export(dataset, "lerobot", made), dataset)
    files = sorted(str(path.relative_to(made)) for path in (made / "data").rglob("*.parquet"))
    assert len(files) >= 4
    assert files[2:4] == ["data/chunk-000/file-002.parquet", "data/chunk-001/file-000.parquet"]
    for file in files:
        found = pq.read_metadata(made / file)
        columns = [found.row_group(i).column(j) for i in range(found.num_row_groups) for j in range(12)]
        assert sum(column.total_compressed_size for column in columns) <= 0.008 * 2**20
    rows, info = episode_rows(made), described(made)
    assert (len(rows), info["chunks_size"]) == (12, 3)
    for folder in ("data", "meta/episodes"):
        places = [(row[f"{folder}/chunk_index"], row[f"{folder}/file_index"]) for row in rows]
        assert len(set(places)) > 3
        for row, (chunk, file) in zip(rows, places, strict=True):
            path = info["data_path"].replace("data", folder).format(chunk_index=chunk, file_index=file)
            assert row["episode_index"] in pq.read_table(made / path)["episode_index"].to_pylist()


def test_a_dataset_of_lerobot_that_is_no_export_is_not_replaced(dataset, tmp_path):
    made = Path(ibdata.export(dataset, "lerobot", tmp_path / "made").path)
    tasks = made / "meta" / "tasks.parquet"
    pd.read_parquet(tasks).to_parquet(tasks)
    with pytest.raises(UsageError, match="made: found no export of ibdata; move it away"):
        ibdata.export(dataset, "lerobot", made, overwrite=True)
    assert pq.read_metadata(made / "data/chunk-000/file-000.parquet").num_rows == 480


def test_episodes_of_which_no_transition_has_its_next_frame_are_refused(tmp_path):
    given = {"name": "x", "setpoints": 20, "policies": ["random"], "episodes": 2, "steps": 1}
    dataset = ibdata.generate(given, tmp_path / "data", workers=1)
    with pytest.raises(UsageError, match="view: found no transition whose next frame is in the dataset"):
        ibdata.export(dataset, "lerobot", tmp_path / "made", view={"observe": "markov"})
    assert not (tmp_path / "made").exists()
