"""LeRobot opens the export, finds every value, and would have written the same files."""

import json
import logging
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import torch
from exporters.export_tests import ExportTests
from exporters.reading import LEROBOT, of_lerobot, ran
from lerobot.datasets.compute_stats import aggregate_stats, compute_episode_stats
from lerobot.datasets.lerobot_dataset import LeRobotDataset, LeRobotDatasetMetadata
from lerobot.datasets.utils import DEFAULT_FEATURES, flatten_dict, unflatten_dict

import ibdata

logging.getLogger().setLevel(logging.ERROR)  # LeRobot warns of the video decoder that is not there


def opened(made):
    return LeRobotDataset("ibdata/small", root=made.path)


class TestLeRobot(ExportTests):
    format = "lerobot"

    def read(self, made):
        found = ran(made)["dataset"]
        assert (found.num_episodes, found.num_frames) == (made.episodes, made.rows)
        items = [found[i] for i in range(made.rows)]
        assert items[-1]["task"].startswith("Operate the Industrial Benchmark at setpoint ")
        columns = items[0].keys() & LEROBOT.keys()
        return of_lerobot({name: torch.stack([item[name] for item in items]).numpy() for name in columns})


def written_by_lerobot(found, root):
    """The metadata that LeRobot writes of the same frames."""
    features = {name: feature for name, feature in found.features.items() if name not in DEFAULT_FEATURES}
    theirs = LeRobotDatasetMetadata.create(
        "ibdata/small", found.fps, features, found.meta.robot_type, root, use_videos=False
    )
    for number in range(found.num_episodes):
        row = found.meta.episodes[number]
        frames = slice(row["dataset_from_index"], row["dataset_to_index"])
        statistics = compute_episode_stats(found.hf_dataset.with_format("numpy")[frames], found.features)
        place = {key: value for key, value in row.items() if key.startswith("data")}
        theirs.save_episode_tasks(row["tasks"])
        theirs.save_episode(number, row["length"], row["tasks"], statistics, place)
    theirs._close_writer()


@pytest.mark.filterwarnings("ignore:Converting input from bool")  # of LeRobot's histograms of flags
def test_lerobot_writes_the_same_metadata_of_these_frames(dataset, tmp_path):
    found = opened(ibdata.export(dataset, "lerobot", tmp_path / "ours"))
    written_by_lerobot(found, tmp_path / "theirs")
    folders = (tmp_path / "ours" / "meta", tmp_path / "theirs" / "meta")
    ours, theirs = (json.loads((folder / "info.json").read_text()) for folder in folders)
    assert ours == theirs
    ours, theirs = (pq.read_table(folder / "episodes/chunk-000/file-000.parquet") for folder in folders)
    assert ours.schema.equals(theirs.schema)
    frames = found.hf_dataset.with_format("numpy")[:]
    for name in ours.column_names:
        values = ours[name].to_pylist(), theirs[name].to_pylist()
        if name.endswith(("/mean", "/std")):  # LeRobot computes in float32
            np.testing.assert_allclose(*values, rtol=1e-3, atol=1e-3)
        elif "/q" in name:  # LeRobot takes them from a histogram, which ends up to two frames away
            ordered = np.sort(frames[name.split("/")[1]].reshape(12, 40, -1).astype(float), axis=1)
            assert np.abs(np.subtract(*values)).max() <= 2 * np.diff(ordered, axis=1).max() + 1e-6
        else:
            assert values[0] == values[1]


def test_statistics_of_all_frames_are_lerobots_combination(dataset, tmp_path):
    """But for quantiles, of which LeRobot takes means; ours are those of the frames."""
    made = ibdata.export(dataset, "lerobot", tmp_path / "made", history=2)
    rows = pq.read_table(Path(made.path) / "meta" / "episodes").to_pylist()
    each = [{key: np.array(x) for key, x in row.items() if key.startswith("stats/")} for row in rows]
    expected = flatten_dict(aggregate_stats([unflatten_dict(statistics)["stats"] for statistics in each]))
    found = flatten_dict(opened(made).meta.stats)
    assert set(found) == set(expected)
    for name, values in found.items():
        if "/q" not in name:
            np.testing.assert_allclose(values, expected[name], rtol=1e-9, atol=1e-9)


def test_the_page_of_libraries_opens_an_export(use_with):
    (names,) = use_with("LeRobot")
    assert names["data"].num_frames > 0
