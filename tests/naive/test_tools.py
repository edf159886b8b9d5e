"""What people do with whole datasets in a normal year: merge, repair, card; twice and in turn."""

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.folders import contents
from helpers.splits import BY_POLICY, HALVES
from ruamel.yaml import YAML

import ibdata
from ibdata.cli import main
from ibdata.dataset import manifest
from ibdata.errors import IbdataError, UsageError
from ibdata.tools.listing import datasets_in

ODD = 20.1  # which float32 cannot hold
PLAIN = {"name": "p", "setpoints": [ODD, 70], "policies": ["random", "safe"], "episodes": 4, "steps": 5}


def made(place, **changes):
    return ibdata.generate({**PLAIN, **changes}, place, workers=1, overwrite=True)


@pytest.fixture
def ds(tmp_path):
    return made(tmp_path / "p")


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    """Three datasets that differ in their seeds."""
    folder = tmp_path_factory.mktemp("parts")
    return [made(folder / str(seed), seed=seed) for seed in range(3)]


def card_of(dataset):
    return Path(dataset.path, "README.md").read_text(encoding="utf-8")


def whole_rows_are_called(dataset):
    """The name by which `load_dataset` gives all rows."""
    default, *_ = YAML(typ="safe", pure=True).load(card_of(dataset).split("---\n")[1])["configs"]
    [files] = default["data_files"]
    assert files["path"] == ["data/part-*.parquet"]
    return files["split"]


# Merge.


def test_merging_in_pieces_and_in_another_order_gives_the_same_content(parts, tmp_path):
    """((a, b), c) is (a, b, c) is (c, b, a)."""
    a, b, c = parts
    whole = ibdata.merge(parts, tmp_path / "abc")
    pieces = ibdata.merge([ibdata.merge([a, b], tmp_path / "ab"), c], tmp_path / "ab-c")
    other = ibdata.merge([c, b, a], tmp_path / "cba")
    assert whole.content_root == pieces.content_root == other.content_root
    assert whole.table().equals(pieces.table())
    assert other.arrays()["rewards"].tolist() == [x for ds in (c, b, a) for x in ds.arrays()["rewards"]]


def test_a_dataset_is_not_merged_with_itself_or_its_copy(parts, tmp_path):
    """Twice in the list, a part of a merged one, or what `materialize` wrote."""
    a, b, _ = parts
    both = ibdata.merge([a, b], tmp_path / "ab")
    copy = ibdata.split(a, BY_POLICY, materialize=tmp_path / "copy")
    for folders in ([a, a], [both, b], [a, copy]):
        with pytest.raises(UsageError, match="the same episodes are also in"):
            ibdata.merge(folders, tmp_path / "no")
    assert not (tmp_path / "no").exists()


OTHER = {
    "dynamics": (
        {"dynamics": "paper"},
        r"q: dynamics: found 'paper', expected 'siemens' as in .*p; keep both",
    ),
    "changed": (
        {"dynamics": {"base": "siemens", "eta_mean": 0.3}},
        r"q: dynamics: found \{.*'eta_mean': 0.3",
    ),
    "start": ({"start": "uniform"}, "q: start: found 'uniform', expected 'default'"),
    "burn-in": (
        {"start": {"burn_in": [3, 9]}},
        r"q: start: found \{'burn_in': \[3, 9\]\}, expected 'default'",
    ),
    "moving": ({"setpoints": {"drifting": [ODD, 70]}}, "q: setpoints: found 'moving', expected 'constant'"),
}


@pytest.mark.parametrize(("changes", "line"), OTHER.values(), ids=OTHER)
def test_rows_of_two_systems_are_not_merged(ds, tmp_path, changes, line):
    """No column tells them apart, so `importance` and `returns` would mix them."""
    other = made(tmp_path / "q", seed=1, **changes)
    for folders in ([ds, other], [ds.path, other.path]):
        with pytest.raises(UsageError, match=line):
            ibdata.merge(folders, tmp_path / "both")
    assert not (tmp_path / "both").exists()


def test_one_system_in_other_words_is_merged(ds, tmp_path):
    """`{base: siemens}` is `siemens`."""
    other = made(tmp_path / "q", seed=1, dynamics={"base": "siemens"})
    assert ibdata.merge([ds, other], tmp_path / "both").info["dynamics"] == "siemens"


def test_labels_of_merged_datasets_are_their_splits(parts, tmp_path):
    """One with labels and one without: the labels hold the episodes of the first."""
    labelled = ibdata.split(parts[0], HALVES, materialize=tmp_path / "a")
    both = ibdata.merge([labelled, parts[1]], tmp_path / "both")
    assert {name: each["episodes"] for name, each in both.splits.items()} == {"train": 8, "test": 8}
    assert whole_rows_are_called(both) == "everything"
    assert both.arrays(split="test")["rewards"].tolist() == labelled.arrays(split="test")["rewards"].tolist()


def test_what_is_merged_is_selected_exported_and_measured_as_its_parts(parts, tmp_path):
    """The second dataset's episodes follow those of the first."""
    both = ibdata.merge(parts[:2], tmp_path / "both")
    second = both.select(episodes=range(16, 32))
    assert second.episodes["return"].tolist() == parts[1].episodes["return"].tolist()
    assert second.returns()["results"] == parts[1].returns()["results"]
    ibdata.export(second, "npz", tmp_path / "x.npz")
    assert np.array_equal(np.load(tmp_path / "x.npz")["rewards"], parts[1].arrays()["rewards"])
    floors = [ibdata.noise_floor(each).mean for each in (second, parts[1])]
    assert np.array_equal(*floors)
    options = {"steps": 5, "episodes": 4}
    expected = ibdata.true_values(parts[1], (0, 3), "safe", **options)
    found = ibdata.true_values(both, (16, 3), "safe", **options)
    assert found.returns.tolist() == expected.returns.tolist()
    assert ibdata.validate(both) == []


# Card, repair, and the rest in turn.


def test_after_a_split_train_is_not_everything_for_hugging_face(ds):
    """`load_dataset(DIR, split="train")` would give the rows of `test`, too."""
    assert whole_rows_are_called(ds) == "train"
    split = ibdata.split(ds, HALVES)
    assert whole_rows_are_called(split) == "everything"
    assert "| train | 8 | 40 |\n| test | 8 | 40 |\n" in card_of(split)
    assert whole_rows_are_called(ibdata.split(ds, remove=["train", "test"])) == "train"


def test_what_an_own_text_says_in_the_card_stays_after_a_split(ds):
    """The text is edited, and the front matter follows the splits."""
    file = ds.path / "README.md"
    file.write_text(card_of(ds) + "\n## Mine\n\nFor our paper.\n")
    ibdata.split(ds, BY_POLICY)
    assert whole_rows_are_called(ds) == "everything"
    assert card_of(ds).endswith("\n## Mine\n\nFor our paper.\n")


def test_a_card_with_another_head_stays_and_split_says_so(ds, capsys):
    """Nothing of the user's is lost, and nobody believes that the card knows the splits."""
    mine = card_of(ds).replace("# p\n", "# Our plant\n")
    (ds.path / "README.md").write_text(mine)
    ibdata.split(ds, BY_POLICY)
    assert card_of(ds) == mine
    assert "README.md: found other text than ibdata writes, so it does not name" in capsys.readouterr().err


def without_pictures(dataset):
    raise ImportError("no matplotlib")


def test_a_card_is_written_twice_and_after_every_change(ds, monkeypatch):
    """`ibdata card` after `split`, and again: no own card is taken for one that somebody edited."""
    monkeypatch.setattr("ibdata.tools.card.drawn", without_pictures)
    ibdata.card(ds)
    once = contents(ds.path)
    ibdata.card(ds)
    assert contents(ds.path) == once
    ibdata.split(ds, BY_POLICY)
    split = card_of(ds)
    assert "| state action coverage |" in split
    ibdata.card(ds)
    assert card_of(ds) == split


def test_a_repair_keeps_labels_and_is_done_once(ds):
    """After a split: the lost shard comes back with its bytes, and a second repair finds nothing."""
    ibdata.split(ds, BY_POLICY)
    before = contents(ds.path)
    [shard, *_] = (ds.path / "data").iterdir()
    shard.unlink()
    assert ibdata.repair(ds.path, workers=1) == [f"data/{shard.name}"]
    assert contents(ds.path) == before
    assert ibdata.repair(ds.path, workers=1) == []


def test_the_same_command_again_finds_the_labelled_dataset(ds):
    """`generate` after `split` opens what is there, with its labels."""
    ibdata.split(ds, BY_POLICY)
    again = ibdata.generate(PLAIN, ds.path, workers=1)
    assert list(again.splits) == ["random", "safe"]
    assert ibdata.reproduce(again) == (16, [])


def test_an_export_is_no_dataset(ds, tmp_path):
    """What `export` wrote is neither opened, merged, split nor valid."""
    place = ibdata.export(ds, "lerobot", tmp_path / "x").path
    for call in (ibdata.open, lambda x: ibdata.split(x, BY_POLICY), lambda x: ibdata.merge([ds, x], "y")):
        with pytest.raises(IbdataError, match="no finished dataset here"):
            call(place)
    assert "no finished dataset here" in str(ibdata.validate(place))


def as_before(folder):
    """A dataset as an earlier ibdata left it."""
    (folder / "meta/episodes.table").rename(folder / "meta/episodes.parquet")
    entries = json.loads((folder / manifest.PATH).read_bytes()) | {"version": 1}
    (folder / manifest.PATH).write_text(json.dumps(entries | {"checksum": manifest.checksum(entries)}))


COMMANDS = """
    info d
    head d
    stats d
    plot d --out pictures
    card d
    export d --to npz --out x.npz
    split d --by policy
    split d --list
    merge d d --out both
    validate d
    validate d --quick
    repair d
    reproduce d
    finalize d
    generate d/meta/experiment.yaml --out d
    generate d/meta/experiment.yaml --out d --overwrite
"""


@pytest.mark.parametrize("words", COMMANDS.strip().splitlines(), ids=str.strip)
def test_a_dataset_of_an_earlier_ibdata_is_refused_in_one_line(tmp_path, monkeypatch, capsys, words):
    """After an update, each command says what it found and what to do; none sends to the next one."""
    monkeypatch.chdir(tmp_path)
    as_before(made("d", steps=1, episodes=1).path)
    before = contents("d")
    monkeypatch.setattr("ibdata.cli._end_at_signals", lambda: None)  # the tests have handlers of their own
    with pytest.raises(SystemExit) as end:
        main(words.split())
    said = "".join(capsys.readouterr()).strip()
    assert end.value.code in (2, 3)
    assert said.count("\n") == 0
    assert "found version 1, expected 2; make the dataset again with this ibdata" in said
    assert contents("d") == before


def test_a_dataset_of_an_earlier_ibdata_is_listed(tmp_path):
    """`ibdata ls` shows it among the others."""
    made(tmp_path / "new")
    as_before(made(tmp_path / "old", steps=1).path)
    assert [each.state for each in datasets_in(tmp_path)] == ["finished", "unreadable"]
