"""Run every case in *.txt: an input, the expected output of the command, and its exit code.

A case begins with `== title`. The lines after it begin with a mark:

    | …       a line of x.yaml; `|*` stands for the lines of a small experiment
    ! …       makes a file, or damages the dataset d (see conftest.py)
    ? … → …   one of several such lines (of x.yaml after a bar), each a case of its own with its text for ⟨⟩
    $ 2: …    runs ibdata in this process and expects exit code 2; {a,b} runs it with a, then with b
    % 2: …    the same in a shell, in which $IBDATA is the command and $MADE/d the dataset d as it was made
    > …       an expected line on stderr; these are all lines, but a bare mark allows any more
    >> …      an expected line on stdout, likewise
    & NAME: … stands for the lines below `== & NAME`, with what follows in the place of ⟨⟩

In a line, … stands for any text, data/part-00000.parquet for the file of the first shard of d, \xff for a
byte, \u2603 for a character, and ⟦a×3⟧ for aaa. A case without a run validates x.yaml and generates from it.

Core damages datasets in all these ways, too, but runs only the first command that refuses them.
"""

import json
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from ibdata._system.signals import STOPPING
from ibdata.cli import main

HERE = Path(__file__).parent
SMALL = "name: x\nsetpoints: [20, 70]\npolicies: [{kind: random}]\nsteps: 3\n"
CONFIG_RUNS = ("config validate x.yaml", "generate --config x.yaml --out out --workers 1")
ESCAPE = re.compile(r"⟦(.*?)×(\d+)⟧|\\(x[0-9a-f]{2}|u[0-9a-f]{4}|.)")
READING = {"info", "head", "stats", "validate", "reproduce"}
DATA = ("manifests.txt", "shards.txt", "metadata.txt")
UNPRINTABLE = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")


class Run(NamedTuple):
    """A command and what is expected of it."""

    line: str
    code: int
    shell: bool
    err: list[str]
    out: list[str]


class Case(NamedTuple):
    """One block of a file."""

    title: str
    config: bytes | None
    damage: list[str]
    runs: list[Run]


def unescaped(text: str) -> str:
    """The text meant; bytes that are no UTF-8 as surrogates."""

    def one(match: re.Match[str]) -> str:
        if match[2]:
            return unescaped(match[1]) * int(match[2])
        letter = match[3]
        if letter[0] in "xu" and len(letter) > 1:
            number = int(letter[1:], 16)
            return chr(0xDC00 + number if letter[0] == "x" and number > 127 else number)
        return {"n": "\n", "r": "\r", "t": "\t"}.get(letter, letter)

    return ESCAPE.sub(one, text)


def expanded(line: str) -> list[str]:
    """The commands that `{a,b} c` stands for."""
    found = re.match(r"\{([a-z,]+)\}(.*)", line)
    return [name + found[2] for name in found[1].split(",")] if found else [line]


def expanded_lines(lines: list[str], shared: dict[str, list[str]]) -> list[str]:
    """The lines, with those that `& NAME: …` stands for."""
    found = []
    for line in lines:
        name, _, said = line.removeprefix("& ").partition(": ")
        own = expanded_lines(shared[name], shared) if line.startswith("& ") else [line]
        found += [each.replace("⟨⟩", said) for each in own] if line.startswith("& ") else own
    return found


def variants(block: str, shared: dict[str, list[str]]) -> Iterator[Case]:
    """The cases of a block: one, or one for each line that begins with a question mark."""
    title, *written = block.splitlines()
    lines = expanded_lines(written, shared)
    several = [line for line in lines if line.startswith("? ")]
    for one in several or [None]:
        damage, _, said = (one or "").partition(" → ")
        chosen = damage[2:] if damage.startswith("? |") else f"!{damage[1:]}"
        own = [chosen if line == one else line.replace("⟨⟩", said) for line in lines]
        yield parsed(
            f"{title}: {damage[2:60]}" if one else title, [line for line in own if not line.startswith("? ")]
        )


def parsed(title: str, lines: list[str]) -> Case:
    config, damage, runs, last = "", [], [], []
    for line in lines:
        mark, _, rest = line.partition(" ")
        if mark == "|*":
            config += SMALL
        elif mark == "|":
            config += unescaped(rest) + "\n"
        elif mark == "!":
            damage.append(unescaped(rest))
        elif mark in ("$", "%"):
            code, _, command = rest.partition(": ")
            commands = [command] if mark == "%" else expanded(unescaped(command))
            commands = CONFIG_RUNS if command == "x.yaml" else commands
            last = [Run(one, int(code), mark == "%", [], []) for one in commands]
            runs += last
        elif mark in (">", ">>"):
            for run in last:
                (run.err if mark == ">" else run.out).append(rest)
        else:
            assert not line.strip() or line.startswith("#"), f"{title}: {line}"
    return Case(title, config.encode("utf-8", "surrogateescape") if config else None, damage, runs)


def cases(name: str) -> list[Case]:
    blocks = re.split(r"^== ", (HERE / name).read_text(), flags=re.MULTILINE)[1:]
    shared = {block.split("\n")[0][2:]: block.split("\n")[1:] for block in blocks if block.startswith("& ")}
    return [case for block in blocks if not block.startswith("& ") for case in variants(block, shared)]


CASES = {path.name: cases(path.name) for path in sorted(HERE.glob("*.txt"))}
DAMAGED = [case for name in DATA for case in CASES[name]]
ALL = [
    pytest.param(case, id=f"{name[:-4]}: {case.title}", marks=pytest.mark.corpus)
    for name, found in CASES.items()
    for case in found
]


def with_names(case: Case, named: Callable[[str], str]) -> Case:
    """The case in which every line names the files of shards as they are."""
    runs = [
        run._replace(line=named(run.line), err=[*map(named, run.err)], out=[*map(named, run.out)])
        for run in case.runs
    ]
    return case._replace(damage=[*map(named, case.damage)], runs=runs)


def fits(expected: list[str], text: str) -> bool:
    lines = (
        "[^\n]*".join(map(re.escape, line.split("…"))) + "\n" if line else "(?s:.*)" for line in expected
    )
    return re.fullmatch("".join(lines), text) is not None


def contents() -> dict[str, bytes | None]:
    """What is below the current folder; as None what is no file, or a huge one."""
    found = {}
    for folder, _, names in os.walk("."):
        found[folder] = None
        for name in names:
            path = Path(folder, name)
            plain = path.is_file() and not path.is_symlink() and path.stat().st_size < 2**24
            found[str(path)] = path.read_bytes() if plain else None
    return found


def in_shell(line: str, command: str) -> tuple[int, str, str]:
    # UTF-8 mode, so that the machine's own locale plays no part.
    done = subprocess.run(
        ["bash", "-c", line],
        env={**os.environ, "IBDATA": command, "PYTHONUTF8": "1", "COLUMNS": "80"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        timeout=60,
    )
    return done.returncode, done.stdout.decode(errors="replace"), done.stderr.decode(errors="replace")


def in_process(line: str, capfd: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    handlers = {number: signal.getsignal(number) for number in STOPPING}
    with pytest.raises(SystemExit) as end:
        main(shlex.split(line))
    for number, handler in handlers.items():
        signal.signal(number, handler)  # the command line has its own
    sys.stdout.flush()
    out, err = capfd.readouterr()
    return end.value.code or 0, out, err


def differences(run: Run, code: int, out: str, err: str) -> list[str]:
    """What is not as it should be."""
    said = f"exit {code}\n{err[:600]}{out[:300]}"
    found = [] if code == run.code else [f"expected exit {run.code}"]
    found += [
        f"found {word!r}" for word in ("Traceback", "a bug of ibdata", "Exception") if word in out + err
    ]
    if not fits(run.err, err):
        found.append(f"expected on stderr: {run.err}")
    if run.out and not fits(run.out, out):
        found.append(f"expected on stdout: {run.out}")
    if not run.out and code and out:
        found.append("expected nothing on stdout")
    if UNPRINTABLE.search(err):
        found.append("expected stderr without control characters")
    return [f"{run.line[:200]}: {line}\n{said}" for line in found]


def in_core(case: Case) -> Any:
    refusals = [run for run in case.runs if run.code]
    return pytest.param(case._replace(runs=refusals[:1]), id=f"in core: {case.title}")


@pytest.mark.parametrize("case", [*ALL, *map(in_core, DAMAGED)])
def test_an_input_has_the_exit_code_and_the_message_beside_it(case, prepared, named, capfd, command):
    case = with_names(case, named)
    prepared(case.config, case.damage)
    wrong = []
    for run in case.runs:
        before = contents()
        code, out, err = in_shell(run.line, command) if run.shell else in_process(run.line, capfd)
        wrong += differences(run, code, out, err)
        if code and contents() != before:
            wrong.append(f"{run.line[:200]}: found other files: {sorted(contents().keys() ^ before.keys())}")
        if "--json" in run.line and out and not run.shell:
            json.loads(out)
    if wrong:
        pytest.fail("\n".join(wrong).encode(errors="backslashreplace").decode(), pytrace=False)


def test_every_reading_command_sees_every_damage():
    assert all(len(case.damage) > 1 for case in DAMAGED)
    shown = {case.title: {run.line.split()[0] for run in case.runs} for case in DAMAGED}
    assert {title for title, commands in shown.items() if not commands >= READING} == set()
