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
from helpers.refusals import refused

import ibdata
from ibdata._numerics.arguments import public
from ibdata.environment.settings import settings
from ibdata.errors import UsageError
from ibdata.plots import plot
from ibdata.testing import check_policy
from ibdata.tools.card import card
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


def refusal(call: Callable[[], Any]) -> str:
    with pytest.raises(UsageError) as caught:
        call()
    assert isinstance(caught.value, ValueError)  # or a TypeError, too
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_an_unknown_or_misspelt_option_is_one_line():
    for name, function in FUNCTIONS.items():
        said = refusal(lambda function=function: function(zzzzz=1))
        assert said.startswith(f"zzzzz: {UNKNOWN.get(name, 'no such option').format('zzzzz')}; expected ")
        for option in inspect.signature(function).parameters:
            if option != "self" and len(option) > 2:
                said = refusal(lambda f=function, option=option: f(**{f"{option}z": 1}))
                unknown = UNKNOWN.get(name, "no such option").format(f"{option}z")
                assert said == f"{option}z: {unknown}; did you mean {option!r}?"


def test_other_types_are_refused_by_name():
    """Numbers are no texts, no booleans and not None; texts and booleans are no numbers."""
    for function in FUNCTIONS.values():
        for option, parameter in inspect.signature(function).parameters.items():
            annotation, wrong = str(parameter.annotation), []
            if re.search(NUMBER, annotation):
                wrong = [np.True_, object()]
                wrong += [] if "str" in annotation else ["x"]
            elif annotation.startswith(("bool", "str", "Split")):
                wrong = [np.int64(1)]
            for value in wrong:
                said = refusal(lambda f=function, option=option, value=value: f(**{option: value}))
                assert re.match(rf"{option}: found .*, expected (an? |True or False)", said)


MEANT = [
    (lambda ds: ibdata.generate("random", episodes=3), "did you mean overrides={'episodes': 3}?"),
    (lambda ds: ibdata.generate("random", shard_rows=9), "overrides={'output.shard_rows': 9}?"),
    (lambda ds: ibdata.generate("random", setpoint=9), "did you mean overrides={'setpoints': 9}?"),
    (lambda ds: ds.arrays(view={"obsreve": "markov"}), "obsreve: no such option; did you mean 'observe'?"),
    (lambda ds: ibdata.merge("a", "out"), "folders: found 'a', expected a list of texts or paths"),
    (lambda ds: ibdata.score_model(ds, 5), "model: found 5, expected a function"),
    (lambda ds: ds.arrays(view="markov"), "view: found 'markov', expected a mapping such as {'observe'"),
    (lambda ds: ibdata.evaluate(len, history={"len": 1.5}), "history: len: found 1.5, expected a whole"),
    (lambda ds: ds.stored.rows(-1), "number: found -1, expected a shard from 0 to 0"),
    (lambda ds: check_policy(len, history=0), "history: found 0, expected a whole number of at least 1"),
]


def test_a_mistake_is_one_line_that_says_what_is_meant(tmp_path):
    dataset = ibdata.generate(EXPERIMENT, tmp_path / "x", workers=1)
    for call, meant in MEANT:
        assert meant in refusal(lambda call=call: call(dataset))


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


NAMES = list(inspect.signature(taking).parameters)
ARRAY, NUMBER_64 = np.ones(2), np.int64(3)
TAKEN = [  # given, and what the function gets: a value of Python, or what says no type as it is
    ("whole", np.array(2**63, dtype=np.uint64), 2**63),
    ("whole", 1e3, 1000),
    ("real", Fraction(1, 2), Fraction(1, 2)),
    ("real", np.float32(0.5), 0.5),
    ("several", (np.int8(1), None), [1, None]),
    ("several", iter([1]), [1]),
    ("several", pd.Series([3, 4]), [3, 4]),
    ("several", [1.0, 2], [1, 2]),
    ("several", [1.0, 2.0], [1, 2]),
    ("reals", [1, Fraction(1, 2)], [1, 0.5]),
    ("reals", np.array([0.5, 2], dtype=np.float16), [0.5, 2.0]),
    ("texts", pd.Index(["a"]), ["a"]),
    ("mapping", {"a": np.float64(2)}, {"a": 2.0}),
    ("array", ARRAY, ARRAY),
    ("anything", NUMBER_64, NUMBER_64),
    ("letter", b"a", b"a"),
]
WRONG = [
    ("whole", 1.5, "found 1.5, expected a whole number"),
    ("whole", float("nan"), "found nan, expected a whole number"),
    ("whole", np.array([1]), "found [1], expected a whole number"),
    ("real", "0.5", "found '0.5', expected a number or None"),
    ("several", "12", "found '12', expected a list of whole numbers"),
    ("several", [1, True], "found [1, True], expected a list of whole numbers"),
    ("several", [1.0, 1.5], "found [1.0, 1.5], expected a list of whole numbers"),
    ("reals", [0.5, None], "found [0.5, None], expected a list of numbers"),
    ("texts", 5, "found 5, expected a word or words"),
    ("numbers", "70", "found '70', expected a whole number or an array"),
    ("path", b"x", "found b'x', expected a text or a path"),
    ("mapping", {"a": "b"}, "a: found 'b', expected a number"),
    ("mapping", [1], "found [1], expected a mapping or None"),
]


def test_a_value_becomes_one_of_python():
    for name, given, expected in TAKEN:
        found = taking(**{name: given})[NAMES.index(name)]
        assert (type(found), found is expected or found == expected) == (type(expected), True), name


def test_another_type_is_one_line_by_name_and_by_place():
    for name, given, message in WRONG:
        before = taking()[: NAMES.index(name)]
        for call in (lambda n=name, x=given: taking(**{n: x}), lambda b=before, x=given: taking(*b, x)):
            assert refusal(call) == f"{name}: {message}"
            with pytest.raises(TypeError):
                call()


@pytest.mark.parametrize("kind", [list, np.array, lambda x: np.array(x, dtype=np.float64)])
def test_many_numbers_take_no_call_for_each(kind):
    """Calls are counted, because times depend on the machine: some for the list, and none for an item."""
    numbers, calls = kind(range(100_000)), Counter()
    sys.setprofile(lambda frame, event, value: calls.update([event]))
    try:
        found = taking(several=numbers)[2]
    finally:
        sys.setprofile(None)
    assert (len(found), found[-1], type(found[-1])) == (100_000, 99_999, int)
    assert calls["call"] < 1000


def test_an_argument_that_is_missing_or_has_no_name_is_refused_with_all_names(tmp_path):
    """Python's own error does not say which may go without a name."""
    form = r"expected merge\(folders, out\)$"
    with pytest.raises(TypeError, match=f"^merge: missing a required argument: 'out'; {form}"):
        ibdata.merge([])
    line = r"^export: too many positional arguments; expected export\(dataset, to, out, split=…, history=…, "
    refused(line, ibdata.export, "data/x", "npz", "x.npz", "train")
