"""One door for the arguments of public functions: numbers of numpy, unknown names, other types."""

from __future__ import annotations

import inspect
import os
import re
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Annotated, Any, Literal

import numpy as np
import numpy.typing as npt
import pandas as pd
import pytest

import ibdata
from ibdata.arguments import public
from ibdata.environment.settings import settings
from ibdata.errors import UsageError
from ibdata.maintenance.card import card
from ibdata.plots import plot
from ibdata.testing import check_policy
from ibdata.views.options import view_options

DATASET = {
    f"Dataset.{name}": method
    for name, method in inspect.getmembers(ibdata.Dataset, inspect.isfunction)
    if not name.startswith("_") or name == "__init__"
}
FUNCTIONS = {
    **{name: getattr(ibdata, name) for name in dir(ibdata) if inspect.isfunction(getattr(ibdata, name))},
    **DATASET,
    **{each.__name__: each for each in (settings, check_policy, plot, card, view_options)},
}
UNKNOWN = {"settings": "got an unexpected keyword argument {!r}"}  # in Python's words
NUMBER = r"\b(int|float|Setpoint)\b"
EXPERIMENT = {"name": "x", "setpoints": [20, 70], "policies": ["random", "safe"], "steps": 6, "episodes": 4}


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    return ibdata.generate(EXPERIMENT, tmp_path_factory.mktemp("arguments") / "x", workers=1)


def refusal(call: Callable[[], Any]) -> str:
    with pytest.raises(UsageError) as caught:
        call()
    assert isinstance(caught.value, ValueError)  # or a TypeError, too
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("name", FUNCTIONS)
def test_an_unknown_option_is_one_line(name):
    said = refusal(lambda: FUNCTIONS[name](zzzzz=1))
    assert said.startswith(f"zzzzz: {UNKNOWN.get(name, 'no such option').format('zzzzz')}; expected ")


@pytest.mark.parametrize("name", FUNCTIONS)
def test_a_misspelt_option_is_recognised(name):
    for option in inspect.signature(FUNCTIONS[name]).parameters:
        if option != "self" and len(option) > 2:
            said = refusal(lambda option=option: FUNCTIONS[name](**{f"{option}z": 1}))
            unknown = UNKNOWN.get(name, "no such option").format(f"{option}z")
            assert said == f"{option}z: {unknown}; did you mean {option!r}?"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_other_types_are_refused_by_name(name):
    """Numbers are no texts, no booleans and not None; texts and booleans are no numbers."""
    for option, parameter in inspect.signature(FUNCTIONS[name]).parameters.items():
        annotation, wrong = str(parameter.annotation), []
        if re.search(NUMBER, annotation):
            wrong = [True, np.True_, object()]
            wrong += [] if re.search("None|Setpoint", annotation) else [None]
            wrong += [] if "str" in annotation else ["x"]
        elif annotation.startswith(("bool", "str", "Split")):
            wrong = [5, np.int64(1), *([] if re.match("Split|.*Sequence", annotation) else [["x"]])]
        for value in wrong:
            said = refusal(lambda option=option, value=value: FUNCTIONS[name](**{option: value}))
            assert re.match(rf"{option}: found .*, expected (an? |True or False)", said)


MEANT = [
    (
        lambda ds, out: ibdata.generate("random", episodes=3),
        "episodes",
        "did you mean overrides={'episodes': 3}?",
    ),
    (
        lambda ds, out: ibdata.generate("random", shard_rows=9),
        "shard_rows",
        "overrides={'output.shard_rows': 9}?",
    ),
    (
        lambda ds, out: ibdata.generate("random", setpoint=9),
        "setpoint",
        "did you mean overrides={'setpoints': 9}?",
    ),
    (lambda ds, out: ibdata.evaluate("safe", setpoints=70), "setpoints", "did you mean 'setpoint'?"),
    (lambda ds, out: settings(setpoints=70), "setpoints", "did you mean 'setpoint'?"),
    (lambda ds, out: ds.arrays(view={"obsreve": "markov"}), "obsreve", "did you mean 'observe'?"),
    (lambda ds, out: ibdata.split(ds, shots=True), "shots", "found True, expected a whole number or None"),
    (
        lambda ds, out: ibdata.split(ds, "episode", fractions="0.5,0.5"),
        "fractions",
        "found '0.5,0.5', expected a list of numbers",
    ),
    (
        lambda ds, out: ibdata.split(ds, "setpoint", source=[20, "70"]),
        "source",
        "found [20, '70'], expected a number or a list",
    ),
    (lambda ds, out: ibdata.export(ds, "minari", out, id=5), "id", "found 5, expected a text or None"),
    (lambda ds, out: ibdata.export(ds, "npz", 5), "out", "found 5, expected a text or a path"),
    (lambda ds, out: ibdata.open(5), "path", "found 5, expected a text or a path"),
    (lambda ds, out: ibdata.quality(5), "ds", "found 5, expected a Dataset, a text or a path"),
    (lambda ds, out: ibdata.merge("a", out), "folders", "found 'a', expected a list of texts or paths"),
    (lambda ds, out: ibdata.score_model(ds, 5), "model", "found 5, expected a function"),
    (
        lambda ds, out: ds.arrays(view="markov"),
        "view",
        "found 'markov', expected a mapping such as {'observe'",
    ),
    (
        lambda ds, out: ibdata.evaluate(len, history={"len": 1.5}),
        "history: len",
        "found 1.5, expected a whole",
    ),
    (lambda ds, out: ds.stored.rows(-1), "number", "found -1, expected a shard from 0 to 0"),
    (
        lambda ds, out: check_policy(len, history=0),
        "history",
        "found 0, expected a whole number of at least 1",
    ),
]


@pytest.mark.parametrize(("call", "option", "meant"), MEANT, ids=[row[1] for row in MEANT])
def test_a_mistake_is_one_line_that_says_what_is_meant(dataset, tmp_path, call, option, meant):
    said = refusal(lambda: call(dataset, tmp_path / "out"))
    assert said.startswith(f"{option}: ")
    assert meant in said


def zero(observations):
    return np.zeros((len(observations), 3))


def fatigue_and_consumption(observations, actions):
    return observations[:, 4:6]


def made(number, out):
    found = ibdata.generate(EXPERIMENT, out, seed=number(2), workers=number(1))
    return found.content_root, found.manifest["experiments"][0]["seed"]


# Each takes `number`, which makes a Python number one of numpy, a dataset and a new folder.
NUMBERS = {
    "generate": lambda number, ds, out: made(number, out),
    "load": lambda number, ds, out: ibdata.load(EXPERIMENT, seed=number(3)),
    "estimate": lambda number, ds, out: ibdata.estimate(EXPERIMENT, out, seed=number(2))["rows"],
    "evaluate": lambda number, ds, out: (
        ibdata.evaluate(
            zero,
            number(70),
            steps=number(3),
            discount=number(0.5),
            episodes=number(2),
            seed=number(4),
            history=number(2),
            start={"burn_in": [number(1), number(2)]},
        ).returns
    ),
    "evaluate, setpoints": lambda number, ds, out: (
        ibdata.evaluate("safe", number([20, 70]), steps=2, episodes=2).returns
    ),
    "importance": lambda number, ds, out: (
        ibdata.importance(
            ds,
            "random",
            discount=number(0.5),
            steps=number(3),
            setpoint=number(70),
            policy="random",
            history=number(1),
        ).weights
    ),
    "noise_floor": lambda number, ds, out: ibdata.noise_floor(ds, setpoint=number(70)).mean,
    "quality": lambda number, ds, out: ibdata.quality(ds, setpoint=number([20, 70])).plain(),
    "true_values": lambda number, ds, out: (
        ibdata.true_values(
            ds,
            (number(1), number(2)),
            zero,
            number([[0.5, 0, 0]]),
            steps=number(3),
            discount=number(0.5),
            episodes=number(2),
            seed=number(4),
            history=number(2),
        ).returns
    ),
    "state_at": lambda number, ds, out: ibdata.state_at(ds, number([1, 2, 3])).fatigue,
    "score_model": lambda number, ds, out: (
        ibdata.score_model(
            ds, fatigue_and_consumption, steps=number([1, 2]), history=number(2), setpoint=number(70)
        ).results
    ),
    "reproduce": lambda number, ds, out: ibdata.reproduce(ds, number(2)),
    "repair": lambda number, ds, out: ibdata.repair(ds, number(1)),
    "export": lambda number, ds, out: ibdata.export(ds, "npz", out, history=number(2)).history,
    "split, shots": lambda number, ds, out: (
        ibdata.split(ds, "setpoint", source=number([20]), target=number(70), shots=number(2)).splits
    ),
    "split, transitions": lambda number, ds, out: (
        ibdata.split(ds, "setpoint", source=number(20), target=number(70), transitions=number(12)).splits
    ),
    "split, fractions": lambda number, ds, out: (
        ibdata.split(ds, "episode", fractions=number([0.5, 0.5])).splits
    ),
    "head": lambda number, ds, out: ds.head(number(2), at=(number(1), number(2))),
    "head, at": lambda number, ds, out: ds.head(at=number([1, 2])),
    "iter_batches": lambda number, ds, out: [len(x) for x in ds.iter_batches(batch_rows=number(7))],
    "table": lambda number, ds, out: ds.table(setpoint=number([70])),
    "arrays": lambda number, ds, out: ds.arrays(number(3), setpoint=number(70))["observations"],
    "windows": lambda number, ds, out: ds.windows(number(3))[5],
    "select": lambda number, ds, out: ds.select(setpoint=number([20, 70])).inside,
    "settings": lambda number, ds, out: settings(
        number(70), history=number(2), start={"burn_in": number([1, 2])}
    ),
    "view": lambda number, ds, out: ds.arrays(
        view={
            "reward": {"fatigue": number(2)},
            "reward_scale": number(0.5),
            "imperfections": {
                "delay": {"obs_gain": number(2)},
                "noise": {"obs_gain": number(0.5)},
                "mask": number(True),
                "seed": number(3),
            },
        }
    ),
    "check_policy": lambda number, ds, out: check_policy(zero, history=number(2)),
}


def scalar(value):
    """Numbers of numpy, also in a list."""
    return [scalar(each) for each in value] if isinstance(value, list) else np.asarray(value)[()]


@pytest.mark.parametrize("kind", [scalar, np.array], ids=["scalar", "array"])
@pytest.mark.parametrize("name", NUMBERS)
def test_numbers_of_numpy_are_those_of_python(dataset, tmp_path, name, kind):
    found, expected = (
        NUMBERS[name](number, dataset, tmp_path / folder)
        for number, folder in ((kind, "a"), (lambda x: x, "b"))
    )
    np.testing.assert_equal(found, expected)


def test_the_signatures_and_help_are_those_of_the_functions():
    for name, function in FUNCTIONS.items():
        assert function.__wrapped__.__name__ == function.__name__ == name.rpartition(".")[2]
        assert function.__doc__ == function.__wrapped__.__doc__
    assert list(inspect.signature(ibdata.load).parameters) == ["config", "overrides", "seed"]


@public
def taking(
    whole: int = 0,
    real: float | None = None,
    several: Sequence[int | None] = (),
    texts: Annotated[str | Sequence[str], "a word or words"] = "",
    path: str | os.PathLike[str] = "",
    mapping: Mapping[str, float] | None = None,
    array: npt.ArrayLike | None = None,
    anything: Any = None,
    reals: Sequence[float] = (),
    numbers: int | npt.NDArray[Any] = 0,
    letter: Literal["a"] | int = "a",
) -> tuple[Any, ...]:
    """A function with each kind of annotation."""
    return (whole, real, several, texts, path, mapping, array, anything, reals, numbers, letter)


GIVEN = [
    ("whole", np.uint8(255), 255),
    ("whole", 1e3, 1000),
    ("whole", np.array(2**63, dtype=np.uint64), 2**63),
    ("real", Fraction(1, 2), 0.5),
    ("real", np.float32(0.5), 0.5),
    ("real", None, None),
    ("several", np.arange(2), [0, 1]),
    ("several", (np.int8(1), None), [1, None]),
    ("several", range(2), [0, 1]),
    ("several", iter([1]), [1]),
    ("several", pd.Series([3, 4]), [3, 4]),
    ("several", np.array([]), []),
    ("several", [1.0, 2], [1, 2]),
    ("reals", [1, Fraction(1, 2)], [1, 0.5]),
    ("reals", np.array([0.5, 2], dtype=np.float16), [0.5, 2.0]),
    ("texts", np.array(["a", "b"]), ["a", "b"]),
    ("texts", pd.Index(["a"]), ["a"]),
    ("mapping", {"a": np.float64(2)}, {"a": 2.0}),
]


@pytest.mark.parametrize(("name", "given", "expected"), GIVEN, ids=[row[0] for row in GIVEN])
def test_values_become_those_of_python(name, given, expected):
    found = taking(**{name: given})[list(inspect.signature(taking).parameters).index(name)]
    assert found == expected
    assert isinstance(found, list | dict | float | int | Fraction | None)


WRONG = [
    ("whole", 1.5, "whole: found 1.5, expected a whole number"),
    ("whole", float("nan"), "whole: found nan, expected a whole number"),
    ("whole", np.array([1]), "whole: found [1], expected a whole number"),
    ("real", "0.5", "real: found '0.5', expected a number or None"),
    ("several", "12", "several: found '12', expected a list of whole numbers"),
    ("several", [1, True], "several: found [1, True], expected a list of whole numbers"),
    ("several", [1.0, 1.5], "several: found [1.0, 1.5], expected a list of whole numbers"),
    ("reals", [0.5, True], "reals: found [0.5, True], expected a list of numbers"),
    ("reals", [0.5, None], "reals: found [0.5, None], expected a list of numbers"),
    ("texts", 5, "texts: found 5, expected a word or words"),
    ("numbers", "70", "numbers: found '70', expected a whole number or an array"),
    ("path", b"x", "path: found b'x', expected a text or a path"),
    ("mapping", {"a": "b"}, "mapping: a: found 'b', expected a number"),
    ("mapping", [1], "mapping: found [1], expected a mapping or None"),
]


@pytest.mark.parametrize(("name", "given", "message"), WRONG, ids=[row[0] for row in WRONG])
def test_other_types_are_one_line(name, given, message):
    assert refusal(lambda: taking(**{name: given})) == message
    names = list(inspect.signature(taking).parameters)
    before = taking()[: names.index(name)]
    assert refusal(lambda: taking(*before, given)) == message
    with pytest.raises(TypeError):
        taking(**{name: given})


def test_what_says_no_type_stays_as_it_is():
    array, anything, letter = np.ones(2), np.int64(3), b"a"
    found = taking(array=array, anything=anything, letter=letter)
    assert found[6] is array
    assert found[7] is anything
    assert found[10] is letter


@pytest.mark.parametrize("kind", [list, np.array, lambda x: np.array(x, dtype=np.float64)])
def test_a_million_numbers_take_no_call_for_each(kind):
    """Calls are counted, because times depend on the machine: some for the list, and none for an item."""
    numbers, calls = kind(range(1_000_000)), Counter()
    sys.setprofile(lambda frame, event, value: calls.update([event]))
    try:
        found = taking(several=numbers)[2]
    finally:
        sys.setprofile(None)
    assert (len(found), found[-1], type(found[-1])) == (1_000_000, 999_999, int)
    assert calls["call"] < 1000


def test_a_missing_argument_is_python_s_own_error():
    with pytest.raises(TypeError, match="missing 1 required positional argument: 'config'"):
        ibdata.generate()
