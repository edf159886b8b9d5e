"""The life of datasets in one folder, told by hypothesis; see model.py for what is expected."""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from helpers.forks import Answer, Forks
from helpers.readers import opened, rewards
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

import ibdata
from life import model
from life.model import MANIFEST, SHARDS, USELESS, Expected, Part, Place

EXPERIMENT = (
    "name: story\nsetpoints: {}\npolicies: [random, safe]\nepisodes: 2\nsteps: 3\nseed: {}\n"
    "output: {{shard_rows: 3}}\n"
)
EXPERIMENTS = {"A": EXPERIMENT.format(20, 0), "B": EXPERIMENT.format([30, 60], 1)}
SIGNALS = {"SIGINT": 130, "SIGTERM": 143, "SIGHUP": 129}
FAULTS = {"before": -9, "after": -9, "half": -9, **SIGNALS, "full": 1, "EIO": 1, "SIGSTOP": 0}
USERS = {"README.md", "README.md.old", "report.html"}  # files that the manifest does not list

EXPERIMENT_NAMES = st.sampled_from(sorted(EXPERIMENTS))
STARTS = st.sampled_from(["A", "B", None])
PLACES = st.sampled_from("xyz")
FLAGS = st.sampled_from([(), ("--resume",), ("--overwrite",), ("--overwrite",), ("--resume", "--overwrite")])
AT = st.integers(1, 15) | st.integers(1, 120) | st.integers(50, 180)  # commands have 10 to 180 operations
MOMENTS = st.none() | st.tuples(st.sampled_from(sorted(FAULTS)), AT)
Moment = tuple[str, int] | None
Signature = list[tuple[str, int, int, int]]


@dataclass
class Known:
    """What is computed once: the commands' process, and each dataset's root and rewards."""

    forks: Forks
    folder: Path
    configs: dict[str, Path]
    roots: dict[str, str]
    rewards: dict[str, list[float]]
    figures: Counter[str]


def know(forks: Forks, folder: Path) -> Known:
    """Make each dataset once."""
    configs = {name: folder / f"{name}.yaml" for name in EXPERIMENTS}
    commands: dict[str, list[object]] = {}
    for name, text in EXPERIMENTS.items():
        configs[name].write_text(text, encoding="utf-8")
        commands[name] = ["generate", configs[name], "--quiet", "--workers", 1]
    for name in ("AB", "BA"):
        commands[name] = ["merge", *(folder / part for part in name)]
    for name, args in commands.items():
        answer = forks.run(*args, "--out", folder / name)
        assert answer.code == 0, answer
    roots = {name: ibdata.open(folder / name).content_root for name in commands}
    found = {name: rewards(folder / name) for name in commands}
    assert all(each == found[name]["ibdata"] for name in commands for each in found[name].values())
    return Known(forks, folder, configs, roots, {name: each["ibdata"] or [] for name, each in found.items()}, Counter())


def signature(path: Path) -> Signature:
    """What changes with any change of a folder."""
    stats = ((str(p.relative_to(path)), p.lstat()) for p in sorted([path, *path.rglob("*")]) if p.exists())
    return [(name, stat.st_ino, stat.st_size, stat.st_mtime_ns) for name, stat in stats]


class Life(RuleBasedStateMachine):
    """Three places, and commands that are killed, interrupted, or watched where they stop."""

    known: Known

    @initialize(x=STARTS, y=STARTS, z=STARTS)
    def begin(self, **starts: str | None) -> None:
        self.home = Path(tempfile.mkdtemp(prefix="ibdata-life-"))
        self.places = {name: Place(start, start) for name, start in starts.items()}
        self.checked: dict[str, tuple[Signature, Place]] = {}
        for name, start in starts.items():
            if start:
                shutil.copytree(self.known.folder / start, self.home / name)

    def teardown(self) -> None:
        if hasattr(self, "home"):
            shutil.rmtree(self.home)

    # The commands.

    @rule(experiment=EXPERIMENT_NAMES, out=PLACES, flags=FLAGS, moment=MOMENTS)
    def generate(self, experiment: str, out: str, flags: tuple[str, ...], moment: Moment) -> None:
        args = ["generate", self.known.configs[experiment], "--out", self.home / out, *flags]
        self.run(out, model.generate(self.places[out], experiment, flags), moment, *args, experiment=experiment)

    @rule(experiment=EXPERIMENT_NAMES, out=PLACES, i=st.integers(1, 2), moment=MOMENTS)
    def generate_range(self, experiment: str, out: str, i: int, moment: Moment) -> None:
        args = ["generate", self.known.configs[experiment], "--out", self.home / out, "--shards", f"{i}/2"]
        self.run(
            out, model.generate_range(self.places[out], experiment), moment, *args, experiment=experiment
        )

    @rule(out=PLACES, moment=MOMENTS)
    def finalize(self, out: str, moment: Moment) -> None:
        part = self.places[out].part or USELESS
        expected = model.finalize(self.places[out])
        self.run(out, expected, moment, "finalize", self.home / out, experiment=part.experiment)

    @rule(sources=st.permutations("xyz"), moment=MOMENTS)
    def merge(self, sources: list[str], moment: Moment) -> None:
        *sources, out = sources
        expected = model.merge(self.places[out], [self.places[name] for name in sources])
        folders = [self.home / name for name in sources]
        self.run(out, expected, moment, "merge", *folders, "--out", self.home / out)

    @rule(out=PLACES, by=st.sampled_from(sorted(model.NAMES)), moment=MOMENTS)
    def split(self, out: str, by: str, moment: Moment) -> None:
        self.run(out, model.split(self.places[out], by), moment, "split", self.home / out, *self.by(by))

    @rule(places=st.permutations("xyz"), by=st.sampled_from(sorted(model.NAMES)), moment=MOMENTS)
    def materialize(self, places: list[str], by: str, moment: Moment) -> None:
        source, out = places[:2]
        expected = model.materialize(self.places[out], self.places[source], by)
        args = ["split", self.home / source, *self.by(by), "--materialize", self.home / out]
        self.run(out, expected, moment, *args)

    @rule(out=PLACES, moment=MOMENTS)
    def repair(self, out: str, moment: Moment) -> None:
        self.run(out, model.repair(self.places[out]), moment, "repair", self.home / out, "--workers", 1)

    @rule(out=PLACES, moment=MOMENTS)
    def card(self, out: str, moment: Moment) -> None:
        self.run(out, model.card(self.places[out]), moment, "card", self.home / out)

    # What people do to folders.

    @rule(out=PLACES, name=st.sampled_from(["note.txt", "data/note.txt", "meta/note.txt"]))
    def leave_a_note(self, out: str, name: str) -> None:
        place, path = self.places[out], self.home / out / name
        if not place.file and not place.note and (place.holds or name == "note.txt"):
            path.parent.mkdir(exist_ok=True)
            path.write_text("mine")
            self.places[out] = replace(place, note=name)

    @rule(out=PLACES)
    def remove_what_is_mine(self, out: str) -> None:
        place, path = self.places[out], self.home / out
        if place.note:
            (path / place.note).unlink()
        if place.file:
            path.unlink()
        self.places[out] = replace(place, note=None, file=False)

    @rule(out=PLACES, folder=st.booleans())
    def put_a_file_or_an_empty_folder(self, out: str, folder: bool) -> None:
        if not (self.home / out).exists():
            (self.home / out).mkdir() if folder else (self.home / out).write_text("mine")
            self.places[out] = replace(self.places[out], file=not folder)

    @rule(out=PLACES, words=st.integers(0, 999))
    def edit_the_card(self, out: str, words: int) -> None:
        if self.places[out].holds:
            card = self.home / out / "README.md"
            card.write_text(f"{card.read_text()}\nwords {words}\n")
            self.places[out] = replace(self.places[out], words=f"\nwords {words}\n")

    @rule(
        out=PLACES,
        number=st.integers(0, 99),
        at=st.integers(0, 10**6),
        how=st.sampled_from(["change", "change", "cut", "remove"]),
    )
    def damage(self, out: str, number: int, at: int, how: str) -> None:
        place, folder = self.places[out], self.home / out
        whole = [name for name in self.files(out) if name not in {*place.damaged, *USERS, place.note}]
        if not place.holds or not whole:
            return
        name = whole[number % len(whole)]
        data = bytearray((folder / name).read_bytes())
        at %= len(data)
        data[at] ^= 0xFF  # neither text nor JSON
        (folder / name).unlink()
        if how != "remove":
            (folder / name).write_bytes(data if how == "change" else data[:at])
        self.places[out] = replace(place, damaged=place.damaged | {name})

    # How a command is run, and what is seen.

    def by(self, by: str) -> list[str]:
        return ["--by", by, *(["--fractions", "0.5,0.5"] if by == "episode" else [])]

    def files(self, out: str) -> list[str]:
        folder = self.home / out
        return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())

    def run(
        self, out: str, expected: Expected, moment: Moment, *args: object, experiment: str | None = None
    ) -> None:
        """Run a command, perhaps with a fault, and find out what it left."""
        place, before = self.places[out], signature(self.home / out)
        mode, at = moment or ("none", 0)
        readers = opened(self.home / out) if mode == "SIGSTOP" else {}
        look: Callable[[], None] = lambda: self.look(out, place, expected.after)  # noqa: E731
        answer = self.known.forks.run(*args, folder=self.home, at=at, mode=mode, meanwhile=look)
        self.known.figures[f"exit code {answer.code}"] += 1
        self.known.figures["commands"] += 1
        story = f"{args}: expected {expected}, had {place}, found {answer}"
        after = self.outcome(answer, expected, place, mode, out, story)
        if after is place and answer.code in expected.codes and answer.code != FAULTS.get(mode):
            assert signature(self.home / out) == before, f"changed: {story}"
        self.read(readers, {name for name in (place.holds, after.holds) if name}, place, False)
        self.places[out] = replace(after, part=self.part(out, place, after, answer, experiment, mode, story))
        self.check_all()

    def outcome(
        self, answer: Answer, expected: Expected, place: Place, mode: str, out: str, story: str
    ) -> Place:
        """The place as the command left it, but for its part."""
        disturbed = answer.code == FAULTS.get(mode) != 0
        if answer.code in expected.codes and not disturbed:
            assert answer.code == 0 or len(answer.output.splitlines()) == 1, story
            return expected.after if answer.code == 0 else place
        assert answer.code == FAULTS.get(mode), story
        if answer.code == 1:
            assert len(answer.output.splitlines()) == 1, story
            assert "a bug of ibdata" not in answer.output, story
        if mode in ("before", "after", "half"):
            self.known.figures["kills"] += 1
        return expected.after if self.is_as(out, expected.after, place) else place

    def is_as(self, out: str, after: Place, place: Place) -> bool:
        """Whether a command that did not end well has done what it was for."""
        if after.holds is None or place.file:
            return False
        if after.damaged != place.damaged:
            return not ibdata.validate(self.home / out)
        try:
            found = ibdata.open(self.home / out)
            return (found.content_root, set(found.splits)) == (self.known.roots[after.holds], after.splits)
        except Exception:
            return False

    def part(
        self,
        out: str,
        place: Place,
        after: Place,
        answer: Answer,
        experiment: str | None,
        mode: str,
        story: str,
    ) -> Part | None:
        """The unfinished run that is beside the place now."""
        if not (self.home / f".{out}.part").exists():
            assert place.part is None or answer.code != 2, f"the unfinished run is lost: {story}"
            return None
        listed = self.known.forks.run("ls", self.home, "--json")
        assert listed.code == 0, listed
        part = self.unfinished(json.loads(listed.output), out)
        before = place.part or USELESS
        if part == USELESS:
            assert mode != "none" or place.part == USELESS, f"a useless part is left: {story}"
        elif part != place.part:
            assert part.experiment == experiment, f"whose part? {story}"
            assert part.shards >= before.shards or before.experiment != experiment, f"shards lost: {story}"
        if answer.code == 0 and after != place and after.holds:
            raise AssertionError(f"a part is left of a run that is done: {story}")
        return part

    def unfinished(self, listed: dict[str, Any], out: str) -> Part:
        """The run that `ibdata ls` shows at a place."""
        for each in listed["datasets"]:
            state = re.fullmatch(r"unfinished, (\d+) of (\d+) shards", each["state"])
            if state and each["path"] == str(self.home / out):
                shards, total = map(int, state.groups())
                return Part(next((name for name in SHARDS if SHARDS[name] == total), None), shards)
        return USELESS

    def look(self, out: str, place: Place, after: Place) -> None:
        """Read a place while a writer has stopped: the old dataset, the new one, or none yet."""
        self.known.figures["looks"] += 1
        wanted = {name for name in (place.holds, after.holds) if name}
        self.read(opened(self.home / out), wanted, place, place.holds is not None)

    def read(
        self, readers: dict[str, Callable[[], Any]], wanted: set[str], place: Place, must: bool
    ) -> None:
        """Read by all readers."""
        if place.damaged or (place.note or "").startswith("data/"):
            return
        for name, read in readers.items():
            values = read()
            self.known.figures[f"{name} found {'an error' if values is None else 'rows'}"] += 1
            if values is None:
                assert not must, f"{name} meets an error"
            else:
                assert sorted(values) in [self.known.rewards[each] for each in wanted], f"{name}: a mixture"

    @rule(out=PLACES)
    def read_it(self, out: str) -> None:
        place = self.places[out]
        self.read(opened(self.home / out), {place.holds} - {None}, place, place.holds is not None)

    def check_all(self) -> None:
        """Nothing else lies beside the places, and every place that has changed is as expected."""
        names = {name for name, place in self.places.items() if (self.home / name).exists()}
        parts = {f".{name}.part" for name, place in self.places.items() if place.part}
        assert set(os.listdir(self.home)) == names | parts
        for name, place in self.places.items():
            seen = signature(self.home / name)
            if self.checked.get(name) != (seen, place):
                self.check(name, place)
                self.checked[name] = (seen, place)

    def check(self, out: str, place: Place) -> None:
        """One place."""
        path = self.home / out
        if place.file:
            assert path.read_text() == "mine"
        elif not place.holds:
            assert self.files(out) == ([place.note] if place.note else [])
        else:
            self.check_dataset(path, place)
        if place.note:
            assert (path / place.note).read_text() == "mine"
        if place.words:
            cards = [path / "README.md", path / "README.md.old"]
            assert any(place.words in card.read_text() for card in cards if card.exists()), "words are lost"

    def check_dataset(self, path: Path, place: Place) -> None:
        """A folder that exists is a finished dataset, which is whole unless somebody damaged it."""
        assert not [name for name in self.files(path.name) if "/." in f"/{name}" or "tmp" in name]
        if MANIFEST in place.damaged:
            return
        problems = {problem.path for problem in ibdata.validate(path)}
        if (place.note or "").startswith("data/"):  # where other readers would find it
            problems.remove(str(place.note))
        assert bool(problems) == bool(place.damaged), problems
        assert place.damaged - {model.LABELS} <= problems
        if not place.damaged:
            found = ibdata.open(path)
            assert (found.content_root, set(found.splits)) == (self.known.roots[place.holds], place.splits)
