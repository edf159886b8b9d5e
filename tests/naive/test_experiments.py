"""What people hand to ibdata in a normal year: configs of other libraries, and datasets that change."""

from __future__ import annotations

import json
import pickle
import re
import shutil
import sys
from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
import pytest
from helpers.networks import weights

import ibdata
from ibdata import errors
from ibdata.cli import main
from ibdata.errors import BusyError, ConfigError, UsageError
from ibdata.plots import plot
from ibdata.tools.card import card

PLAIN = {"name": "m", "setpoints": [20, 70], "policies": ["random", "safe"], "steps": 5}

TAKING = {  # every function that takes a dataset
    "validate": ibdata.validate,
    "reproduce": ibdata.reproduce,
    "repair": ibdata.repair,
    "card": card,
    "split": lambda ds: ibdata.split(ds, {"all": {}}),
    "merge": lambda ds: ibdata.merge([ds, ds], "merged"),
    "export": lambda ds: ibdata.export(ds, "npz", "out.npz"),
    "plot": lambda ds: plot(ds, "summary"),
    "importance": lambda ds: ibdata.importance(ds, "random"),
    "noise_floor": ibdata.noise_floor,
    "true_values": lambda ds: ibdata.true_values(ds, [0], "safe"),
    "state_at": lambda ds: ibdata.state_at(ds, [0]),
    "open": ibdata.open,
    "arrays": lambda ds: ds.arrays(),
}


@pytest.fixture(scope="module")
def replaced(tmp_path_factory):
    """A dataset that was opened and then replaced by one of another seed."""
    folder = tmp_path_factory.mktemp("replaced") / "m"
    ds = ibdata.generate(PLAIN, folder, workers=1)
    ibdata.generate(PLAIN, folder, seed=1, overwrite=True, workers=1)
    return ds


@pytest.mark.parametrize("call", TAKING.values(), ids=TAKING)
def test_a_dataset_is_replaced_while_it_is_open(replaced, tmp_path, monkeypatch, call):
    """Another run overwrites a dataset that a notebook has open: no call answers for the new one."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(BusyError, match=r"m: replaced while it was read; open it again$"):
        call(replaced)
    assert ibdata.validate(replaced.path) == []


def test_columns_and_policies_are_in_sets(replaced):
    """A set has no order of its own: its columns are sorted, in every process."""
    ds = ibdata.open(replaced.path)
    assert ds.table({"step", "act_gain", "episode"}).column_names == ["act_gain", "episode", "step"]
    assert len(ds.select(policy={"safe", "random"}, setpoint={70, 20}.intersection([20]))) == 10


class ForeignError(Exception):
    """What OmegaConf raises."""


class ForeignList(Sequence):
    """A list as OmegaConf's ListConfig is one: no `list`, and it has errors of its own."""

    def __init__(self, items):
        self._items = list(items)

    def __len__(self):
        return len(self._items)

    def __getitem__(self, index):
        if not isinstance(index, int | slice):
            raise ForeignError("ListConfig indices must be integers or slices, not str")
        if (item := self._items[index]) == "???":
            raise ForeignError("Missing mandatory value: setpoints")
        return item


class ForeignDict(Mapping):
    """A mapping as its DictConfig is one."""

    def __init__(self, items):
        self._items = {key: foreign(item) for key, item in items.items()}

    def __len__(self):
        return len(self._items)

    def __iter__(self):
        return iter(self._items)

    def __getitem__(self, key):
        return self._items[key]


def foreign(data):
    """The data as another library holds it."""
    if isinstance(data, dict):
        return ForeignDict(data)
    return ForeignList(map(foreign, data)) if isinstance(data, list) else data


MANY = {
    **PLAIN,
    "policies": [
        "random",
        {"kind": "constant", "action": [0, 0, 1]},
        {"kind": "mixture", "bases": ["safe", "bad"]},
    ],
    "start": {"burn_in": [0, 5]},
    "output": {"latent": "full"},
    "splits": {"a": {"setpoint": [20], "policy": ["random"]}},
}


def test_a_config_of_hydra_is_handed_over():
    """The whole config, and each of its lists alone, hold what plain data hold."""
    expected = ibdata.load(MANY)
    assert ibdata.load(foreign(MANY)) == ibdata.Experiment(**foreign(MANY)) == expected
    assert (
        ibdata.load(PLAIN, foreign({key: MANY[key] for key in ("policies", "start", "output", "splits")}))
        == expected
    )
    assert expected.model_copy(update={"setpoints": foreign([70, 20])}).setpoints == [70.0, 20.0]


def test_a_config_of_hydra_is_wrong():
    """A wrong value in it is one line with its place; a value that is missing there is one line, too."""
    with pytest.raises(ConfigError, match=r"^setpoints\.1: found 200, expected a number of at most 100$"):
        ibdata.load(foreign({**PLAIN, "setpoints": [20, 200]}))
    with pytest.raises(
        UsageError, match=r"^found a ForeignList that cannot be read: .*Missing mandatory value"
    ):
        ibdata.load(foreign({**PLAIN, "setpoints": ["???"]}))


def test_policies_and_setpoints_of_hydra_are_evaluated():
    """Lists of its own are lists of policies, setpoints and the columns of a view."""
    given = ["safe", {"kind": "constant", "action": [0, 0, 1]}], [20, 70]
    few = {"episodes": 2, "steps": 5}
    one, two = (ibdata.evaluate(*arguments, **few) for arguments in (given, map(foreign, given)))
    np.testing.assert_array_equal(one.returns, two.returns)
    view = {"observe": ["obs_fatigue", "obs_gain"], "reward": {"consumption": 1, "fatigue": 2}}
    one, two = (
        ibdata.evaluate(lambda seen: seen[:, [0, 1, 1]] / 100.0, view=of, **few)
        for of in (view, foreign(view))
    )
    np.testing.assert_array_equal(one.returns, two.returns)


@pytest.mark.parametrize(
    "points",
    [(20, 70), range(20, 71, 50), np.array([20, 70]), pd.Series([20, 70]), deque([20, 70]),
     {20: 1, 70: 2}.keys(), {"a": 20, "b": 70}.values(), {70, 20}, frozenset({70.0, 20})],
    ids=lambda points: type(points).__name__,
)  # fmt: skip
def test_setpoints_are_in_another_collection(points):
    """A tuple, a range, an array, a series, a view of a dict; and a set, which is sorted."""
    assert ibdata.load({**PLAIN, "setpoints": points}).setpoints == [20.0, 70.0]
    assert ibdata.load(PLAIN, {"setpoints": points}).setpoints == [20.0, 70.0]
    results = ibdata.evaluate("safe", points, episodes=2, steps=3).results
    assert [result.setpoint for result in results] == [20.0, 70.0, None]


def test_setpoints_are_in_no_collection():
    """A generator, a set of unlike things, a text, and a list that holds itself: one line each."""
    itself: list = [20]
    itself.append(itself)
    for points in (iter([20, 70]), {20, "a"}, "20, 70", itself):
        with pytest.raises(UsageError) as error:
            ibdata.load({**PLAIN, "setpoints": points})
        assert "found" in str(error.value)
        assert "\n" not in str(error.value)


def test_a_path_is_given_where_a_file_is_named(tmp_path, monkeypatch):
    """Weights are named by a `Path`, as `save_network` takes one."""
    file = tmp_path / "a.safetensors"
    file.write_bytes(weights())
    block = {"kind": "network", "file": file}
    [policy] = ibdata.load({**PLAIN, "policies": [block]}).policies
    assert policy == ibdata.load({**PLAIN, "policies": [{**block, "file": str(file)}]}).policies[0]
    assert ibdata.evaluate(block, episodes=2, steps=3).returns.shape == (1, 1, 2)


@pytest.mark.parametrize("key", ["episodes", "steps", "seed", "policies.0.history", "policies.0.draws"])
def test_a_whole_number_comes_as_a_float(key):
    """As JavaScript and spreadsheets have it, or 3e0 in YAML: 3.0 is 3, and true, 2.5 and "3" are none."""
    experiment = {**PLAIN, "policies": [{"kind": "custom", "target": "a:b"}]}
    assert (
        ibdata.load(experiment, {key: 3.0})
        == ibdata.load(experiment, {key: 3})
        == ibdata.load(experiment, [f"{key}=3e0"])
    )
    for wrong in (True, 2.5, "3", np.True_):
        with pytest.raises(ConfigError, match=rf"^override {key}: found .*, expected a whole number$"):
            ibdata.load(experiment, {key: wrong})


@pytest.mark.parametrize(("key", "wrong"), [("output.latent", 1), ("version", True), ("setpoints", True)])
def test_one_and_true_are_taken_for_each_other(key, wrong):
    """Python says that they are equal; an experiment does not."""
    with pytest.raises(ConfigError, match=rf"^override {key}: found "):
        ibdata.load(PLAIN, {key: wrong})


NESTED = """
name: x
setpoints: 70
policies:
  - kind: schedule
    stages:
      - base: safe
      - base: {kind: gaussian, base: bad, scale: 0}
  - kind: mixture
    bases:
      - safe
      - kind: safe
        name: mine
  - kind: mixture
    bases: [safe, bad]
    weights: [1, 2, 3]
  - kind: schedule
    stages:
      - steps: 5
        base: safe
      - base: safe
        epsilon: [0, 1]
"""


def test_something_deep_in_a_file_is_wrong(tmp_path):
    """Each line of the message names the line of the file on which the mistake is."""
    (tmp_path / "x.yaml").write_text(NESTED)
    with pytest.raises(ConfigError) as error:
        ibdata.load(tmp_path / "x.yaml")
    places = [problem.removeprefix(f"{tmp_path}/x.yaml:").split(": ")[:2] for problem in error.value.problems]
    assert places == [
        ["8:50", "policies.0.stages.1.base.scale"],
        ["13:15", "policies.1.bases.1.name"],
        ["16:14", "policies.2.weights"],
        ["21:9", "policies.3.stages.1.steps"],
    ]


def test_a_config_is_loaded_twice_and_changed_between():
    """Loading changes nothing that it is given, and a later change of the data changes no experiment."""
    data = json.loads(json.dumps(MANY))
    one = ibdata.load(data, {"policies.1.action.0": 1, "output.latent": False}, seed=3)
    assert data == MANY
    data["policies"][1]["action"][0] = -1
    assert one == ibdata.load(MANY, {"policies.1.action.0": 1, "output.latent": False, "seed": 3})
    assert ibdata.load(one) == ibdata.load(one.plain()) == one


def test_dynamics_are_out_of_range():
    """A field beyond its range is refused where it is written; the schema has the range, too."""
    for field, wrong, place in (
        ("eta_mean", 11, ""),
        ("drift_rate", [-101, 1], ".0"),
        ("drift_length", 0, ""),
    ):
        with pytest.raises(ConfigError, match=rf"^dynamics\.{field}{place}: found .*, expected a"):
            ibdata.load({**PLAIN, "dynamics": {"base": "siemens", field: wrong}})


NAMED = {  # what is wrong, in the words of Python and of the command line
    "a set of other settings": (
        lambda: ibdata.evaluate("safe", 50, against="optimized-40"),
        ["evaluate", "safe", "--setpoint", "50", "--against", "optimized-40"],
        "{setpoint}: found 50, expected 70: {against} optimized-40 compares with",
    ),
    "no such number": (
        lambda: ibdata.reproduce("m", 0),
        ["reproduce", "m", "--episodes", "0"],
        "{episodes}: found 0, expected a whole number of at least 1",
    ),
    "code of a file": (
        lambda: ibdata.evaluate("p.yaml"),
        ["evaluate", "p.yaml"],
        "policy custom: found the custom policy a:b of a file, which is code that would run; "
        "{allow_code=True|--allow-code} if you trust it",
    ),
    "a card of one's own": (
        lambda: card("m"),
        ["card", "m"],
        "m/README.md: found other text than ibdata writes now; {overwrite=True|--overwrite} to replace it",
    ),
}


@pytest.mark.parametrize(("call", "args", "line"), NAMED.values(), ids=NAMED)
def test_a_message_names_an_argument(replaced, tmp_path, monkeypatch, capsys, call, args, line):
    """A notebook is told of keyword arguments, a shell of options; what a user has written stays as it is."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "matplotlib", None)  # the pictures of a card take seconds
    shutil.copytree(replaced.path, "m")
    (tmp_path / "m/README.md").write_text("\ufdd0mine --overwrite=")
    (tmp_path / "p.yaml").write_text("{kind: custom, target: 'a:b'}")
    with pytest.raises(ibdata.IbdataError) as error:
        call()
    in_python, in_shell = (re.sub(r"\{([^}|]*)(\|[^}]*)?\}", which, line) for which in (r"\1", shell))
    assert str(error.value).startswith(in_python)
    of_a_worker = pickle.loads(pickle.dumps(error.value))
    assert str(of_a_worker) == str(error.value)
    with monkeypatch.context() as shown:
        shown.setattr(errors, "at_command_line", True)
        assert str(of_a_worker).startswith(in_shell)
    with pytest.raises(SystemExit):
        main(args)
    assert capsys.readouterr().err.splitlines()[-1].removeprefix("ibdata: ").startswith(in_shell)
    with pytest.raises(ibdata.IbdataError, match=re.escape(in_python)):
        call()


def shell(word):
    """The words of the command line, which differ from Python's or are an option of the same name."""
    return word[2][1:] if word[2] else f"--{word[1]}"


def test_names_of_a_user_look_like_options(tmp_path, capsys):
    """A folder named --out and a split named overwrite= are named as they are, here and there."""
    for call in (lambda: ibdata.open("--out"), lambda: main(["info", "--", "--out"])):
        try:
            call()
        except (ibdata.IbdataError, SystemExit) as error:
            said = str(error) if isinstance(error, ibdata.IbdataError) else capsys.readouterr().err
        assert "--out" in said
