"""F4: SIGTERM, SIGINT and SIGHUP at random moments, also during start-up, and the processes after a kill."""

import os
import secrets
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import pytest

pytestmark = pytest.mark.faults
SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


def _limit() -> float:
    """2 seconds; on a machine so busy that it starts Python slowly, three times what that takes."""
    start = time.monotonic()
    subprocess.run([sys.executable, "-c", "import numba"], check=True)
    return max(2.0, 3.0 * (time.monotonic() - start))


class Ended(NamedTuple):
    """How a run ended after a signal."""

    code: int
    seconds: float
    stderr: str
    gone: float  # seconds until the last process was gone


def send(tools: Any, out: Path, number: int, moment: float, group: bool, *more: object) -> Ended:
    """Begin a run, send it a signal, alone or as a terminal does, and watch it end."""
    mark = f"FAULTS_MARK={secrets.token_hex(8)}"
    env = {**os.environ, "FAULTS_MARK": mark.split("=")[1]}
    with tools.start(tools.many, out, *more, env=env, start_new_session=True) as process:
        time.sleep(moment)
        start = time.monotonic()
        if process.poll() is None:
            (os.killpg if group else os.kill)(process.pid, number)
        try:
            process.wait(timeout=30)
        except subprocess.TimeoutExpired:
            process.kill()
        seconds = time.monotonic() - start
        while tools.processes(mark) and time.monotonic() < start + 20:
            time.sleep(0.02)
        gone = time.monotonic() - start
        assert process.stderr is not None
        stderr = process.stderr.read()
    code = process.returncode
    return Ended(128 - code if code < 0 else code, seconds, stderr, gone)  # as a shell says it


def wrong_with(tools: Any, ended: Ended, out: Path, number: int) -> list[str]:
    """What should not be so. A traceback of Python's own start, before ibdata's, is not ours to prevent."""
    bad = []
    if ended.code not in (0, 128 + number):
        bad.append(f"exit code {ended.code}: {ended.stderr}")
    if max(ended.seconds, ended.gone) > 2.0 and max(ended.seconds, ended.gone) > _limit():
        bad.append(f"ended after {ended.seconds:.1f} s, its processes after {ended.gone:.1f} s")
    early = ended.stderr.endswith("KeyboardInterrupt\n") and " in main\n" not in ended.stderr
    known = [text for text in ("a bug of ibdata", "Exception ignored") if text in ended.stderr]
    if known or ("Traceback" in ended.stderr and not early):
        bad.append(f"said {ended.stderr}")
    left = [name for name in tools.leftovers(out) if ".tmp-" in name or ".lock" in name]
    return bad + ([f"left behind: {left}"] if left else [])


@pytest.mark.parametrize("group", [False, True], ids=["alone", "with its process group"])
@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
def test_a_signal_at_a_random_moment_ends_the_run_within_two_seconds_and_leaves_it_resumable(
    tools: Any, whole: Any, number: signal.Signals, group: bool
) -> None:
    wrong, slowest, tries = [], 0.0, tools.size(4, 20)
    for i in range(tries):
        out, moment = tools.where / f"out-{i}", tools.random.uniform(0.6, 3.2)
        ended = send(tools, out, number, moment, group, "--workers", 2 + i % 2)
        slowest = max(slowest, ended.gone)
        wrong += [f"after {moment:.2f} s: {what}" for what in wrong_with(tools, ended, out, number)]
        if i == 0 or tools.full:
            assert tools.generate(tools.many, out, "--resume").returncode == 0
            assert tools.root(out) == whole[0]
            assert tools.leftovers(out) == []
    tools.figure(
        f"F4: {number.name}{' to the group' if group else ''}: {tries} runs, all gone after {slowest:.2f} s "
        f"at most, {len(wrong)} violations"
    )
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
def test_a_signal_while_starting_ends_the_run_without_a_traceback_and_leaves_nothing(
    tools: Any, number: signal.Signals
) -> None:
    wrong, tries = [], tools.size(12, 100)
    for i in range(tries):
        out, moment = tools.where / f"out-{i}", 0.03 + 0.9 * i / tries
        ended = send(tools, out, number, moment, False, "--workers", 2)
        wrong += [f"after {moment:.2f} s: {what}" for what in wrong_with(tools, ended, out, number)]
    tools.figure(f"F4, starting: {number.name}: {tries} runs, {len(wrong)} violations")
    assert not wrong, "\n".join(wrong)


def test_the_workers_of_a_killed_run_are_gone_within_two_seconds(tools: Any) -> None:
    slowest, tries = 0.0, tools.size(4, 50)
    for i in range(tries):
        out = tools.where / f"out-{i}"
        ended = send(tools, out, signal.SIGKILL, tools.random.uniform(0.8, 2.5), False, "--workers", 3)
        slowest = max(slowest, ended.gone)
    tools.figure(f"F4: parent killed in {tries} runs, its workers gone after {slowest:.2f} s at most")
    assert slowest <= 2.0 or slowest <= _limit()


def test_a_second_signal_while_cleaning_up_changes_nothing(tools: Any) -> None:
    wrong = []
    for i in range(tools.size(4, 30)):
        out = tools.where / f"out-{i}"
        with tools.start(tools.many, out, "--workers", 2) as process:
            time.sleep(tools.random.uniform(1.0, 2.5))
            for number in (signal.SIGTERM, signal.SIGTERM, signal.SIGINT):
                process.send_signal(number)
                time.sleep(tools.random.uniform(0, 0.05))
            _, stderr = process.communicate(timeout=30)
        code = 128 - process.returncode if process.returncode < 0 else process.returncode
        last = signal.SIGINT if code == 130 else signal.SIGTERM  # it may arrive when all is cleaned up
        wrong += wrong_with(tools, Ended(code, 0.0, stderr, 0.0), out, last)
    assert not wrong, "\n".join(wrong)
