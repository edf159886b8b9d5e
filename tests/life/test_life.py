"""Stories of datasets, told by hypothesis: whatever happens, a folder is a finished dataset or is not there.

Commands are killed, interrupted, met by a full disk or watched where they stop, and people put files in the
way. model.py says what is expected, world.py what is seen.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import replace

import pytest
from helpers import FULL
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    precondition,
    rule,
    run_state_machine_as_test,
)
from life import model
from life.model import Expected, Made, Place
from life.world import EXPERIMENTS, FAULTS, KILLS, Known, Moment, World

STEPS = 25 if FULL else 15  # of a story
PARTS = 4  # of the many stories, for as many processes of pytest
USERS = {"README.md", "report.html"}  # files that the manifest does not list


def places(fits: Callable[[Place], object]) -> st.SearchStrategy[str]:
    """The name of a place, most often of one that fits."""

    def found(story: Life) -> st.SearchStrategy[str]:
        names = [name for name, place in story.world.places.items() if fits(place)]
        return st.sampled_from(names * 5 + ["x", "y", "z"])

    return st.runner().flatmap(found)


HOLDS, EMPTY = (lambda place: place.holds), (lambda place: not place.holds)
PART, MINE = (lambda place: place.run), (lambda place: place.note or place.file)
EDITED = places(lambda place: place.words)
ANYWHERE, DATASETS, OTHERS, PARTS_LEFT = map(places, (bool, HOLDS, EMPTY, PART))
NAMES, BY = st.sampled_from(sorted(EXPERIMENTS)), st.sampled_from(sorted(model.NAMES))
OPTIONS = st.sampled_from([(), ("--overwrite",)])
FAULT = st.sampled_from([*FAULTS, *KILLS, "SIGSTOP", "SIGSTOP", "none", "none"])


def some(fits: Callable[[Place], object]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A rule for stories in which a place fits."""
    return precondition(lambda story: any(map(fits, story.world.places.values())))


def moments(operations: int) -> st.SearchStrategy[Moment]:
    """A fault at one of the operations of a command, which has about so many; or none."""
    return st.tuples(FAULT, st.integers(1, operations))


class Life(RuleBasedStateMachine):
    """Three places, in which datasets come, change and go."""

    known: Known

    @initialize(**dict.fromkeys("xyz", st.sampled_from(["A", "B", None])))
    def begin(self, **starts: str | None) -> None:
        self.world = World(self.known, starts)

    def teardown(self) -> None:
        if hasattr(self, "world"):
            shutil.rmtree(self.world.home)

    def run(
        self, out: str, expected: Expected, moment: Moment, *args: object, made: Made | None = None
    ) -> None:
        paths = [self.world.home / str(arg) if arg in ("x", "y", "z") else arg for arg in args]
        self.world.run(out, expected, moment, *paths, made=made)

    def config(self, name: str) -> object:
        return self.known.folder / f"{name}.yaml"

    @rule(name=NAMES, out=ANYWHERE | OTHERS | PARTS_LEFT, options=OPTIONS, moment=moments(90))
    def generate(self, name: str, out: str, options: tuple[str, ...], moment: Moment) -> None:
        expected = model.generate(self.world.places[out], name, options)
        args = ["generate", self.config(name), "--quiet", "--workers", 1, "--out", out, *options]
        self.run(out, expected, moment, *args, made=(name, name, frozenset()))

    @rule(name=NAMES, out=OTHERS | PARTS_LEFT, i=st.integers(1, 2), moment=moments(40))
    def generate_range(self, name: str, out: str, i: int, moment: Moment) -> None:
        expected = model.generate_range(self.world.places[out], name)
        args = ["generate", self.config(name), "--workers", 1, "--out", out, "--shards", f"{i}/2"]
        self.run(out, expected, moment, *args, made=(name, name, frozenset()))

    @some(PART)
    @rule(out=PARTS_LEFT, moment=moments(45))
    def finalize(self, out: str, moment: Moment) -> None:
        place = self.world.places[out]
        made = place.run.made if place.run else None
        self.run(out, model.finalize(place), moment, "finalize", out, made=made)

    @rule(sources=st.permutations("xyz"), moment=moments(75))
    def merge(self, sources: list[str], moment: Moment) -> None:
        *parts, out = sources
        expected = model.merge(self.world.places[out], [self.world.places[name] for name in parts])
        made = (str(expected.after.holds), None, expected.after.splits)
        self.run(out, expected, moment, "merge", *parts, "--out", out, made=made)

    @some(HOLDS)
    @rule(out=DATASETS, by=BY, moment=moments(12))
    def split(self, out: str, by: str, moment: Moment) -> None:
        self.run(out, model.split(self.world.places[out], by), moment, "split", out, *model.options(by))

    @some(HOLDS)
    @rule(source=DATASETS, out=OTHERS, by=BY, moment=moments(55))
    def materialize(self, source: str, out: str, by: str, moment: Moment) -> None:
        expected = model.materialize(self.world.places[out], self.world.places[source], by)
        made = (str(expected.after.holds), None, expected.after.splits)
        args = ["split", source, *model.options(by), "--materialize", out]
        if source != out:
            self.run(out, expected, moment, *args, made=made)

    @some(HOLDS)
    @rule(out=DATASETS, moment=moments(12))
    def repair(self, out: str, moment: Moment) -> None:
        self.run(out, model.repair(self.world.places[out]), moment, "repair", out, "--workers", 1)

    @some(HOLDS)
    @rule(out=EDITED, overwrite=st.booleans(), moment=moments(12))
    def card(self, out: str, overwrite: bool, moment: Moment) -> None:
        expected = model.card(self.world.places[out], overwrite)
        self.run(out, expected, moment, "card", out, *["--overwrite"][: int(overwrite)])

    @rule(out=ANYWHERE, at=st.integers(1, 120))
    def two_replace(self, out: str, at: int) -> None:
        """While one writer has stopped somewhere, another begins: one of them is refused, or comes later."""
        place = self.world.places[out]
        first, second = (model.generate(place, name, ["--overwrite"]) for name in "AB")
        if first.codes != model.DONE:
            return
        args = [
            ["generate", self.config(name), "--quiet", "--out", self.world.home / out, "--overwrite"]
            for name in "AB"
        ]
        answers = []
        meanwhile = lambda: answers.append(self.known.forks.run(*args[1]))  # noqa: E731
        self.world.places[out] = replace(place, part=False, run=None)
        answers.append(
            self.known.forks.run(*args[0], folder=self.world.home, mode="SIGSTOP", at=at, meanwhile=meanwhile)
        )
        assert {answer.code for answer in answers} <= {0, 75}, answers
        root = self.known.roots["A"]
        seen = self.world.seen(out)
        self.world.places[out] = first.after if seen and seen[0] == root else second.after
        assert answers[-1].code == 0 or (seen and seen[0] != root), answers
        self.world.check_all()

    # What people do.

    @rule(out=DATASETS | OTHERS, name=st.sampled_from(["note.txt", "data/note.txt", "meta/note.txt"]))
    def leave_a_note(self, out: str, name: str) -> None:
        place, path = self.world.places[out], self.world.home / out / name
        if not place.file and not place.note and (place.holds or name == "note.txt"):
            path.parent.mkdir(exist_ok=True)
            path.write_text("mine")
            self.world.places[out] = replace(place, note=name)

    @some(MINE)
    @rule(out=places(MINE))
    def remove_what_is_mine(self, out: str) -> None:
        place, path = self.world.places[out], self.world.home / out
        if place.note or place.file:
            (path / place.note if place.note else path).unlink()
        self.world.places[out] = replace(place, note=None, file=False)

    @some(EMPTY)
    @rule(out=OTHERS, folder=st.booleans())
    def take_the_place(self, out: str, folder: bool) -> None:
        path = self.world.home / out
        if not path.exists():
            path.mkdir() if folder else path.write_text("mine")
            self.world.places[out] = replace(self.world.places[out], file=not folder)

    @some(HOLDS)
    @rule(out=DATASETS, words=st.integers(0, 999))
    def edit_the_card(self, out: str, words: int) -> None:
        if self.world.places[out].holds:
            card = self.world.home / out / "README.md"
            card.write_text(f"{card.read_text()}\nwords {words}\n")
            self.world.places[out] = replace(self.world.places[out], words=f"\nwords {words}\n")

    @some(HOLDS)
    @rule(
        out=DATASETS,
        number=st.integers(0, 99),
        at=st.integers(0, 10**6),
        how=st.sampled_from(["change", "cut", "remove"]),
    )
    def damage(self, out: str, number: int, at: int, how: str) -> None:
        place, folder = self.world.places[out], self.world.home / out
        hidden = {name for name in self.world.files(out) if "/." in f"/{name}"}
        whole = sorted({*self.world.files(out)} - place.damaged - USERS - {place.note} - hidden)
        if place.holds and whole:
            path = folder / whole[number % len(whole)]
            data = bytearray(path.read_bytes())
            at %= len(data)
            data[at] ^= 0xFF  # neither text nor JSON
            path.unlink()
            if how != "remove":
                path.write_bytes(data if how == "change" else data[: at // 2])  # not the last newline only
            self.world.places[out] = replace(place, damaged=place.damaged | {whole[number % len(whole)]})

    @some(HOLDS)
    @rule(out=DATASETS)
    def read(self, out: str) -> None:
        self.world.read_now(out)


@pytest.fixture(scope="session")
def known(forks, tmp_path_factory):
    """What all stories share."""
    return Known(forks, tmp_path_factory.mktemp("known"))


def tell(known: Known, number: int, stories: int) -> None:
    """Tell so many stories, the same ones every time; hypothesis prints one that goes wrong."""
    how = settings(
        database=None,
        deadline=None,
        max_examples=stories,
        stateful_step_count=STEPS,
        phases=[Phase.generate],
        print_blob=False,
        suppress_health_check=list(HealthCheck),
    )
    run_state_machine_as_test(seed(number)(type("Life", (Life,), {"known": known})), settings=how)


def test_a_few_stories(known) -> None:
    """No command, kill, damage or reader of four stories finds anything but a whole dataset or none."""
    tell(known, 0, 4)


@pytest.mark.faults
@pytest.mark.parametrize("part", range(1, PARTS + 1))
def test_many_stories(known, part: int) -> None:
    """Nor of a hundred, of which every process tells a part."""
    tell(known, part, int(os.environ.get("IBDATA_STORIES", "100")) // PARTS)
