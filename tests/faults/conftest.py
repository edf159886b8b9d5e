"""Fixtures for fault tests: experiments with many shards, runs, and checks after them."""

import contextlib
import os
import random
import subprocess
from pathlib import Path

import pytest
from helpers.folders import part_of, receipts

import ibdata

EXPERIMENT = (
    "name: x\nsetpoints: {}\npolicies: [random]\nepisodes: {}\nsteps: {}\noutput: {{shard_rows: {}}}\n"
)
EXPERIMENTS = {
    "many": EXPERIMENT.format([10, 30, 50, 70, 90], 40, 50, 100),
    "tiny": EXPERIMENT.format([10, 50], 2, 10, 20),
}


class Tools:
    """Sizes, folders and checks; the seed of its random numbers is fixed."""

    def __init__(self, command, where):
        self.command, self.where = command, where
        self.full = os.environ.get("IBDATA_FAULTS") == "full"
        self.random = random.Random(20260101)
        self.many, self.tiny = (self.file(f"{name}.yaml", text) for name, text in EXPERIMENTS.items())

    def size(self, short, full):
        """How many cases: fewer in CI."""
        return full if self.full else short

    def file(self, name, text):
        """A file beside the datasets."""
        path = self.where / name
        path.write_text(text, encoding="utf-8")
        return path

    def args(self, config, out, *more):
        """The arguments of a quiet `ibdata generate` with one worker, unless `more` says otherwise."""
        return [str(arg) for arg in ("generate", "--quiet", config, "--out", out, "--workers", 1, *more)]

    def generate(self, config, out, *more, **options):
        """Run `ibdata generate` to its end."""
        args = [self.command, *self.args(config, out, *more)]
        return subprocess.run(args, capture_output=True, text=True, timeout=120, **options)

    def start(self, config, out, *more, **options):
        """Begin `ibdata generate`, its stderr in a pipe."""
        args = [self.command, *self.args(config, out, *more)]
        pipes = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "text": True}
        return subprocess.Popen(args, **pipes, **options)

    def root(self, folder):
        """The content root of a dataset that is whole, after everything was checked."""
        assert ibdata.validate(folder) == []
        dataset = ibdata.open(folder)
        assert dataset.table().num_rows == len(dataset)
        return dataset.content_root

    def leftovers(self, folder):
        """What is there besides a finished dataset: the part beside it, hidden and temporary files in it."""
        found = [path for path in folder.rglob("*") if path.name.startswith(".") or "tmp" in path.name]
        return sorted(path.name for path in [*found, part_of(folder)] if os.path.lexists(path))

    def receipts(self, folder):
        """How many shards of an unfinished run are finished."""
        return len(receipts(folder))

    def one_line(self, text):
        """Whether a message is one line for people."""
        return len(text.splitlines()) == 1 and "Traceback" not in text and "a bug of ibdata" not in text

    def processes(self, mark):
        """Running processes whose environment or command line has the mark: ours, and what they started."""
        found = []
        for entry in Path("/proc").iterdir():
            with contextlib.suppress(OSError):
                if entry.name.isdigit() and (entry / "stat").read_text().rsplit(")", 1)[1].split()[0] != "Z":
                    text = (entry / "environ").read_bytes() + (entry / "cmdline").read_bytes()
                    found += [int(entry.name)] if mark.encode() in text else []
        return [number for number in found if number != os.getpid()]


@pytest.fixture
def tools(command, tmp_path):
    return Tools(command, tmp_path)


@pytest.fixture(scope="session")
def whole(command, tmp_path_factory):
    """The content root of `many`, of a run that nothing disturbed."""
    tools = Tools(command, tmp_path_factory.mktemp("whole"))
    made = tools.generate(tools.many, tools.where / "out")
    assert made.returncode == 0, made.stderr
    return tools.root(tools.where / "out")
