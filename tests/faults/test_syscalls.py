"""Each operation of a command fails, or is the last before a kill; then it runs again."""

import shutil
from itertools import count
from typing import NamedTuple

import pytest
from helpers.readers import rewards

import ibdata

pytestmark = pytest.mark.faults
KILLED = -9
FAILURES = ("ENOSPC", "EIO", "full")  # full: from here on nothing more can be written


class Case(NamedTuple):
    """A command, and what is there before it."""

    before: list[str]
    command: str
    exchange: bool = True


NEW = "generate {tiny} --out {base}/out --quiet --workers 1"
CASES = {
    "a new dataset": Case([], NEW),
    "a replacement": Case([NEW], f"{NEW} --seed 1 --overwrite"),
    "a replacement by two renames": Case([NEW], f"{NEW} --seed 1 --overwrite", exchange=False),
    "the last part of an array job": Case([f"{NEW} --shards 1/1"], "finalize {base}/out"),
    "a merge": Case(
        [NEW.replace("/out", f"/{n}") + f" --seed {n}" for n in "12"],
        "merge {base}/1 {base}/2 --out {base}/out",
    ),
    "a copy": Case(
        [NEW.replace("/out", "/1")],
        "split {base}/1 --by episode fractions=[0.5,0.5] --materialize {base}/out",
    ),
    "labels": Case([NEW], "split {base}/out --by episode fractions=[0.5,0.5]"),
    "a card": Case([NEW], "card {base}/out"),
}  # fmt: skip
MOVES = ("a replacement by two renames",)  # of its faults, only those of the last operations are of interest


def modes_of(operation, k, full):
    """The faults that an operation can meet; in CI one of them, in turn."""
    writes = operation in ("write", "create", "mkdir")
    failures = ["ENOSPC", "EIO", *(["full"] if writes else [])] if operation != "unlink" else ["EIO"]
    modes = [*failures, "before", "after", *(["half"] if operation == "write" else [])]
    return modes if full else [modes[k % len(modes)]]


def state(folder):
    """Content root and splits of a dataset that is whole; None where there is nothing."""
    if not folder.exists():
        return None
    assert ibdata.validate(folder) == []
    found = ibdata.open(folder)
    return found.content_root, sorted(found.splits)


class Play:
    """One case, again and again."""

    def __init__(self, forks, tools, case):
        self.forks, self.tools, self.case = forks, tools, case
        self.base, self.kept = tools.where / "base", tools.where / "kept"
        self.out = self.base / "out"
        self.base.mkdir()
        for command in case.before:
            assert self.run(command).code == 0
        shutil.copytree(self.base, self.kept)
        self.old, self.old_rows = state(self.out), rewards(self.out)
        answer = self.run(case.command, log=tools.where / "log")
        assert answer.code == 0, answer
        self.new, self.new_rows = state(self.out), rewards(self.out)
        assert tools.leftovers(self.out) == []
        self.lines = (tools.where / "log").read_text().splitlines()

    def run(self, command, **options):
        args = [part.format(tiny=self.tools.tiny, base=self.base) for part in command.split()]
        return self.forks.run(*args, folder=self.base, exchange=self.case.exchange, **options)

    def faults(self):
        """Every (k, mode, operation) of the command."""
        return [
            (k, mode, line.replace(f"{self.base}/", ""))
            for k, line in zip(count(1), self.lines, strict=False)
            for mode in modes_of(line.split()[0].lstrip("-"), k, self.tools.full)
        ]

    def struck(self, k, mode):
        """The answer of a run with this fault.

        Threads take turns as they like, so that the k-th may be one that the fault cannot strike: then again.
        """
        for _ in range(50):
            shutil.rmtree(self.base)
            shutil.copytree(self.kept, self.base)
            answer = self.run(self.case.command, at=k, mode=mode)
            if mode in FAILURES or answer.code == KILLED:
                break
        return answer

    def violations(self, k, mode, line):
        """What is not as promised after one fault."""
        answer, bad = self.struck(k, mode), []
        found = state(self.out)
        if answer.code not in ((0, 1, 2) if mode in FAILURES else (KILLED,)):
            bad.append(f"exit code {answer}")
        if answer.code > 0 and not self.tools.one_line(answer.output):
            bad.append(f"not one line: {answer.output}")
        moved = found is None and not self.case.exchange  # between the two renames
        if found not in (self.old, self.new) and not moved:
            bad.append(f"found {found}")
        if answer.code == 0 and found != self.new:
            bad.append("exit 0 without the new dataset")
        for name, rows in rewards(self.out).items():
            if rows not in (self.old_rows[name], self.new_rows[name]) and not moved:
                bad.append(f"{name} found {rows if rows is None else len(rows)} rows of neither dataset")
        left = self.tools.leftovers(self.out)
        resumable = left == [".out.part"] and self.tools.receipts(self.out)
        removes = "unlink" in line or "rmdir" in line
        if mode in FAILURES and left and not removes and not resumable:
            bad.append(f"left behind: {left}")
        if found != self.new or "--overwrite" in self.case.command:  # else nothing would be written
            again = self.run(self.case.command)
            if again.code or state(self.out) != self.new or self.tools.leftovers(self.out):
                left = self.tools.leftovers(self.out)
                bad.append(f"run again: {again}, {state(self.out)}, left: {left}")
        return [f"{mode} at {k}: {line}: {what}" for what in bad]


@pytest.mark.parametrize("name", CASES)
def test_any_operation_fails_or_is_the_last(forks, tools, name):
    """Readers find the old dataset or the new one, whole, and the command can be run again to its end."""
    play = Play(forks, tools, CASES[name])
    faults = play.faults()[-40 if name in MOVES and not tools.full else 0 :]
    wrong = [what for fault in faults for what in play.violations(*fault)]
    assert not wrong, "\n".join(wrong)
