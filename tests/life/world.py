"""A folder with three places for datasets, in which commands run, and what is seen there."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

from helpers.forks import Answer, Forks
from helpers.readers import Rewards, opened, rewards
from life.model import LABELS, MANIFEST, Expected, Made, Place, Run

import ibdata

EXPERIMENT = """\
name: life
setpoints: {}
policies: [random, safe]
episodes: 2
steps: 3
seed: {}
output: {{shard_rows: 6}}
"""
EXPERIMENTS = {"A": EXPERIMENT.format(20, 0), "B": EXPERIMENT.format([30, 60], 1)}
KILLS = ("before", "after", "half")
SIGNALS = {"SIGINT": 130, "SIGTERM": 143, "SIGHUP": 129}
FAULTS = {**dict.fromkeys(KILLS, -9), **SIGNALS, "full": 1, "EIO": 1, "SIGSTOP": None, "none": None}
Moment = tuple[str, int]  # a fault, and the number of the operation that meets it
Readers = dict[str, Callable[[], Rewards | None]]


def noted(run: Path) -> dict[str, Any]:
    """What is in the note of a run."""
    return cast("dict[str, Any]", json.loads((run / "run.json").read_bytes()[:-32]))


def has_begun(run: Path) -> bool:
    """Whether somebody else may be making the first shard of a run, which therefore stays in a store."""
    note = noted(run) if (run / "run.json").exists() else {"manifest": "none"}
    return not note.get("manifest") and not any((run / "receipts").glob("*"))


def checksum(folder: Path) -> object:
    """That of a manifest."""
    return json.loads((folder / MANIFEST).read_bytes())["checksum"]


@dataclass
class Known:
    """What is made once: every dataset, its content root and rewards."""

    forks: Forks
    folder: Path
    roots: dict[str, str] = field(default_factory=dict)
    rewards: dict[str, Rewards] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, text in EXPERIMENTS.items():
            (self.folder / f"{name}.yaml").write_text(text, encoding="utf-8")
        for name in ("A", "B", "AB", "BA"):
            merge = ["merge", *(self.folder / part for part in name)]
            args = merge if len(name) > 1 else ["generate", self.folder / f"{name}.yaml", "--quiet"]
            answer = self.forks.run(*args, "--out", self.folder / name)
            assert answer.code == 0, answer
            self.roots[name] = ibdata.open(self.folder / name).content_root
            (self.rewards[name],) = {tuple(found or ()) for found in rewards(self.folder / name).values()}


class World:
    """The folder of one story."""

    def __init__(self, known: Known, starts: dict[str, str | None], stores: str) -> None:
        self.known, self.home = known, Path(tempfile.mkdtemp(prefix="ibdata-life-"))
        self.places = {name: Place(start, start, store=name in stores) for name, start in starts.items()}
        self.killed: set[str] = set()  # places at which a kill may have left a temporary file
        self.checked: dict[str, object] = {}
        for name, start in starts.items():
            if start:
                shutil.copytree(known.folder / start, self.home / name)

    def address(self, out: str) -> Path | str:
        """The path of a place, or its URL if it is in a store."""
        path = self.home / out
        return path.as_uri() if self.places[out].store else path

    def opened(self, out: str) -> Readers:
        """Readers of a place."""
        return opened(self.home / out, str(self.address(out)))

    def run(
        self,
        out: str,
        expected: Expected,
        moment: Moment,
        *args: object,
        made: Made | None = None,
        meanwhile: Callable[[], object] = lambda: None,
    ) -> None:
        """Run a command that writes at a place, perhaps with a fault, and check what it leaves."""
        place, before, mode = self.places[out], self.signature(out), moment[0]
        readers = self.opened(out) if mode == "SIGSTOP" else {}
        wanted = {place.holds, expected.after.holds} - {None}

        def stopped() -> None:
            self.read(self.opened(out), wanted, place, place.holds is not None)
            meanwhile()

        at = -(-moment[1] // 2) if place.store else moment[1]  # there are half as many operations
        answer = self.known.forks.run(*args, folder=self.home, mode=mode, at=at, meanwhile=stopped)
        try:
            after = self.outcome(out, answer, expected, mode)
            if after is place and answer.code != FAULTS[mode]:
                assert self.signature(out) == before, "something changed"
            self.read(readers, wanted, place)
            part, run = self.part(out, after, answer, mode, made, "--overwrite" in args)
            self.places[out] = replace(after, part=part, run=run)
            self.check_all()
        except AssertionError as error:
            raise AssertionError(f"{args} at {place}: expected {expected}, found {answer}: {error}") from None

    def outcome(self, out: str, answer: Answer, expected: Expected, mode: str) -> Place:
        """The place as a command left it, but for its part: as before, or as it was to be."""
        place, struck = self.places[out], answer.code == FAULTS[mode]
        if answer.code == -9:
            self.killed.add(out)
        else:
            assert answer.code == 0 or 0 < len(answer.output.splitlines()) < 4, "an error, after notices"
            assert "Traceback" not in answer.output
            assert "a bug of ibdata" not in answer.output
        assert struck or answer.code in expected.codes, "exit code"
        if answer.code == 0:
            return expected.after
        if not struck or not expected.after.holds or place.file:
            return place
        if expected.after.damaged != place.damaged and not place.damaged & {MANIFEST}:
            damaged = place.damaged & {*self.problems(out), LABELS}  # a repair mends file by file
            place = replace(place, damaged=damaged) if self.problems(out) else expected.after
        done = self.seen(out) == (self.known.roots[expected.after.holds], expected.after.splits)
        return expected.after if done and place.damaged == expected.after.damaged else place

    def problems(self, out: str) -> set[str | None]:
        """The files that are not whole; a user's note in data/ counts as one for other readers only."""
        return {problem.path for problem in ibdata.validate(self.address(out))} - {self.places[out].note}

    def seen(self, out: str) -> tuple[str, set[str]] | None:
        """Content root and splits; None where nothing can be opened."""
        try:
            found = ibdata.open(self.address(out))
            return found.content_root, set(found.splits)
        except Exception:  # whatever is wrong with it
            return None

    def part(
        self, out: str, after: Place, answer: Answer, mode: str, made: Made | None, overwrite: bool
    ) -> tuple[bool, Run | None]:
        """Whether a part is beside a place now, and the unfinished run in it, which `ibdata ls` shows."""
        folder, was, store = self.home / f".{out}.part", self.places[out].run, self.places[out].store
        runs = self.unfinished(out)
        assert len(runs) < 2, "two runs"
        path, run = next(iter(runs.items()), (None, None))
        is_new = made is not None and after.holds == made[0]
        kept = was is None or (run is not None and run.made == was.made and run.done >= was.done)
        dropped = overwrite and was is not None and was.made != made
        assert kept or dropped or is_new, "lost shards"
        done = answer.code == 0 and mode != "EIO"  # in which what is published cannot be removed yet
        rest = [each for each in folder.glob("*") if each != path and any(map(Path.is_file, each.rglob("*")))]
        assert not (store and done) or all(map(has_begun, rest)), f"left: {rest}"
        is_changed = answer.code == 0 and is_new and after is not self.places[out]
        assert store or not is_changed or not folder.exists(), "a part is left"
        assert not folder.exists() or run or mode != "none" or self.places[out].part, "a part of no use"
        if run:
            listed = self.known.forks.run("ls", self.home.as_uri() if store else self.home, "--json")
            assert listed.code == 0, listed
            states = [
                each["state"] for each in json.loads(listed.output)["datasets"]
                if each["path"] == (path.as_uri() if store else str(path))
            ]  # fmt: skip
            assert states == [f"unfinished, {run.done} of {run.shards} shards"], "ls"
        return folder.exists(), run

    def settle(self, out: str, names: str, answers: list[Answer], fault: str) -> None:
        """Check what two writers have left at a place in a store, of which the second met a fault.

        A dataset of one of them, or two runs that refuse each other, of which a user drops the first.
        """
        place, folder = self.places[out], self.home / f".{out}.part"
        codes = [answer.code for answer in answers]
        struck = codes[1:] == [FAULTS[fault]]
        self.killed |= {out} if codes[1:] == [-9] else set()
        seen, runs = self.seen(out), self.unfinished(out)
        known = {self.known.roots[name]: name for name in names}
        holds = known[seen[0]] if seen else None
        try:
            assert {*codes[: 2 - struck]} <= {0, 2, 75}, "exit codes"
            assert all(holds == name for name, code in zip(names, codes, strict=False) if code == 0), (
                "not there"
            )
            assert 0 in codes or struck, "both refused"
            assert names != "AA" or codes[0] == 0, "the same was refused"
            assert len(runs) < 2 or (not holds and struck), "two runs"
        except AssertionError as error:
            raise AssertionError(f"{names} at {place}: {error}: {answers}, {runs}") from None
        if len(runs) > 1:
            for name in names:
                config = self.known.folder / f"{name}.yaml"
                assert self.known.forks.run("generate", config, "--out", self.address(out)).code == 2
            assert self.known.forks.run("finalize", self.address(out)).code == 2
            for path, run in runs.items():
                if run.made[0] == names[0]:
                    shutil.rmtree(path)
            runs = self.unfinished(out)
        after = place.made(holds, holds) if holds else place
        self.places[out] = replace(after, part=folder.exists(), run=next(iter(runs.values()), None))
        self.check_all()

    def unfinished(self, out: str) -> dict[Path, Run]:
        """The folders of the runs beside a place that have shards and are not published.

        In a store, a run has another name for each experiment.
        """
        folders = sorted((self.home / f".{out}.part").glob("*/run.json"))
        runs = {note.parent: self.run_in(note.parent, self.home / out) for note in folders}
        return {folder: run for folder, run in runs.items() if run}

    def is_half_done(self, out: str) -> bool:
        """Whether a publication was killed in a store, and left files that are no dataset yet."""
        runs = self.unfinished(out) if self.places[out].store else []
        return any(noted(run).get("manifest") for run in runs) and MANIFEST not in self.files(out)

    def run_in(self, folder: Path, place: Path) -> Run | None:
        """The run in a folder, if it has shards and is not published."""
        note = noted(folder)
        done = len(os.listdir(folder / "receipts")) if (folder / "receipts").exists() else 0
        if note.get("manifest"):
            done = done if (folder / "dataset").exists() else 0
            with suppress(OSError, ValueError):
                done = 0 if checksum(place) == note["manifest"] else done
            with suppress(FileNotFoundError):
                done = done if checksum(folder / "dataset") == note["manifest"] else 0
        if not done:
            return None
        experiments = note["spec"]["experiments"]
        holds = "".join("AB"[experiment["seed"]] for experiment in experiments)
        splits = frozenset(name for experiment in experiments for name in experiment["splits"])
        whose: Made = (holds, holds if note.get("sources") is None else None, splits)
        return Run(whose, done, note["shards"])

    def read(self, readers: Readers, wanted: set[str | None], place: Place, must: bool = False) -> None:
        """Read by all readers: one of these datasets, or an error unless they must find one."""
        if place.damaged or (place.note or "").startswith("data/"):
            return
        for name, read in readers.items():
            values = read()
            assert values is not None or not must, f"{name} meets an error"
            known = [self.known.rewards[str(each)] for each in wanted]
            fits = values is None or tuple(sorted(values)) in known
            if place.store and not place.holds and name != "ibdata":  # who only looks at files is early
                known += [self.known.rewards[place.run.made[0]]] if place.run else []
                fits = fits or any({*(values or ())} <= {*each} for each in known)
            assert fits, f"{name} finds a mixture"

    def read_now(self, out: str) -> None:
        """Read a place at rest."""
        place = self.places[out]
        self.read(self.opened(out), {place.holds} - {None}, place, place.holds is not None)

    def files(self, out: str) -> list[str]:
        """All files of a folder."""
        folder = self.home / out
        return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())

    def signature(self, out: str) -> list[tuple[str, int, int, int]]:
        """What changes with any change of a folder."""
        paths = [path for path in (self.home / out, *sorted((self.home / out).rglob("*"))) if path.exists()]
        return [(str(p), p.stat().st_ino, p.stat().st_size, p.stat().st_mtime_ns) for p in paths]

    def check_all(self) -> None:
        """Nothing else lies beside the places, and every place that has changed is as expected."""
        names = {name for name in self.places if (self.home / name).exists()}
        assert set(os.listdir(self.home)) == names | {
            f".{name}.part" for name in self.places if self.places[name].part
        }
        for name, place in self.places.items():
            if self.checked.get(name) != (seen := (self.signature(name), place)):
                self.check(name, place)
                self.checked[name] = seen

    def check(self, out: str, place: Place) -> None:
        """A folder is there if and only if it is a finished dataset, whole unless somebody damaged it."""
        path = self.home / out
        if place.file:
            assert path.read_text() == "mine"
        elif not place.holds:
            found = [name for name in self.files(out) if name == place.note or not self.is_half_done(out)]
            assert found == ([place.note] if place.note else []), "files without a dataset"
        elif MANIFEST not in place.damaged:
            problems = self.problems(out)
            assert place.damaged - {LABELS} <= problems
            assert bool(place.damaged) == bool(problems), f"problems: {problems}"
            assert place.damaged or self.seen(out) == (self.known.roots[place.holds], place.splits), (
                "contents"
            )
            hidden = [name for name in self.files(out) if "/." in f"/{name}"]
            assert not hidden or out in self.killed, f"temporary files: {hidden}"
        assert not place.note or (path / place.note).read_text() == "mine"
        assert not place.words or place.words in (path / "README.md").read_text(), "a user's words are lost"
