"""JSON files with one wrong value but correct hashes give an answer or an error, never a traceback."""

from __future__ import annotations

import copy
import hashlib
import json
import random
import re
import shutil
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from ibdata.cli import main
from ibdata.dataset import manifest
from ibdata.dataset.models import SAFE_PATH
from ibdata.system.signals import STOPPING

pytestmark = pytest.mark.corpus

FILES = (manifest.PATH, "meta/dataset.json", "meta/statistics.json")
PARTS, OF_A_PART = 6, 50
HUGE = "a number that JSON has and no float holds"
NUMBERS = [0, -1, 1, 7, 2**31, 2**63 - 1, 2**63, 2**64, 10**400, -0.0, 1.5, 1e308, HUGE, 50.0]
WORDS = [
    "",
    "x",
    "random",
    "low",
    "policy",
    "reward",
    "string",
    "float64",
    "0.5",
    "../x",
    "meta/dataset.json",
]
ODD = [
    "\ud800",
    "\x1b[31mred",
    "a\u202eb",
    "two\nlines",
    "\x9b",
    "x" * 5000,
    "0" * 64,
    "data/part-00001.parquet",
]
PARTS_OF_JSON = [
    [],
    {},
    [[]],
    [0],
    [0, 0],
    [1, 2],
    ["x"],
    {"x": 1},
    {"\x1b]0;x\x07": "\ud800"},
    {"kind": "random"},
]
VALUES: list[Any] = [None, True, False, *NUMBERS, *WORDS, *ODD, *PARTS_OF_JSON]
KEYS = ("x", "zz", "\x1b[2J", "a\u202e")
READING = [
    "info d",
    "info d --json",
    "head d",
    "stats d",
    "stats d --split low",
    "validate d",
    "diff d other",
]
WRITING = ["split d --by policy", "split d --materialize parts", "merge d other --out both", "reproduce d"]
WRITING += ["repair d --workers 1", "export d --to npz --out x.npz", "card d"]
RAW = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u200b-\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]")


def places(data: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """The keys that lead to every value but the whole."""
    for key in data if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else ():
        yield (*at, key)
        yield from places(data[key], (*at, key))


def at(data: Any, place: tuple[Any, ...]) -> Any:
    for key in place:
        data = data[key]
    return data


def one_place(every: list[tuple[Any, ...]], chance: random.Random) -> tuple[Any, ...]:
    """A place; those that differ in their numbers count as one, or columns would outweigh all others."""
    kinds: dict[str, list[tuple[Any, ...]]] = {}
    for place in every:
        kinds.setdefault(str(["#" if isinstance(key, int) else key for key in place]), []).append(place)
    return chance.choice(kinds[chance.choice(sorted(kinds))])


def mutated(data: Any, chance: random.Random) -> tuple[Any, str]:
    """The data with one change, and what it is."""
    data = copy.deepcopy(data)
    every = list(places(data))
    place = one_place(every, chance)
    part, last = at(data, place[:-1]), place[-1]
    kind = chance.choice(["put", "put", "put", "put", "remove", "copy", "more"])
    if kind == "put":
        part[last] = copy.deepcopy(chance.choice(VALUES))
    elif kind == "remove":
        del part[last]
    elif kind == "copy":
        part[last] = copy.deepcopy(at(data, one_place(every, chance)))
    elif isinstance(part, list):
        part.append(copy.deepcopy(part[last]))
    else:
        part[chance.choice(KEYS)] = copy.deepcopy(part[last])
    return data, f"{kind} {place}: {str(part)[:200]!r}"


def written(data: Any) -> bytes:
    """As ibdata writes JSON, where JSON can hold it."""
    text = json.dumps(data, indent=1, ensure_ascii=False) + "\n"
    return text.replace(json.dumps(HUGE), "1e999").encode(errors="surrogatepass")


def seal(folder: Path, data: Any) -> None:
    """Write a manifest with the hashes of the files as they are, and its checksum."""
    for entry in data["files"] if isinstance(data.get("files"), list) else ():
        path = entry.get("path") if isinstance(entry, dict) else None
        if isinstance(path, str) and re.match(SAFE_PATH, path) and (folder / path).is_file():
            found = (folder / path).read_bytes()
            entry |= {"bytes": len(found), "sha256": hashlib.sha256(found).hexdigest()}
    data["checksum"] = manifest.checksum(json.loads(written(data).decode(errors="surrogatepass")))
    (folder / manifest.PATH).write_bytes(written(data))


def put(path: str, data: Any) -> None:
    """Write data as a file of d, and seal d."""
    if path == manifest.PATH:
        seal(Path("d"), data)
    else:
        Path("d", path).write_bytes(written(data))
        seal(Path("d"), json.loads(Path("whole", manifest.PATH).read_bytes()))


@pytest.fixture
def run(capfd):
    """What a command says, and its exit code."""
    handlers = {number: signal.getsignal(number) for number in STOPPING}

    def call(line: str) -> tuple[int, str]:
        with pytest.raises(SystemExit) as end:
            main(line.split())
        out, err = capfd.readouterr()
        return end.value.code or 0, out + err

    yield call
    for number, handler in handlers.items():
        signal.signal(number, handler)  # the command line has its own


@pytest.fixture
def whole(prepared):
    """The dataset d, other, and a copy of d."""
    prepared(None, ["dataset"])
    shutil.copytree("d", "whole")


@pytest.mark.parametrize("part", range(PARTS))
def test_a_mutation_that_fits_its_hashes_is_answered_or_refused(part, whole, run):
    chance = random.Random(part)
    wrong = []
    for _ in range(OF_A_PART):
        path = chance.choice(FILES)
        data, what = mutated(json.loads(Path("whole", path).read_bytes()), chance)
        put(path, data)
        for line in (*chance.sample(READING, 4), chance.choice(WRITING)):
            code, said = run(line)
            if code not in (0, 1, 2, 3) or "a bug of ibdata" in said or RAW.search(said):
                wrong.append(f"{path}: {what}: {line}: {code}: {said[:600]!r}")
        for name in ("d", "both", "parts", "x.npz"):
            shutil.rmtree(name, ignore_errors=True)
            Path(name).unlink(missing_ok=True)
        shutil.copytree("whole", "d")
    assert not wrong, "\n".join(line.encode(errors="backslashreplace").decode() for line in wrong)


@pytest.mark.parametrize(
    ("path", "place", "value", "said"),
    [
        (
            "meta/statistics.json",
            "all reward quantiles",
            {"0.5": 1.0},
            "all.reward.quantiles: found {'0.5': 1.0}, ",
        ),
        ("meta/statistics.json", "all", {"\x1b[2J": {}}, r"all.\x1b[2J"),
        ("meta/dataset.json", "columns 18 dtype", "number", "columns.18.dtype: found 'number', "),
    ],
)
def test_what_no_dataset_holds_is_said_of_its_file(whole, run, path, place, value, said):
    data = json.loads(Path("d", path).read_bytes())
    *parents, last = [int(key) if key.isdigit() else key for key in place.split()]
    at(data, tuple(parents))[last] = value
    put(path, data)
    code, found = run("validate d")
    rule = "manifest" if path == manifest.PATH else "metadata"
    assert (code, f"{path}: {rule}: {said}" in found) == (3, True), found
    for line in ("info d", "stats d", "export d --to csv --out x.csv"):
        code, found = run(line)
        assert code in (0, 3), found
