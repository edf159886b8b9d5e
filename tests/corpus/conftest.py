"""Datasets to damage, and the commands by which the cases damage them."""

import hashlib
import json
import os
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from helpers.folders import seal_description

import ibdata
from ibdata import Experiment
from ibdata.dataset import manifest

PLAIN = {
    "name": "tiny",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "random"}, {"kind": "safe"}],
    "episodes": 2,
    "steps": 3,
    "output": {"shard_rows": 6},
    "splits": {"low": {"setpoint": 20}},
}


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a dataset d of four shards, and one of another seed, other."""
    folder = tmp_path_factory.mktemp("made")
    for name, seed in (("d", 0), ("other", 1)):
        ibdata.generate(Experiment.model_validate({**PLAIN, "seed": seed}), folder / name, workers=1)
    return folder


@pytest.fixture(scope="session")
def named(made: Path, shard_file: Callable[[Path, int], str]) -> Callable[[str], str]:
    """A line of a case; data/part-00000.parquet in it stands for the file of that shard of the dataset d."""
    names = {f"data/part-{i:05d}.parquet": shard_file(made / "d", i) for i in range(4)}

    def line(text: str) -> str:
        return re.sub(r"data/part-\d{5}\.parquet", lambda found: names.get(found[0], found[0]), text)

    return line


@pytest.fixture
def prepared(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Go to an empty folder and put there what a case begins with."""

    def prepare(config: bytes | None, damage: list[str]) -> None:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setenv("COLUMNS", "80")
        monkeypatch.setenv("MADE", str(made))
        if config is not None:
            Path("x.yaml").write_bytes(config)
        for line in damage:
            name, _, rest = line.partition(" ")
            if name == "dataset":
                for each in ("d", "other"):
                    shutil.copytree(made / each, each)
            else:
                WORDS[name](rest)

    return prepare


def _sealed(rest: str) -> None:
    """Give Croissant and the manifest the hashes of all files, and a checksum, as who means harm would."""
    seal_description(Path("d", manifest.CROISSANT))
    path = Path("d", manifest.PATH)
    listed = json.loads(path.read_bytes())
    for entry in listed["files"] if isinstance(listed.get("files"), list) else ():
        named = isinstance(entry, dict) and {type(entry.get("path")), type(entry.get("sha256"))} == {str}
        if named and (file := Path("d", entry["path"])).is_file():
            data = file.read_bytes()
            entry |= {"bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
    listed["checksum"] = manifest.checksum(listed)
    path.write_bytes((json.dumps(listed, indent=1, ensure_ascii=False) + "\n").encode(errors="surrogatepass"))


def _json(rest: str) -> None:
    """PATH KEY.KEY = VALUE puts a value into JSON; - PATH KEY.KEY takes it out."""
    place, _, value = rest.partition(" = ")
    path, _, keys = place.removeprefix("- ").partition(" ")
    data = json.loads(Path(path).read_bytes())
    *parents, last = [int(key) if key.isdigit() else key for key in keys.split(".")]
    part: Any = data
    for key in parents:
        part = part[key]
    if place.startswith("- "):
        del part[last]
    else:
        part[last] = json.loads(value)
    Path(path).write_text(json.dumps(data))


def _cut(rest: str) -> None:
    path, count = rest.split()
    data = Path(path).read_bytes()
    Path(path).write_bytes(data[: len(data) // 2] if count == "half" else data[int(count) :])


def _write(rest: str) -> None:
    path, _, text = rest.partition(" ")
    Path(path).write_bytes(text.encode("utf-8", "surrogateescape"))


def _table(change: Callable[..., pa.Table]) -> Callable[[str], None]:
    """PATH … changes the table in that file; what follows are further arguments."""

    def word(rest: str) -> None:
        path, *more = rest.split()
        pq.write_table(change(pq.read_table(path), *more), path, use_dictionary=["policy"])

    return word


def _with(table: pa.Table, name: str, values: pa.Array) -> pa.Table:
    return table.set_column(table.column_names.index(name), pa.field(name, values.type, False), values)


def _nan(table: pa.Table, name: str) -> pa.Table:
    first, _, *rest = table[name].to_pylist()
    return _with(table, name, pa.array([first, float("nan"), *rest], table[name].type))


def _special(make: Callable[[Path], None]) -> Callable[[str], None]:
    """PATH becomes what `make` makes of it."""

    def word(rest: str) -> None:
        path = Path(rest)
        path.unlink(missing_ok=True)
        make(path)

    return word


WORDS: dict[str, Callable[[str], Any]] = {
    "sealed": _sealed,
    "json": _json,
    "cut": _cut,
    "write": _write,
    "remove": lambda path: os.remove(path),
    "copy": lambda rest: shutil.copy(*rest.split()),
    "rename": lambda rest: os.rename(*rest.split()),
    "folder": _special(os.mkdir),
    "fifo": _special(os.mkfifo),
    "loop": _special(lambda path: path.symlink_to(path.name)),
    "without": _table(lambda table, name: table.drop_columns(name)),
    "no-rows": _table(lambda table: table.slice(0, 0)),
    "fewer-rows": _table(lambda table: table.slice(0, len(table) - 1)),
    "numbered": _table(lambda table: pa.table({"a": range(len(table))})),
    "lists": _table(lambda table: pa.table({name: [[1]] * len(table) for name in table.column_names})),
    "double": _table(lambda table, name: _with(table, name, pc.cast(table[name], pa.float64()))),
    "nan": _table(_nan),
}
