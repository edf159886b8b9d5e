"""TorchRL's reader of LeRobot's datasets makes transitions of the export."""

import os
import warnings
from pathlib import Path

import pytest
from exporters.reading import LEROBOT

import ibdata

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # TorchRL warns of itself
    from torchrl.data.datasets import LeRobotExperienceReplay

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::UserWarning")
COMMIT = "0" * 40


def as_downloaded(folder, name):
    """Let the hub's cache hold a folder, as if it had been downloaded."""
    cache = Path(os.environ["HF_HOME"], "hub", f"datasets--ibdata--{name}")
    for part in ("refs", "snapshots"):
        (cache / part).mkdir(parents=True)
    (cache / "refs" / "main").write_text(COMMIT)
    (cache / "snapshots" / COMMIT).symlink_to(folder)


@pytest.mark.parametrize("history", [1, 3])
def test_transitions_have_their_own_next_observations(dataset, tmp_path, history):
    """Those of the last step of each episode too, where TorchRL otherwise has none."""
    made = ibdata.export(dataset, "lerobot", tmp_path / "made", split="target", history=history)
    as_downloaded(made.path, f"target-{history}")
    replay = LeRobotExperienceReplay(
        f"ibdata/target-{history}", root=tmp_path / "root", batch_size=20, slice_len=5
    )
    data, arrays = replay[:], dataset.arrays(history, "target")
    for key, name in LEROBOT.items():
        if name in arrays:
            assert data[tuple(key.split("."))].numpy().tobytes() == arrays[name].tobytes(), name
    assert data["next", "done"].sum() == 4
    assert set(data["language_instruction"]) == {"Operate the Industrial Benchmark at setpoint 70"}
    episodes = replay.sample()["episode"].reshape(4, 5)
    assert (episodes == episodes[:, :1]).all()
