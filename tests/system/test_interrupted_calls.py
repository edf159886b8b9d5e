"""Ctrl-C at any import of a call: KeyboardInterrupt, nothing is left, and the call repeated is right."""

import json
import os
import subprocess
import sys

import pytest

FULL = os.environ.get("IBDATA_TESTS") == "full"
# Each call runs in forks of a process that has generated a dataset, as a script or a notebook has. The k-th
# import of a fork meets the signal.
CHILD = """
import json, os, signal, sys, threading
import ibdata

folder, moments, names = sys.argv[1], int(sys.argv[2]), sys.argv[3:]
EXPERIMENT = {"name": "x", "setpoints": [20, 70], "episodes": 2, "steps": 5, "policies": ["random"]}
EXPERIMENT["output"] = {"shard_rows": 10}
first = f"{folder}/first"
ibdata.generate(EXPERIMENT, first, workers=1)
CALLS = {
    "generate": lambda out: ibdata.generate({**EXPERIMENT, "seed": 3}, out).content_root,
    "validate": lambda out: list(ibdata.validate(first)),
    "arrays": lambda out: ibdata.open(first).arrays(history=2)["observations"].tolist(),
    "select": lambda out: len(ibdata.open(first).select(setpoint=20)),
    "windows": lambda out: len(ibdata.open(first).windows(folder=out)),
    "episodes": lambda out: ibdata.open(first).episodes["length"].tolist(),
    "to_pandas": lambda out: ibdata.open(first).to_pandas()["reward"].tolist(),
    "returns": lambda out: str(ibdata.open(first).returns()),
    "statistics": lambda out: str(ibdata.open(first).statistics()),
    "quality": lambda out: str(ibdata.quality(first)),
    "card": lambda out: len(ibdata.card(first)),
    "split": lambda out: ibdata.split(first, "episode", fractions=[0.5, 0.5], materialize=out).content_root,
    "repair": lambda out: ibdata.repair(first),
    "reproduce": lambda out: ibdata.reproduce(first)[0],
    "npz": lambda out: ibdata.export(first, "npz", out).rows,
    "d4rl": lambda out: ibdata.export(first, "d4rl", out).rows,
    "evaluate": lambda out: str(ibdata.evaluate(["random"], setpoint=[70], episodes=2, steps=5)),
    "true_values": lambda out: str(ibdata.true_values(first, "random", rows=[(0, 0)])),
    "importance": lambda out: str(ibdata.importance(first, "random")),
}


class Import:
    count = strike = 0

    def __call__(self, event, arguments):
        if event == "import":
            self.count += 1
            if self.count == self.strike:
                signal.raise_signal(signal.SIGINT)


def forked(function, *arguments):
    ours, theirs = os.pipe()
    if not (child := os.fork()):
        signal.alarm(60)
        try:
            answer = function(*arguments)
        except BaseException as error:
            answer = repr(error)
        os.write(theirs, json.dumps(answer).encode())
        os._exit(0)
    os.close(theirs)
    with open(ours, "rb") as pipe:
        answer = pipe.read()
    os.waitpid(child, 0)
    return json.loads(answer) if answer else "hangs"


def undisturbed(name):
    sys.addaudithook(imports := Import())
    return CALLS[name](f"{folder}/{name}"), imports.count


def interrupted(name, strike):
    imports, ended, out = Import(), "no exception", f"{folder}/{name}-{strike}"
    imports.strike = strike
    sys.addaudithook(imports)
    try:
        CALLS[name](out)
    except BaseException as error:
        ended = "KeyboardInterrupt" if isinstance(error, KeyboardInterrupt) else repr(error)
    left = [each.name for each in threading.enumerate()][1:]
    left += [each for each in os.listdir(folder) if each.endswith(".part")]
    return ended, left, CALLS[name](out)


for name in names:
    answer = forked(undisturbed, name)
    if not isinstance(answer, list):
        print(json.dumps([name, 0, answer]), flush=True)
        continue
    expected, count = answer
    for strike in sorted({1 + i * count // moments for i in range(moments)}) if count else ():
        found = forked(interrupted, name, strike)
        if found != ["KeyboardInterrupt", [], expected]:
            print(json.dumps([name, strike, found]), flush=True)
    print(json.dumps([name, count, "done"]), flush=True)
"""


def wrong(folder, moments, *names):
    """The calls and imports after which something is not as it should be."""
    done = subprocess.run(
        [sys.executable, "-c", CHILD, str(folder), str(moments), *names],
        capture_output=True, text=True, timeout=900, check=True,
    )  # fmt: skip
    found = [json.loads(line) for line in done.stdout.splitlines()]
    assert [name for name, count, what in found if what == "done"] == list(names), found
    return [each for each in found if each[2] != "done"]


def test_an_interrupted_import_is_an_interrupted_call(tmp_path):
    """Arrow imports pandas from C++, and loses the exception."""
    assert wrong(tmp_path, 2, "validate", "select") == []


@pytest.mark.slow
def test_every_call_can_be_interrupted_and_repeated(tmp_path):
    """Somebody presses Ctrl-C in the cell of a notebook, and runs the cell again."""
    names = CHILD.partition("CALLS = {")[2].partition("\n}")[0].split('    "')[1:]
    names = [each.partition('"')[0] for each in names]
    assert wrong(tmp_path, 20 if FULL else 3, *names) == []
