"""Random sequences of runs, faults, damage and repair in one folder: a finished dataset is never corrupt."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule

import ibdata
from ibdata import Experiment
from ibdata.dataset import manifest
from ibdata.errors import BusyError, DatasetError, IbdataError, UsageError
from ibdata.maintenance.repair import repair
from ibdata.system.lock import NAME, locked
from ibdata.validation.validate import validate

pytestmark = pytest.mark.corpus

PLAIN = {
    "name": "story",
    "setpoints": [20.0, 70.0],
    "policies": [{"kind": "random"}],
    "episodes": 2,
    "steps": 3,
    "output": {"shard_rows": 3},
}
SEEDS = st.integers(0, 2)
POINTS = st.integers(0, 40)


def described(seed: int) -> Experiment:
    return Experiment.model_validate({**PLAIN, "seed": seed})


class Fault:
    """The k-th of the calls that make a file durable or move it raises; with `dead`, so do all after it.

    The first is a disk that is full for a moment. The second is as near to a kill as one process comes: what
    tidies up afterwards can neither move nor remove anything.
    """

    def __init__(self, point: int, dead: bool) -> None:
        self.left, self.dead, self.patch = point, dead, pytest.MonkeyPatch()

    def _failing(self, function: Callable) -> Callable:
        def call(*args, **options):
            self.left -= 1
            if self.left == -1 or (self.dead and self.left < 0):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            return function(*args, **options)

        return call

    def __enter__(self) -> Fault:
        for name in ("replace", "rename", "fsync"):
            self.patch.setattr(os, name, self._failing(getattr(os, name)))
        if self.dead:
            for name in ("unlink", "rmdir"):
                self.patch.setattr(os, name, self._after(getattr(os, name)))
        return self

    def _after(self, function: Callable) -> Callable:
        def call(*args, **options):
            # The lock of a process that is killed is free; here its removal is what frees it.
            if self.left < 0 and Path(args[0]).name != NAME:
                raise OSError(errno.EIO, os.strerror(errno.EIO))
            return function(*args, **options)

        return call

    def __exit__(self, *error: object) -> None:
        self.patch.undo()


class Folder(RuleBasedStateMachine):
    """`seed` is whose dataset counts, None where there is none; `unfinished` whose run can be resumed."""

    roots: dict[int, str] = {}  # noqa: RUF012  # filled once

    @initialize()
    def start(self) -> None:
        self.parent = Path(tempfile.mkdtemp(prefix="ibdata-story-"))
        self.folder = self.parent / "out"
        self.seed: int | None = None
        self.damaged: set[str] = set()
        for seed in range(3) if not self.roots else ():
            made = ibdata.generate(described(seed), self.parent / f"of-{seed}", workers=1)
            self.roots[seed] = made.content_root

    def teardown(self) -> None:
        if hasattr(self, "parent"):
            shutil.rmtree(self.parent)

    def finished(self) -> int | None:
        """Whose finished dataset the folder holds now, by its content root."""
        try:
            root = ibdata.open(self.folder).content_root
        except DatasetError:
            return None
        return next(seed for seed, known in self.roots.items() if known == root)

    @rule(seed=SEEDS)
    def generate(self, seed: int) -> None:
        empty = not self.folder.exists()
        try:
            made = ibdata.generate(described(seed), self.folder, workers=1)
        except UsageError:
            assert not empty
            return
        assert empty
        assert made.content_root == self.roots[seed]
        self.seed, self.damaged = seed, set()

    @rule(seed=SEEDS, point=POINTS, dead=st.booleans(), overwrite=st.booleans())
    def run_that_fails(self, seed: int, point: int, dead: bool, overwrite: bool) -> None:
        before, listed = self.finished(), manifest.PATH not in self.damaged
        try:
            with Fault(point, dead):
                ibdata.generate(
                    described(seed), self.folder, workers=1, overwrite=overwrite, resume=not overwrite
                )
        except IbdataError:
            pass  # the invariant says what may be left
        if not listed:
            return  # nothing may write to a dataset that cannot be told from a stranger's
        self.seed = self.finished()
        # The dataset before, or, where the run got past the point of no return, the one asked for.
        assert self.seed in ((before, seed) if overwrite or before is None else (before,))
        found = {problem.path for problem in validate(self.folder, quick=True)}
        self.damaged &= found  # what was replaced is whole

    @rule(seed=SEEDS)
    def resume(self, seed: int) -> None:
        before = self.finished()
        try:
            made = ibdata.generate(described(seed), self.folder, workers=1, resume=True)
        except (UsageError, DatasetError):
            return  # of another experiment, or its metadata are damaged
        assert made.content_root == self.roots[seed]
        if before is None:
            self.damaged = set()
        self.seed = seed

    @rule(seed=SEEDS)
    def overwrite(self, seed: int) -> None:
        broken = self.seed is not None and self.finished() is None
        try:
            made = ibdata.generate(described(seed), self.folder, workers=1, overwrite=True)
        except UsageError:
            # A folder without a manifest might be anyone's, and somebody may have edited the card.
            assert broken or "README.md" in self.damaged
            return
        assert made.content_root == self.roots[seed]
        self.seed, self.damaged = seed, set()

    @precondition(lambda self: self.seed is not None)
    @rule(number=st.integers(0, 99), place=st.integers(0, 10**6), bit=st.integers(0, 7))
    def flip(self, number: int, place: int, bit: int) -> None:
        # What a killed run left may be empty (a mark, a lock): it has no bit to flip.
        found = (path for path in self.folder.rglob("*") if ".run" not in str(path) and path.is_file())
        files = sorted(path for path in found if path.stat().st_size)
        path = files[number % len(files)]
        data = bytearray(path.read_bytes())
        data[place % len(data)] ^= 1 << bit
        path.write_bytes(data)
        self.damaged.add(path.relative_to(self.folder).as_posix())

    @precondition(lambda self: self.seed is not None)
    @rule(number=st.integers(0, 3))
    def delete_a_shard(self, number: int) -> None:
        path = f"data/part-{number:05d}.parquet"
        (self.folder / path).unlink(missing_ok=True)
        self.damaged.add(path)

    @precondition(lambda self: self.seed is not None)
    @rule()
    def mend(self) -> None:
        lost = {manifest.PATH, "meta/experiment.yaml"} & self.damaged
        try:
            repaired = repair(self.folder, workers=1)
        except IbdataError:
            assert manifest.PATH in lost
            assert len(lost) == 2 or all(f"data/part-{i:05d}.parquet" in self.damaged for i in range(4))
            return
        assert set(repaired) <= self.damaged
        self.damaged = set()

    @rule(overwrite=st.booleans(), seed=SEEDS)
    def second_writer(self, overwrite: bool, seed: int) -> None:
        self.folder.mkdir(exist_ok=True)
        before = {path: path.stat().st_mtime_ns for path in self.folder.rglob("*")}
        errors: list[type[Exception]] = []

        def write() -> None:
            try:
                ibdata.generate(described(seed), self.folder, workers=1, overwrite=overwrite)
            except IbdataError as error:
                errors.append(type(error))

        with locked(self.folder):
            thread = threading.Thread(target=write)
            thread.start()
            thread.join()
        assert errors == [BusyError]
        assert {path: path.stat().st_mtime_ns for path in self.folder.rglob("*")} == before
        if not before:
            self.folder.rmdir()

    @invariant()
    def what_counts_as_finished_is_whole(self) -> None:
        if not hasattr(self, "folder") or manifest.PATH in self.damaged:
            return
        assert self.finished() == self.seed
        if self.seed is None:
            return
        found = {problem.path for problem in validate(self.folder, quick=True)}
        assert found <= self.damaged
        if not self.damaged:
            assert validate(self.folder) == []
            assert len(ibdata.open(self.folder).table()) == 12


class TestFolder(Folder.TestCase):
    """Twenty-five stories of fifteen steps, the same ones every time."""

    settings = settings(
        derandomize=True,
        deadline=None,
        max_examples=25,
        stateful_step_count=15,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
