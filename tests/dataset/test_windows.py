"""Windows in memory and in a folder."""

import json
import pickle

import numpy as np
import pytest
from helpers.refusals import refused

import ibdata
from ibdata.errors import UsageError


def test_windows_are_chosen_as_rows_of_arrays(dataset):
    windows, arrays = dataset.windows(history=3), dataset.arrays(history=3)
    assert len(windows) == len(arrays["rewards"])
    for index in (0, 1, len(windows) - 1, -1):
        one = windows[index]
        assert all((one[name] == arrays[name][index]).all() for name in one)
    mask = arrays["rewards"] > np.median(arrays["rewards"])
    for found, rows in (
        (windows[3:9], slice(3, 9)),
        (windows[-2:], slice(-2, None)),
        (windows[::-7], slice(None, None, -7)),
        (windows[9:9], slice(9, 9)),
        (windows.batch(mask), mask),
        (windows.batch([]), []),
    ):
        assert all(np.array_equal(found[name], arrays[name][rows]) for name in found)
    batch = windows.__getitems__([5, 3])
    assert [one["rewards"] for one in batch] == arrays["rewards"][[5, 3]].tolist()


def test_what_are_neither_numbers_nor_a_mask_is_an_index_error(dataset):
    windows = dataset.windows()
    for given in ([True, False], [0.9], [[0, 1]], 3, ["0"], np.zeros(0, bool)):
        with pytest.raises(IndexError, match=r"found .* expected whole numbers \(n,\) or a mask"):
            windows.batch(given)
    for beyond in (10**6, -(10**6)):
        with pytest.raises(IndexError):
            windows[beyond]
        with pytest.raises(IndexError, match="expected 0 …"):
            windows.batch([beyond])


def test_a_folder_keeps_the_values_and_is_used_again(dataset, tmp_path, monkeypatch):
    folder = tmp_path / "new" / "windows"
    made = dataset.windows(history=4, folder=folder, split="target")
    assert not made._stored["frames"].flags.writeable
    assert [path.name for path in folder.parent.iterdir()] == ["windows"]
    described = json.loads((folder / "windows.json").read_text())
    assert described["content_root"] == dataset.content_root
    assert described["view"]["frame"][-1] == "obs_consumption"
    monkeypatch.setattr("ibdata.dataset.windows._write", None)
    again = dataset.windows(history=2, folder=folder, split="target")
    plain = dataset.arrays(history=2, split="target")
    assert (again.batch(range(len(again)))["observations"] == plain["observations"]).all()


def test_a_folder_with_anything_else_is_refused(dataset, tmp_path):
    dataset.windows(folder=tmp_path / "windows")
    with pytest.raises(UsageError, match=r"folder: .*windows holds something else .* choose another folder"):
        dataset.windows(folder=tmp_path / "windows", view={"observe": ["obs_gain"]})
    ibdata.generate("random", tmp_path / "begun", overrides={"steps": 3}, workers=1, shards="1/1")
    with pytest.raises(UsageError, match=r"begun: an unfinished run of generate has this name; choose"):
        dataset.windows(folder=tmp_path / "begun")
    (tmp_path / "mine").mkdir()
    refused(r"folder: .*mine holds something else", dataset.windows, folder=tmp_path / "mine")
    assert list((tmp_path / "mine").iterdir()) == []


def test_a_folder_does_not_serve_episodes_in_another_order(tmp_path):
    """Datasets with their policies in another order have one root, but other episodes at each number."""
    made = []
    for policies in (["random", "safe"], ["safe", "random"]):
        experiment = {"name": "two", "setpoints": 70, "policies": policies, "episodes": 2, "steps": 5}
        made.append(ibdata.generate(experiment, tmp_path / policies[0], workers=1))
    one, other = made
    assert one.content_root == other.content_root
    one.select(policy="random").windows(folder=tmp_path / "windows")
    with pytest.raises(UsageError, match="windows holds something else"):
        other.select(policy="safe").windows(folder=tmp_path / "windows")


VIEWED = {"split": "target", "view": {"observe": ["obs_gain"]}}


@pytest.mark.parametrize(("folder", "options"), [(None, {"history": 3}), (None, VIEWED), ("windows", VIEWED)])
def test_a_pickle_is_the_folder_or_each_value_once(dataset, tmp_path, monkeypatch, folder, options):
    """It is what a DataLoader sends to each of its processes."""
    monkeypatch.chdir(tmp_path)
    windows = dataset.windows(folder=folder, **options)
    sent = pickle.dumps(windows)
    once = sum(array.nbytes for array in windows._stored.values())
    assert len(sent) < (1000 if folder else once + 2000)
    monkeypatch.chdir("/")
    again = pickle.loads(sent)
    assert isinstance(again._stored["frames"], np.memmap) == (folder is not None)
    for one, other in zip(windows.batch(range(len(windows))).values(), again[:].values(), strict=True):
        np.testing.assert_array_equal(one, other)
    assert (again.frame, again.history, again.left_out) == (windows.frame, windows.history, windows.left_out)
    if folder:
        (tmp_path / folder).rename(tmp_path / "gone")
        refused(r"^folder: .*windows is gone, expected .*; make the windows again$", pickle.loads, sent)
        dataset.select(policy="random").windows(folder=tmp_path / folder)  # of other episodes
        refused(r"^folder: .*windows holds something else than these windows", pickle.loads, sent)


def test_a_damaged_folder_is_refused(dataset, tmp_path):
    folder = tmp_path / "windows"
    dataset.windows(folder=folder)
    whole = (folder / "frames.npy").read_bytes()
    short = whole.replace(b", 6)", b", 3)", 1)  # half the numbers
    for other in (whole[:-9], b"", b"PK" + whole, short):
        (folder / "frames.npy").write_bytes(other)
        with pytest.raises(UsageError, match=r"^folder: .*windows is damaged .*; remove it, or choose anot"):
            dataset.windows(folder=folder)
