"""SIGTERM, SIGINT and SIGHUP at random moments, also during start-up: the run and its processes end."""

import os
import secrets
import signal
import subprocess
import time
from typing import NamedTuple

import pytest

pytestmark = pytest.mark.faults
SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
GONE = 15.0  # seconds; it takes 0.1 on an idle machine


class Ended(NamedTuple):
    """How a run ended after a signal."""

    code: int  # as a shell says it
    seconds: float  # until the last process was gone
    stderr: str


def send(tools, out, number, moment, *more, group=False):
    """Begin a run, send it a signal, alone or as a terminal does, and watch it end."""
    mark = secrets.token_hex(8)
    env = {**os.environ, "FAULTS_MARK": mark}
    with tools.start(tools.many, out, *more, env=env, start_new_session=True) as process:
        time.sleep(moment)
        start = time.monotonic()
        if process.poll() is None:
            (os.killpg if group else os.kill)(process.pid, number)
        try:
            process.wait(timeout=30)
        except subprocess.TimeoutExpired:
            process.kill()
        while tools.processes(f"FAULTS_MARK={mark}") and time.monotonic() < start + 20:
            time.sleep(0.02)
        seconds = time.monotonic() - start
        stderr = process.stderr.read()
    return Ended(128 - process.returncode if process.returncode < 0 else process.returncode, seconds, stderr)


def wrong_with(tools, ended, out, number):
    """What should not be so. A traceback of Python's own start, before ibdata's, is not ours to prevent."""
    bad = []
    if ended.stderr.startswith("Fatal Python error: init_import_site"):
        return bad
    if ended.code not in (0, 128 + number):
        bad.append(f"exit code {ended.code}: {ended.stderr}")
    if ended.seconds > GONE:
        bad.append(f"its processes ended after {ended.seconds:.1f} s")
    early = ended.stderr.endswith("KeyboardInterrupt\n") and " in main\n" not in ended.stderr
    known = [text for text in ("a bug of ibdata", "Exception ignored") if text in ended.stderr]
    if known or ("Traceback" in ended.stderr and not early):
        bad.append(f"said {ended.stderr}")
    if ended.code and (out.exists() or bool(tools.leftovers(out)) != bool(tools.receipts(out))):
        bad.append(f"left behind: {tools.leftovers(out)}")
    return bad


@pytest.mark.parametrize("group", [False, True], ids=["alone", "with its process group"])
@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
def test_a_signal_ends_a_run(tools, whole, number, group):
    """At any moment; what is finished then is gone on with, and nothing is left where no shard is."""
    wrong, early = [], tools.size(6, 50)
    for i in range(early + tools.size(4, 20)):
        out = tools.where / f"out-{i}"
        moment = 0.03 + 0.9 * i / early if i < early else tools.random.uniform(0.6, 3.2)
        ended = send(tools, out, number, moment, "--workers", 1 + i % 3, group=group)
        wrong += [f"after {moment:.2f} s: {what}" for what in wrong_with(tools, ended, out, number)]
        if i == early or tools.full:
            assert tools.generate(tools.many, out).returncode == 0
            assert tools.root(out) == whole
            assert tools.leftovers(out) == []
    assert not wrong, "\n".join(wrong)
