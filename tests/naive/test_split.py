"""What people do with splits of a finished dataset in a normal year."""

import shutil

import numpy as np
import pytest
from helpers.folders import contents
from helpers.splits import BY_POLICY, HALVES

import ibdata
from ibdata.cli import main
from ibdata.errors import UsageError
from ibdata.tools.split_schemes import by_episode, by_policy, leave_one_out, transfer

ODD = 20.1  # which float32 cannot hold
PLAIN = {"name": "p", "setpoints": [ODD, 70], "policies": ["random", "safe"], "episodes": 4, "steps": 5}


def made(place, **changes):
    return ibdata.generate({**PLAIN, **changes}, place, workers=1, overwrite=True)


@pytest.fixture(scope="module")
def first(tmp_path_factory):
    return made(tmp_path_factory.mktemp("first") / "p").path


@pytest.fixture
def ds(first, tmp_path):
    return ibdata.open(shutil.copytree(first, tmp_path / "p"))


@pytest.fixture
def command(monkeypatch, capsys, tmp_path):
    """Run the command in the folder of the datasets: its exit code, and what it says."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ibdata.cli._end_at_signals", lambda: None)  # the tests have handlers of their own

    def run(*words):
        with pytest.raises(SystemExit) as end:
            main(["split", *words])
        return end.value.code, "".join(capsys.readouterr()).strip()

    return run


def counts(dataset):
    return {name: split["episodes"] for name, split in dataset.splits.items()}


def episodes(dataset, name):
    """The numbers of a split's episodes."""
    return [int(e) for e in np.flatnonzero(dataset.select(name).inside)]


def test_splitting_twice_is_splitting_once(ds):
    """The same files, and after the splits are removed the files of before."""
    before = contents(ds.path)
    ibdata.split(ds, transfer(ds, ODD, 70, shots=1))
    once = contents(ds.path)
    ibdata.split(ds, transfer(ds, ODD, 70, shots=1))
    assert contents(ds.path) == once != before
    ibdata.split(ds, remove=list(ds.splits))
    assert contents(ds.path) == before


def test_a_dataset_is_split_in_two_ways(ds):
    """By policy and then by episode, or the reverse: the labels of the first stay as they are."""
    ibdata.split(ds, by_policy(ds))
    policies = {name: episodes(ds, name) for name in BY_POLICY}
    ibdata.split(ds, HALVES)
    assert {name: episodes(ds, name) for name in BY_POLICY} == policies
    assert counts(ds) == dict.fromkeys((*BY_POLICY, *HALVES), 8)
    assert len(ds.table(split=["random", "train"])) == 12 * 5


def test_the_same_name_again_replaces_the_split(ds, command):
    """`train` is made larger: the command says so, and keeps nothing of the first."""
    command("p", "train.episodes=2", "test={episodes: last 25%}")
    assert episodes(ds, "train") == [0, 1, 4, 5, 8, 9, 12, 13]
    code, said = command("p", "train.episodes=3")
    assert code == 0
    assert said.startswith("replaced the split train; another name keeps both\n")
    assert counts(ds) == {"train": 12, "test": 4}
    assert "replaced" not in command("p", "train.episodes=3")[1]


def test_folds_are_made_and_all_but_one_are_trained_on(ds):
    """k folds of episodes: each is tested once, and no episode is on both sides."""
    folds = {f"fold-{i}": {"episodes": {"start": 2 * i, "stop": 2 * i + 1}} for i in range(2)}
    ibdata.split(ds, folds)
    tested = []
    for test in folds:
        train = ds.arrays(split=[fold for fold in folds if fold != test])["episode"]
        assert not set(train) & set(ds.arrays(split=test)["episode"])
        tested += episodes(ds, test)
    assert sorted(tested) == list(range(16))


def test_a_loop_splits_anew_each_time(ds):
    """The same two names for each setpoint that is left out: every time the rows of this one."""
    for setpoint in (ODD, 70):
        ibdata.split(ds, {"train": {"setpoint": {ODD, 70} - {setpoint}}, "test": {"setpoint": setpoint}})
        assert ds.select("test").episodes["setpoint"].unique() == [np.float32(setpoint)]
        assert episodes(ds, "train") == sorted({*range(16)} - {*episodes(ds, "test")})


def test_setpoints_of_the_table_of_episodes_are_split(ds):
    """`ds.episodes.setpoint` is float32: as a number, an array, a series and a list, it is the setpoint."""
    frame = ds.episodes["setpoint"]
    low, high = frame.min(), frame.unique()[1:]
    assert counts(ibdata.split(ds, transfer(ds, low, high))) == {"source": 8, "target": 8}
    for each in (low, float(low), [low], frame.unique()[:1], frame[:1], frame.unique()[:1].tolist()):
        assert counts(ibdata.split(ds, {"source": {"setpoint": each}}))["source"] == 8
    assert leave_one_out(ds)["test-20_1"] == {"setpoint": ODD, "overlap": True}


def test_splits_of_an_experiment_are_given_to_a_finished_dataset(ds):
    """What `splits:` says in YAML, `ibdata.split` says of a dataset: the same episodes."""
    plain = {"calm": {"setpoint": [ODD], "policy": "safe"}, "late": {"setpoint": 70, "episodes": "last 50%"}}
    experiment = ibdata.load({**PLAIN, "splits": plain})
    declared = made(ds.path.with_name("declared"), splits=plain)
    for splits in (plain, experiment.splits):
        assert {name: episodes(ibdata.split(ds, splits), name) for name in plain} == {
            name: episodes(declared, name) for name in plain
        }


def test_a_split_of_whole_files_stays(tmp_path):
    """A label of its name, or its removal, is refused; labels stand beside it."""
    ds = made(tmp_path / "p", splits={"train": {"episodes": 2}})
    line = "p: train is a declared split, which has files of its own and stays as it is; choose another name"
    for splits in (HALVES, {"train": None}, by_episode(ds, [0.5, 0.5])):
        with pytest.raises(UsageError, match=line):
            ibdata.split(ds, splits)
    with pytest.raises(UsageError, match=line):
        ibdata.split(ds, remove="train")
    labelled = ibdata.split(ds, {"rest": {"episodes": {"start": 2, "stop": 3}}})
    assert [split["declared"] for split in labelled.splits.values()] == [True, False]
    assert counts(labelled) == {"train": 8, "rest": 8}


def test_removing_twice_or_a_wrong_name_is_refused(ds):
    """Nothing is removed when one of the names is not there."""
    ibdata.split(ds, HALVES)
    with pytest.raises(UsageError, match="found 'tset' to be removed; did you mean 'test'"):
        ibdata.split(ds, remove=["train", "tset"])
    assert counts(ds) == {"train": 8, "test": 8}
    ibdata.split(ds, remove="test")
    with pytest.raises(UsageError, match="found 'test' to be removed, expected train"):
        ibdata.split(ds, remove="test")
    assert counts(ibdata.split(ds, {"train": None, "test": None})) == {}


def test_a_copy_in_files_has_the_splits_and_the_rows(ds, tmp_path):
    """`materialize` of labels: declared splits, one content root, and the labels stay where they were."""
    ibdata.split(ds, HALVES)
    copy = ibdata.split(ds, materialize=tmp_path / "copy")
    assert copy.content_root == ds.content_root
    assert [copy.splits[name]["declared"] for name in ("train", "test")] == [True, True]
    for name in ("train", "test"):
        assert copy.table(split=name).equals(ds.table(split=name))
    with pytest.raises(UsageError):
        ibdata.split(ds, materialize=tmp_path / "copy")


def test_a_copy_in_files_is_split_again(ds, tmp_path):
    """Labels on the copy, and a copy of these: every split of before is in it."""
    copy = ibdata.split(ds, HALVES, materialize=tmp_path / "copy")
    assert ds.splits == {}
    again = ibdata.split(copy, transfer(copy, ODD, 70, shots=3), materialize=tmp_path / "again")
    assert counts(again) == {"train": 8, "test": 8, "source": 8, "target": 6, "target-rest": 2}
    assert copy.splits.keys() == HALVES.keys()
    assert ibdata.validate(again) == []


MISTAKES = {
    "a block": (
        {"setpoint": [20, 70], "policy": "safe"},
        "splits: setpoint: found .20, 70., expected a mapping",
    ),
    "a name": ("policy", "splits: found 'policy', expected a mapping such as {'calm'"),
    "a list": (["train", "test"], "splits: found .'train', 'test'., expected a mapping such as"),
    "a list of episodes": (
        {"a": {"episodes": [0, 2]}},
        r"found '\[0, 2\]', expected a whole number, {start, stop}, or a share",
    ),
    "a key of select": (
        {"a": {"setpoints": 70}},
        "split a.setpoints: no such option; did you mean 'setpoint'?",
    ),
    "returns": (
        {"a": {"returns": (-9, 0)}},
        "split a.returns: no such option; expected one of setpoint, policy",
    ),
    "a number as a name": ({0: {"episodes": 2}}, "split 0: found 0, expected text"),
    "a capital": ({"Train": {"episodes": 2}}, "split Train: found 'Train', expected a name of a-z"),
    "every row": ({"default": {}}, "split default: found 'default', the name of the whole dataset"),
    "another setpoint": (
        {"a": {"setpoint": 75}},
        r"a.setpoint: found 75, expected one of the setpoints 20.1, 70$",
    ),
    "another policy": (
        {"a": {"policy": "expert"}},
        "split a.policy: found 'expert', expected one of random, safe",
    ),
    "too many": ({"a": {"episodes": 5}}, "split a.episodes: found episodes 0 to 4, expected some of 0 to 3"),
    "nothing": ({"a": {"setpoint": []}}, "split a.setpoint: found .., expected at least 1 item"),
    "none": ({}, "split: found nothing to do"),
    "twice": ({"a": {"setpoint": 70}, "b": {"policy": "safe"}}, "split b: shares episodes with a"),
}


@pytest.mark.parametrize(("splits", "line"), MISTAKES.values(), ids=MISTAKES)
def test_what_is_no_split_is_refused_in_one_line(ds, splits, line):
    """A block without its name, a list of episodes, a word of another call: nothing is written."""
    before = contents(ds.path)
    with pytest.raises(UsageError, match=line) as error:
        ibdata.split(ds, splits)
    assert "\n" not in str(error.value)
    assert contents(ds.path) == before


def test_a_split_that_selects_nothing_is_refused(tmp_path):
    """A share of one episode, and a policy that has no episodes at that setpoint."""
    a = made(tmp_path / "a", setpoints=[ODD], policies=["safe"], episodes=1)
    with pytest.raises(UsageError, match=r"split a.episodes: found last 50%, which is none of 1 episode"):
        ibdata.split(a, {"a": {"episodes": "last 50%"}})
    b = made(tmp_path / "b", setpoints=[70], policies=["random"])
    both = ibdata.merge([a, b], tmp_path / "both")
    with pytest.raises(UsageError, match=r"a.policy: found no episodes of this policy at this setpoint"):
        ibdata.split(both, {"a": {"setpoint": 70, "policy": "safe"}})
    assert both.splits == {}


def test_the_splits_of_another_dataset_are_no_splits(ds):
    """`ibdata.split(b, a.splits)`: these are counts, of which `episodes` would be taken for the first 8."""
    splits = ibdata.split(ds, HALVES).splits
    with pytest.raises(UsageError, match=r"split train.rows: no such option"):
        ibdata.split(ds, splits)


def test_merged_cells_of_several_sizes_are_split(tmp_path):
    """4 episodes of one dataset and 2 of another: shots are in each cell, and shares fit any size."""
    parts = [made(tmp_path / str(n), setpoints=[p], episodes=n) for p, n in ((ODD, 4), (70, 2))]
    both = ibdata.merge(parts, tmp_path / "both")
    assert counts(ibdata.split(both, transfer(both, ODD, 70, shots=1))) == {
        "source": 8, "target": 2, "target-rest": 2,
    }  # fmt: skip
    reverse = transfer(both, [70], [ODD], shots=1)
    assert counts(ibdata.split(both, reverse)) == {"source": 4, "target": 2, "target-rest": 6}
    with pytest.raises(UsageError, match=r"target.episodes: found episodes 0 to 2, expected some of 0 to 1"):
        transfer(both, ODD, 70, shots=3)
    with pytest.raises(UsageError, match=r"all.episodes: found episodes 0 to 2, expected some of 0 to 1"):
        ibdata.split(both, {"all": {"episodes": 3}})
    with pytest.raises(UsageError, match=r"cells of several sizes.* 'first 80%' fit any size"):
        by_episode(both)
    assert counts(ibdata.split(both, HALVES, remove=list(reverse))) == {"train": 6, "test": 6}
    assert ibdata.validate(both) == []


def test_a_split_is_selected_and_exported(ds, tmp_path):
    """The rows of `split=`, of `select` and of an export are the same."""
    split = ibdata.split(ds, transfer(ds, ODD, 70, shots=1))
    ibdata.export(split, "npz", tmp_path / "x.npz", split="target")
    rewards = np.load(tmp_path / "x.npz")["rewards"]
    assert rewards.tolist() == split.select("target").arrays()["rewards"].tolist()
    assert (
        rewards.tolist() == split.select(setpoint=70, episodes=[8 - 4, 16 - 4]).arrays()["rewards"].tolist()
    )
    assert split.select(["target", "target-rest"]).episodes["setpoint"].unique().tolist() == [70]


def test_a_selection_is_not_split(ds):
    """`ibdata.split(ds.select(policy="safe"), …)` would split the whole dataset."""
    chosen = ds.select(policy="safe")
    for call in (lambda: ibdata.split(chosen, BY_POLICY), lambda: by_episode(chosen)):
        with pytest.raises(UsageError, match="found a selection of its episodes, expected the whole dataset"):
            call()


def test_moving_setpoints_are_split_by_the_values_of_the_experiment(tmp_path):
    """After a burn-in, an episode's first row has another setpoint; its cell has not."""
    moving = {"setpoints": {"drifting": [ODD, 70]}, "start": {"burn_in": [20, 40]}}
    ds = made(tmp_path / "m", **moving)
    assert counts(ibdata.split(ds, transfer(ds, ODD, 70))) == {"source": 8, "target": 8}
    assert ds.select("source").episodes["index"].tolist() == [0, 1, 2, 3] * 2
    assert episodes(ds, "source") == [0, 1, 2, 3, 8, 9, 10, 11]


def test_an_opened_dataset_sees_splits_that_are_made_later(ds):
    """In a notebook, `ds` was opened before `ibdata.split` in a terminal."""
    assert ds.splits == {}
    ibdata.split(ds.path, BY_POLICY)
    assert list(ds.splits) == ["random", "safe"]
    assert ds.select("safe").to_pandas().equals(ds.select(policy="safe").to_pandas())


def test_overwriting_drops_the_labels(ds):
    """Splits belong to a dataset, not to its folder."""
    ibdata.split(ds, BY_POLICY)
    assert made(ds.path, seed=1).splits == {}


def test_a_scheme_is_changed_before_it_is_used(ds):
    """It is a mapping: other names keep two transfers, and an earlier rest is taken away."""
    few = transfer(str(ds.path), ODD, 70, shots=1)
    ibdata.split(ds, few)
    ibdata.split(ds, {f"few-{name}": split for name, split in few.items()})
    assert counts(ibdata.split(ds, transfer(ds, ODD, 70))) == {
        "source": 8, "target": 8, "few-source": 8, "few-target": 2, "few-target-rest": 6,
    }  # fmt: skip


def test_fractions_that_leave_a_split_empty_are_refused(ds):
    """80, 10 and 10 % of 4 episodes: the message names the split."""
    with pytest.raises(UsageError, match="found 4 episodes in each cell, of which test has none; expected"):
        by_episode(ds)


ARGUMENTS = {
    "p --by transfer": "transfer: found no source, expected setpoints such as source=50 target=70",
    "p --by transfer target=70 shots=1": "transfer: found no source, expected setpoints such as source=50",
    "p --by transfer source=70 sorce=20.1": "split by transfer: found 'sorce'; did you mean 'source'?",
    "p --by policy fractions=[0.5,0.5]": "split by policy: found 'fractions', expected nothing more",
    "--by transfer source=20.1 target=70 p": "found 'source=20.1' first, expected DIR before it",
    "p --by transfer source=20.1 source=70": "split source: found twice, expected once, with",
    "p source=20.1 target=70": "splits: source: found 20.1, expected a mapping such as {'setpoint': 20}",
    "p calm={setpoint: 70}": "split: found '70}', expected NAME=SPLIT, in quotes such as 'calm={",
    "p train": "split: found 'train', expected NAME=SPLIT, in quotes such as 'calm={",
    "p ../up.setpoint=70": "split: found '../up.setpoint=70', expected NAME=SPLIT",
}


@pytest.mark.parametrize(("words", "line"), ARGUMENTS.items(), ids=ARGUMENTS)
def test_words_that_the_command_does_not_expect_are_named(ds, command, words, line):
    """Out of order, missing, misspelt, unquoted: one line says how it is said, and nothing is written."""
    before = contents(ds.path)
    code, said = command(*words.split())
    assert (code, said.removeprefix("ibdata: ")[: len(line)]) == (2, line)
    assert contents(ds.path) == before


def test_words_of_the_command_stand_in_any_order(ds, command):
    """The options before DIR or after it, and the scheme's arguments in any order."""
    for words in (
        "p --by transfer source=20.1 target=70 shots=1",
        "--by transfer p shots=1 target=70 source=20.1",
        "p target=70 source=20.1 shots=1 --by transfer",
    ):
        ibdata.split(ds, {"any": {}})
        ibdata.split(ds, remove=list(ds.splits))
        assert command(*words.split())[0] == 0
        assert counts(ds) == {"source": 8, "target": 2, "target-rest": 6}
