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

    def __init__(self, known: Known, starts: dict[str, str | None]) -> None:
        self.known, self.home = known, Path(tempfile.mkdtemp(prefix="ibdata-life-"))
        self.places = {name: Place(start, start) for name, start in starts.items()}
        self.killed: set[str] = set()  # places at which a kill may have left a temporary file
        self.checked: dict[str, object] = {}
        for name, start in starts.items():
            if start:
                shutil.copytree(known.folder / start, self.home / name)

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
        readers = opened(self.home / out) if mode == "SIGSTOP" else {}
        wanted = {place.holds, expected.after.holds} - {None}

        def stopped() -> None:
            self.read(opened(self.home / out), wanted, place, place.holds is not None)
            meanwhile()

        answer = self.known.forks.run(*args, folder=self.home, mode=mode, at=moment[1], meanwhile=stopped)
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
        return {problem.path for problem in ibdata.validate(self.home / out)} - {self.places[out].note}

    def seen(self, out: str) -> tuple[str, set[str]] | None:
        """Content root and splits; None where nothing can be opened."""
        try:
            found = ibdata.open(self.home / out)
            return found.content_root, set(found.splits)
        except Exception:  # whatever is wrong with it
            return None

    def part(
        self, out: str, after: Place, answer: Answer, mode: str, made: Made | None, overwrite: bool
    ) -> tuple[bool, Run | None]:
        """Whether a part is beside a place now, and the unfinished run in it, which `ibdata ls` shows."""
        folder, was = self.home / f".{out}.part", self.places[out].run
        run = self.unfinished(folder / "run")
        is_new = made is not None and after.holds == made[0]
        kept = was is None or (run is not None and run.made == was.made and run.done >= was.done)
        dropped = overwrite and was is not None and was.made != made
        assert kept or dropped or is_new, "lost shards"
        assert not (answer.code == 0 and is_new and after is not self.places[out] and folder.exists()), (
            "a part is left"
        )
        assert not folder.exists() or run or mode != "none" or self.places[out].part, "a part of no use"
        if run:
            listed = self.known.forks.run("ls", self.home, "--json")
            assert listed.code == 0, listed
            states = [
                each["state"] for each in json.loads(listed.output)["datasets"]
                if each["path"] == str(folder / "run")
            ]  # fmt: skip
            assert states == [f"unfinished, {run.done} of {run.shards} shards"], "ls"
        return folder.exists(), run

    def unfinished(self, folder: Path) -> Run | None:
        """The run in a folder, if it has shards and is not published."""
        try:
            note = json.loads((folder / "run.json").read_bytes()[:-32])
            done = len(os.listdir(folder / "receipts"))
        except FileNotFoundError:
            return None
        if note.get("manifest"):
            with suppress(FileNotFoundError):
                listed = json.loads((folder / "dataset" / MANIFEST).read_bytes())
                done = done if listed["checksum"] == note["manifest"] else 0
            done = done if (folder / "dataset").exists() else 0
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
            assert values is None or tuple(sorted(values)) in known, f"{name} finds a mixture"

    def read_now(self, out: str) -> None:
        """Read a place at rest."""
        place = self.places[out]
        self.read(opened(self.home / out), {place.holds} - {None}, place, place.holds is not None)

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
            assert self.files(out) == ([place.note] if place.note else []), "files without a dataset"
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
