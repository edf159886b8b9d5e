"""Custom policies of one file and of several, and runs with them."""

from __future__ import annotations

import hashlib
import json
import sys
from pathlib import Path
from textwrap import dedent

import pytest

import ibdata
from helpers.folders import receipts
from helpers.refusals import refused
from ibdata.errors import IbdataError

# A policy of several files, whose run stops in the third of four shards while `at-70-stop.py` is there.
SEVERAL = {"target": "mine:Own", "draws": 3, "files": ["weights.txt"]}
FILES = {
    "mine.py": """
        import pathlib
        import helper

        class Own:
            def __init__(self):
                self.size = float(pathlib.Path("weights.txt").read_text())

            def act(self, history, u):
                from lazy import SIGN
                if history[0, 0, 0] == 70:
                    for path in pathlib.Path().glob("at-70-*.py"):
                        exec(path.read_text())
                return SIGN * helper.SIZE * self.size * (2.0 * u - 1.0)
        """,
    "helper.py": "SIZE = 0.25",
    "lazy.py": "SIGN = -1.0",
    "weights.txt": "0.5",
}
STOP = {"at-70-stop.py": "raise RuntimeError('stopped')"}
# A module `mine` with policies in each of the forms that a target takes.
FORMS = {
    "mine.py": """
        import numpy as np

        open("imported", "w").close()

        class Actor:
            def __init__(self, gain=0.0):
                self.gain = gain

            def act(self, history, u):
                return self.gain * (2.0 * u - 1.0) + 0.001 * history[:, 0, 1:4]

        class Learned:
            def predict(self, observations):
                return np.tanh(observations[:, 7:10] / 100.0), None

        def made(value):
            return type("Still", (), {"predict": lambda self, x: np.full((len(x), 3), value)})()

        def still(observations, value=0.125):
            return np.full((len(observations), 3), value)

        def by_name(obs):
            return still(obs)

        actor = Actor(0.25)
        nothing = object()

        def failing():
            raise RuntimeError("no weights")

        calls = []

        def counting(observations):
            calls.append(0)
            return still(observations, len(calls) / 1000.0)
        """
}


class OwnCode:
    """The files of a custom policy, and beside them own.yaml, an experiment of four shards."""

    def __init__(self, folder: str, files: dict[str, str], block: dict[str, object]) -> None:
        self.folder, self.config = Path(folder), Path(folder, "own.yaml")
        plain = {"name": "own", "setpoints": [20.0, 70.0], "episodes": 2, "steps": 4}
        plain |= {"policies": [{"kind": "custom", **block}], "output": {"shard_rows": 4}}
        self.edit({**files, "own.yaml": json.dumps(plain)})

    def edit(self, files: dict[str, str]) -> None:
        """Write these files."""
        for path, text in files.items():
            (self.folder / path).parent.mkdir(parents=True, exist_ok=True)
            (self.folder / path).write_text(dedent(text))

    def run(self, out="out", **options):
        """The dataset of own.yaml as it is now."""
        return ibdata.generate(self.config, out, **{"workers": 1, "allow_code": True, **options})

    def stopped(self, out="out"):
        """A run that stops in the third shard."""
        self.edit(STOP)
        refused("RuntimeError: stopped", self.run, out, error=IbdataError)
        (self.folder / next(iter(STOP))).unlink()
        assert len(receipts(out)) == 2

    def sha256(self, path):
        return hashlib.sha256((self.folder / path).read_bytes()).hexdigest()


@pytest.fixture
def code(tmp_path, monkeypatch):
    """A function that writes the files of a policy into the current folder or one below it; see OwnCode."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    return lambda files, folder=".", /, **block: OwnCode(folder, files, block)
