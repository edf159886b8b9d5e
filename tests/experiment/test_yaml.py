"""Strict YAML: plain data with their places in the file, and one kind of error for everything else."""

from __future__ import annotations

import json
import math

import pytest
from helpers import tries
from hypothesis import given
from hypothesis import strategies as st

from ibdata.experiment.yaml import Document, StrictYamlError, scalar

ANCHOR = "found an anchor or alias, expected plain data"
MERGE = "found a merge key, expected plain data"
KEY = "found a list or mapping as a key, expected text"
LEVELS = "found more than 20 levels, expected at most 20"
TAB = "not valid YAML: found character '\\t' that cannot start any token"
DOCUMENT = "found a second document, expected a single document; remove what follows ---"

REFUSED = {
    "an anchor": ("a: &x 1", "1:4", ANCHOR),
    "an alias": ("a: 1\nb: *x", "2:4", ANCHOR),
    "a merge key": ("a:\n  <<: {b: 1}", "2:3", MERGE),
    "a tag": ("a: !foo 3", "1:4", "found the tag !foo, expected plain data"),
    "the tag of a type": ("a: !!int 3", "1:4", "found the tag tag:yaml.org,2002:int, expected plain data"),
    "the tag of a Python object": (
        "!!python/object:os.system x",
        "1:1",
        "found the tag tag:yaml.org,2002:python/object:os.system, expected plain data",
    ),
    "a key twice": ("a: 1\nb: 2\na: 3", "3:1", "a: found twice, expected once"),
    "a key twice inside": ("a:\n  b: {c: 1, c: 1}", "2:13", "c: found twice, expected once"),
    "a key twice, once quoted": ("1: 1\n'1': 2", "2:1", "1: found twice, expected once"),
    "a second document": ("a: 1\n---\nb: 2", "2:1", DOCUMENT),
    "a list as a key": ("[1]: 2", "1:1", KEY),
    "a mapping as a key": ("a:\n  {b: 1}: 2", "2:3", KEY),
    "21 levels": ("[" * 21 + "]" * 21, "1:21", LEVELS),
    "a tab after a key": ("a: 1\nb:\t2", "2:3", TAB),
    "a bracket left open": ("a: [1, 2", "1:9", "not valid YAML: expected ',' or ']', but got '<stream end>'"),
    "two colons": ("a: b: c", "1:5", "not valid YAML: mapping values are not allowed here"),
    "a control character": ("a: 1\nb: x\x7f", "2:1", "not valid YAML: unacceptable character"),
    "no UTF-8": (b"a: 1\nb: \xe9\n", "2:1", "found bytes that are not UTF-8, expected UTF-8 text"),
    "UTF-16": ("a: 1".encode("utf-16"), "1:1", "found bytes that are not UTF-8, expected UTF-8 text"),
}  # fmt: skip


def error_of(text):
    with pytest.raises(StrictYamlError) as caught:
        Document(text)
    assert str(caught.value) == f"{caught.value.line}:{caught.value.column}: {caught.value.message}"
    return caught.value


@pytest.mark.parametrize(("text", "place", "message"), REFUSED.values(), ids=REFUSED)
def test_what_is_not_plain_data_is_refused_with_its_place(text, place, message):
    for form in (text, text if isinstance(text, bytes) else text.encode()):
        assert str(error_of(form)).startswith(f"{place}: {message}")


@pytest.mark.parametrize(
    ("text", "data"),
    [
        *((f"a: 1{end}b: 2{end}".encode(), {"a": 1, "b": 2}) for end in ("\n", "\r\n", "\r")),
        (b"\xef\xbb\xbfa: 1\n", {"a": 1}),  # a byte order mark
        *((f"{start}\na: on", {"a": "on"}) for start in ("%YAML 1.1\n---", "%YAML 1.2\n---", "---")),
        ("---\na: on\n...\n", {"a": "on"}),
        ("1: a\ntrue: b\n'<<': d\n1e3: e", {"1": "a", "true": "b", "<<": "d", "1e3": "e"}),
    ],
)
def test_plain_data_are_read_whatever_their_form(text, data):
    assert Document(text).data == data


def test_keys_and_values_have_their_places_from_1():
    document = Document('a: 1\nb:\n  - x\n  - {c: "y", d: [2, 3]}\n"e f": |\n  text\n')
    assert document.data == {"a": 1, "b": ["x", {"c": "y", "d": [2, 3]}], "e f": "text\n"}
    assert document.values == {
        (): (1, 1),
        ("a",): (1, 4),
        ("b",): (3, 3),
        ("b", 0): (3, 5),
        ("b", 1): (4, 5),
        ("b", 1, "c"): (4, 9),
        ("b", 1, "d"): (4, 17),
        ("b", 1, "d", 0): (4, 18),
        ("b", 1, "d", 1): (4, 21),
        ("e f",): (5, 8),
    }
    assert document.keys == {
        ("a",): (1, 1),
        ("b",): (2, 1),
        ("b", 1, "c"): (4, 6),
        ("b", 1, "d"): (4, 14),
        ("e f",): (5, 1),
    }


SCALARS = {
    # what PyYAML or YAML 1.1 takes for something else
    "1e-1": 0.1, "1e3": 1000.0, "on": "on", "NO": "NO", "no": "no", "yes": "yes", "off": "off", "y": "y",
    "12:30": "12:30", "1:30": "1:30", "010": 10, "0123": 123, "1_000": "1_000", "2001-99-99": "2001-99-99",
    "0x10": "0x10", "0o17": "0o17", "0b1": "0b1",
    ".nan": ".nan", ".NaN": ".NaN", ".inf": ".inf", "-.inf": "-.inf",
    "nan": "nan", "inf": "inf", "True": "True", "TRUE": "TRUE", "Null": "Null", "١٢": "١٢", "²": "²",
    # words and numbers
    "true": True, "false": False, "null": None, "~": None, "": None,
    "0": 0, "-0": 0, "+5": 5, "-17": -17, "18446744073709551616": 2**64,
    "0.5": 0.5, ".5": 0.5, "5.": 5.0, "-1.5E+2": -150.0, "1e400": math.inf, "1.e3": 1000.0,
    ".": ".", "+": "+", "1e": "1e", "e3": "e3", "1.2.3": "1.2.3", "--1": "--1", "1 2": "1 2",
}  # fmt: skip


@pytest.mark.parametrize(("text", "value"), SCALARS.items(), ids=[repr(x) for x in SCALARS])
def test_a_scalar_is_a_json_number_a_word_or_text(text, value):
    """And quoted it is text."""
    for found in (scalar(text), Document(f"a: {text}").data["a"]):
        assert (type(found), found) == (type(value), value)
    assert Document(f"a: '{text}'\nb: \"{text}\"").data == {"a": text, "b": text}


def plain(value):
    if isinstance(value, dict):
        return all(type(key) is str and plain(child) for key, child in value.items())
    if isinstance(value, list):
        return all(map(plain, value))
    return value is None or type(value) in (bool, int, float, str)


yaml_like = st.text(alphabet="ab01.-+e:,[]{}\"'#&*!|>?%@`~<\\ \n\t\r\0\ufeff\x85é", max_size=40)


@tries(400)
@given(st.one_of(yaml_like, st.text(max_size=60), st.binary(max_size=40)))
def test_any_text_gives_plain_data_or_the_one_error(text):
    try:
        found = Document(text).data
    except StrictYamlError as error:
        found = [error.line, error.column, error.message]
    assert plain(found)


words = st.text(st.characters(exclude_categories=["C", "Zl", "Zp"]), max_size=10)
numbers = st.one_of(st.integers(), st.floats(allow_nan=False, allow_infinity=False))


@tries(400)
@given(
    st.recursive(
        st.one_of(st.none(), st.booleans(), numbers, words),
        lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(words, inner, max_size=4)),
        max_leaves=10,
    )
)
def test_json_is_read_as_what_it_says(value):
    assert repr(Document(json.dumps(value, ensure_ascii=False)).data) == repr(value)
