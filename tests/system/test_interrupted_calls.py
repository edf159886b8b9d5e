"""Ctrl-C at any import of a call: KeyboardInterrupt, nothing is left, and the call repeated is right."""

import json
import os
import signal
import subprocess
import sys
from importlib import import_module
from signal import raise_signal

import pytest

FULL = os.environ.get("IBDATA_FAULTS") == "full"
# Each call runs in forks of a process that has generated a dataset, as a script or a notebook has. The k-th
# import of a fork meets the signal.
CHILD = """
import json, os, signal, sys, threading, time
import ibdata, ibdata.plots

folder, moments, names = sys.argv[1], int(sys.argv[2]), sys.argv[3:]
EXPERIMENT = {"name": "x", "setpoints": [20, 70], "episodes": 2, "steps": 5, "policies": ["random"]}
EXPERIMENT["output"] = {"shard_rows": 10}
first, second = f"{folder}/first", f"{folder}/second"
ibdata.generate(EXPERIMENT, first, workers=1)
if "merge" in names:
    ibdata.generate(EXPERIMENT, second, workers=1, seed=1)
sys.modules["gymnasium"] = None  # `make` would make millions of rows
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
    "split": lambda out: ibdata.split(first, {"few": {"episodes": 1}}, materialize=out).content_root,
    "repair": lambda out: ibdata.repair(first),
    "reproduce": lambda out: ibdata.reproduce(first)[0],
    "merge": lambda out: ibdata.merge([first, second], out).content_root,
    "plot": lambda out: [each.read_bytes().hex() for each in ibdata.plots.plot(first, out, overwrite=True)],
    "make": lambda out: refusal(lambda: ibdata.make("siemens-offline/optimized-40")),
    "npz": lambda out: ibdata.export(first, "npz", out).rows,
    "d4rl": lambda out: ibdata.export(first, "d4rl", out).rows,
    "evaluate": lambda out: str(ibdata.evaluate(["random"], setpoint=[70], episodes=2, steps=5)),
    "true_values": lambda out: str(ibdata.true_values(first, [(0, 0)], "random", steps=5, episodes=2)),
    "rollouts": lambda out: ibdata.rollouts(first, [[[0, 0, 0]]], rows=[0]).rewards.tolist(),
    "importance": lambda out: str(ibdata.importance(first, "random")),
}


def refusal(function):
    try:
        function()
    except ibdata.IbdataError as error:
        return str(error)


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


def parts():
    return [each for each in os.listdir(folder) if each.endswith(".part")]


def undisturbed(name):
    sys.addaudithook(imports := Import())
    return CALLS[name](f"{folder}/{name}"), imports.count


def interrupted(name, strike):
    imports, ended, kept, out = Import(), "no exception", False, f"{folder}/{name}-{strike}"
    imports.strike = strike
    sys.addaudithook(imports)
    try:
        CALLS[name](out)
    except BaseException as error:
        ended = "KeyboardInterrupt" if isinstance(error, KeyboardInterrupt) else repr(error)
        kept = "the same command goes on" in str(error)
    patience = time.monotonic() + 5
    while threading.active_count() > 1 and time.monotonic() < patience:
        time.sleep(0.01)  # a thread that was being started ends by itself
    left = [each.name for each in threading.enumerate()][1:] + ([] if kept else parts())
    answer = CALLS[name](out)
    return ended, left + parts(), answer


for name in names:
    answer = forked(undisturbed, name)
    if not isinstance(answer, list):
        print(json.dumps([name, 0, answer]), flush=True)
        continue
    expected, count = answer
    for strike in sorted({1 + (2 * i + 1) * count // moments // 2 for i in range(moments)}) if count else ():
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
    assert wrong(tmp_path, 1, "validate") == []


@pytest.mark.faults
def test_every_call_can_be_interrupted_and_repeated(tmp_path):
    """Somebody presses Ctrl-C in the cell of a notebook, and runs the cell again."""
    names = CHILD.partition("CALLS = {")[2].partition("\n}")[0].split('    "')[1:]
    names = [each.partition('"')[0] for each in names]
    assert wrong(tmp_path, 20 if FULL else 2, *names) == []


CALLING = """
import signal
import ibdata

class Own:
    acted = 0

    def act(self, history, u):
        Own.acted += 1
        signal.raise_signal(signal.SIGINT)
        return 0 * history[:, 0, :3]

found = ibdata.evaluate(Own(), 70, episodes=1, steps=3)
"""


@pytest.fixture
def calling(tmp_path, monkeypatch):
    """A module that calls ibdata when it is imported."""
    (tmp_path / "calling.py").write_text(CALLING)
    monkeypatch.syspath_prepend(tmp_path)
    before = signal.signal(
        signal.SIGINT, signal.default_int_handler
    )  # a command that ran here ends at signals
    yield "calling"
    signal.signal(signal.SIGINT, before)
    sys.modules.pop("calling", None)


def test_a_call_within_an_import_ends_at_once(calling, monkeypatch):
    """Only an import that the call begins is waited for, not that of the module which calls."""
    acted = []
    monkeypatch.setattr(signal, "raise_signal", lambda number: acted.append(1) or raise_signal(number))
    with pytest.raises(KeyboardInterrupt):
        import_module(calling)
    assert acted == [1]


def test_a_handler_of_the_user_is_called(calling):
    """Somebody's handler notes Ctrl-C, and lets the call end."""
    noted = []
    own = signal.signal(signal.SIGINT, lambda *_: noted.append(1))
    try:
        module = import_module(calling)
        assert module.found
        assert len(noted) == module.Own.acted
    finally:
        signal.signal(signal.SIGINT, own)
