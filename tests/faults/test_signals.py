"""F4: SIGTERM, SIGINT and SIGHUP at random moments, also during start-up, and the processes after a kill."""

import os
import secrets
import signal
import subprocess
import time
from pathlib import Path
from typing import Any, NamedTuple

import pytest

pytestmark = pytest.mark.faults
SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
GONE = 15.0  # seconds; it takes 0.1 on an idle machine


class Ended(NamedTuple):
    """How a run ended after a signal."""

    code: int  # as a shell says it
    seconds: float  # until the last process was gone
    stderr: str


def send(
    tools: Any,
    out: Path,
    numbers: list[int],
    moment: float,
    group: bool,
    *more: object,
    of: Path | None = None,
) -> Ended:
    """Begin a run, send it signals, alone or as a terminal does, and watch it end."""
    mark = secrets.token_hex(8)
    env = {**os.environ, "FAULTS_MARK": mark}
    with tools.start(of or tools.many, out, *more, env=env, start_new_session=True) as process:
        time.sleep(moment)
        start = time.monotonic()
        for number in numbers:
            if process.poll() is None:
                (os.killpg if group else os.kill)(process.pid, number)
            time.sleep(tools.random.uniform(0, 0.05) if len(numbers) > 1 else 0)
        try:
            process.wait(timeout=30)
        except subprocess.TimeoutExpired:
            process.kill()
        while tools.processes(f"FAULTS_MARK={mark}") and time.monotonic() < start + 20:
            time.sleep(0.02)
        seconds = time.monotonic() - start
        assert process.stderr is not None
        stderr = process.stderr.read()
    return Ended(128 - process.returncode if process.returncode < 0 else process.returncode, seconds, stderr)


def wrong_with(tools: Any, ended: Ended, out: Path, numbers: list[int]) -> list[str]:
    """What should not be so. A traceback of Python's own start, before ibdata's, is not ours to prevent."""
    bad = []
    if ended.code not in (0, *(128 + number for number in numbers)):
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
def test_a_signal_ends_a_run(tools: Any, whole: str, number: signal.Signals, group: bool) -> None:
    """At any moment; what is finished then can be resumed, and nothing is left where no shard is."""
    wrong, slowest, tries = [], 0.0, tools.size(4, 20)
    for i in range(tries):
        out, moment = tools.where / f"out-{i}", tools.random.uniform(0.6, 3.2)
        ended = send(tools, out, [number], moment, group, "--workers", 1 + i % 3)
        slowest = max(slowest, ended.seconds)
        wrong += [f"after {moment:.2f} s: {what}" for what in wrong_with(tools, ended, out, [number])]
        if i == 0 or tools.full:
            assert tools.generate(tools.many, out, "--resume").returncode == 0
            assert tools.root(out) == whole
            assert tools.leftovers(out) == []
    tools.figure(
        f"F4: {number.name}{' to the group' if group else ''}: {tries} runs, all gone after {slowest:.2f} s "
        f"at most, {len(wrong)} violations"
    )
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
def test_a_signal_while_starting_leaves_nothing(tools: Any, number: signal.Signals) -> None:
    """Nor does it show a traceback."""
    wrong, tries = [], tools.size(12, 100)
    for i in range(tries):
        out, moment = tools.where / f"out-{i}", 0.03 + 0.9 * i / tries
        ended = send(tools, out, [number], moment, False)
        wrong += [f"after {moment:.2f} s: {what}" for what in wrong_with(tools, ended, out, [number])]
    tools.figure(f"F4, starting: {number.name}: {tries} runs, {len(wrong)} violations")
    assert not wrong, "\n".join(wrong)


def test_the_workers_of_a_killed_run_are_gone(tools: Any) -> None:
    """Whatever they were doing, of a run that would go on for minutes."""
    slowest, tries = 0.0, tools.size(4, 50)
    text = tools.many.read_text().replace("episodes: 40", "episodes: 20000")
    long = tools.file("long.yaml", text)
    for i in range(tries):
        moment = tools.random.uniform(0.8, 2.5)
        ended = send(
            tools, tools.where / f"out-{i}", [signal.SIGKILL], moment, False, "--workers", 3, of=long
        )
        slowest = max(slowest, ended.seconds)
    tools.figure(f"F4: parent killed in {tries} runs, its workers gone after {slowest:.2f} s at most")
    assert slowest <= GONE


def test_a_second_signal_changes_nothing(tools: Any) -> None:
    """While the first one's run is cleaning up."""
    wrong, numbers = [], [signal.SIGTERM, signal.SIGTERM, signal.SIGINT]
    for i in range(tools.size(4, 30)):
        out = tools.where / f"out-{i}"
        ended = send(tools, out, [*numbers], tools.random.uniform(1.0, 2.5), False)
        wrong += wrong_with(tools, ended, out, [*numbers])
    assert not wrong, "\n".join(wrong)
