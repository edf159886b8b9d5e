"""A custom policy of several files, and runs with it that stop."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import pytest

import ibdata
from helpers.folders import receipts
from ibdata.errors import IbdataError

PLAIN = {
    "name": "own",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "custom", "target": "mine:Own", "uniforms": 3, "files": ["weights.txt"]}],
    "episodes": 2,
    "steps": 4,
    "output": {"shard_rows": 4},
}
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
    "own.yaml": json.dumps(PLAIN),
    "at-70-stop.py": "raise RuntimeError('stopped')",
}


def generate(out="out", **options):
    return ibdata.generate("own.yaml", out, allow_code=True, **{"workers": 1, **options})


def stopped(out="out", **options):
    """A run that stops in the third of four shards."""
    with pytest.raises(IbdataError, match="RuntimeError: stopped"):
        generate(out, **options)
    Path("at-70-stop.py").unlink()
    assert len(receipts(out)) == 2


def sha256(path):
    return hashlib.sha256(Path(path).read_bytes()).hexdigest()
