"""Stories of datasets, told by hypothesis: whatever happens, a folder is a finished dataset or is not there.

Commands are killed, interrupted, met by a full disk or watched where they stop, and people put files in the
way. model.py says what is expected, world.py what is seen.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from functools import wraps

import pytest
from helpers import FULL
from hypothesis import HealthCheck, Phase, seed, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
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

    def chosen(drawn: tuple[Life, int]) -> str:  # what is drawn does not depend on what a signal left
        story, number = drawn
        names = [name for name, place in story.world.places.items() if fits(place)] * 5 + ["x", "y", "z"]
        return names[number % len(names)]

    return st.tuples(st.runner(), st.integers(0, 999)).map(chosen)


HOLDS, EMPTY = (lambda place: place.holds), (lambda place: not place.holds)
PART, MINE = (lambda place: place.run), (lambda place: place.note or place.file)
STORE_EMPTY = lambda place: place.store and not place.holds and not place.note  # noqa: E731
STORE_USED = lambda place: place.store and (place.holds or place.run)  # noqa: E731
TWO = st.sampled_from(["AB", "BA", "AA"])
EDITED = places(lambda place: place.words)
ANYWHERE, DATASETS, OTHERS, PARTS_LEFT = map(places, (bool, HOLDS, EMPTY, PART))
NAMES, BY = st.sampled_from(sorted(EXPERIMENTS)), st.sampled_from(sorted(model.NAMES))
OPTIONS = st.sampled_from([(), ("--overwrite",)])
STORES = st.sampled_from(["", "z", "yz"])  # the places that are in a store
FAULT = st.sampled_from([*FAULTS, *KILLS, "SIGSTOP", "SIGSTOP", "none", "none"])


def some(fits: Callable[[Place], object]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """A rule for stories in which a place fits; else nothing is done, and what is drawn stays the same."""

    def of(action: Callable[..., None]) -> Callable[..., None]:
        @wraps(action)
        def act(story: Life, **drawn: object) -> None:
            if any(map(fits, story.world.places.values())):
                action(story, **drawn)

        return act

    return of


def moments(operations: int) -> st.SearchStrategy[Moment]:
    """A fault at one of the operations of a command, which has about so many; or none."""
    return st.tuples(FAULT, st.integers(1, operations))


class Life(RuleBasedStateMachine):
    """Three places, in which datasets come, change and go."""

    known: Known

    @initialize(stores=STORES, **dict.fromkeys("xyz", st.sampled_from(["A", "B", None])))
    def begin(self, stores: str, **starts: str | None) -> None:
        self.world = World(self.known, starts | dict.fromkeys(stores), stores)  # which begin empty

    def teardown(self) -> None:
        if hasattr(self, "world"):
            shutil.rmtree(self.world.home)

    def run(
        self, out: str, expected: Expected, moment: Moment, *args: object, made: Made | None = None
    ) -> None:
        paths = [self.world.address(str(arg)) if arg in ("x", "y", "z") else arg for arg in args]
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

    @rule(out=PARTS_LEFT, moment=moments(45))
    @some(PART)
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

    @rule(out=DATASETS, by=BY, moment=moments(12))
    @some(HOLDS)
    def split(self, out: str, by: str, moment: Moment) -> None:
        self.run(out, model.split(self.world.places[out], by), moment, "split", out, *model.options(by))

    @rule(source=DATASETS, out=OTHERS, by=BY, moment=moments(55))
    @some(HOLDS)
    def materialize(self, source: str, out: str, by: str, moment: Moment) -> None:
        expected = model.materialize(self.world.places[out], self.world.places[source], by)
        made = (str(expected.after.holds), None, expected.after.splits)
        args = ["split", source, *model.options(by), "--materialize", out]
        if source != out:
            self.run(out, expected, moment, *args, made=made)

    @rule(out=DATASETS, moment=moments(12))
    @some(HOLDS)
    def repair(self, out: str, moment: Moment) -> None:
        self.run(out, model.repair(self.world.places[out]), moment, "repair", out, "--workers", 1)

    @rule(out=EDITED, overwrite=st.booleans(), moment=moments(12))
    @some(HOLDS)
    def card(self, out: str, overwrite: bool, moment: Moment) -> None:
        expected = model.card(self.world.places[out], overwrite)
        self.run(out, expected, moment, "card", out, *["--overwrite"][: int(overwrite)])

    @rule(out=ANYWHERE, at=st.integers(1, 120))
    def two_replace(self, out: str, at: int) -> None:
        """While one writer has stopped somewhere, another begins: one of them is refused, or comes later."""
        place = self.world.places[out]
        first, second = (model.generate(place, name, ["--overwrite"]) for name in "AB")
        if first.codes != model.DONE or place.store:
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

    @rule(out=places(STORE_EMPTY), names=TWO, at=st.integers(1, 40), moment=moments(40))
    @some(STORE_EMPTY)
    def two_write(self, out: str, names: str, at: int, moment: Moment) -> None:
        """While one writer to a store has stopped somewhere, another begins, and may meet a fault."""
        place, forks = self.world.places[out], self.known.forks
        if not STORE_EMPTY(place) or place.refuses((names[0], names[0], frozenset())):
            return
        home, url = self.world.home, self.world.address(out)
        args = [["generate", self.config(name), "--quiet", "--workers", 1, "--out", url] for name in names]
        answers = []

        def meanwhile() -> None:
            answers.append(forks.run(*args[1], folder=home, mode=moment[0], at=moment[1]))

        answers.insert(0, forks.run(*args[0], folder=home, mode="SIGSTOP", at=at, meanwhile=meanwhile))
        self.world.settle(out, names, answers, moment[0])

    # What people do.

    @rule(out=DATASETS | OTHERS, name=st.sampled_from(["note.txt", "data/note.txt", "meta/note.txt"]))
    def leave_a_note(self, out: str, name: str) -> None:
        place, path = self.world.places[out], self.world.home / out / name
        if not place.file and not place.note and (place.holds or name == "note.txt"):
            path.parent.mkdir(exist_ok=True)
            path.write_text("mine")
            self.world.places[out] = replace(place, note=name)

    @rule(out=places(MINE))
    @some(MINE)
    def remove_what_is_mine(self, out: str) -> None:
        place, path = self.world.places[out], self.world.home / out
        if place.note or place.file:
            (path / place.note if place.note else path).unlink()
        self.world.places[out] = replace(place, note=None, file=False)

    @rule(out=OTHERS, folder=st.booleans())
    @some(EMPTY)
    def take_the_place(self, out: str, folder: bool) -> None:
        path = self.world.home / out
        if not path.exists():
            folder = folder or self.world.places[out].store
            path.mkdir() if folder else path.write_text("mine")
            self.world.places[out] = replace(self.world.places[out], file=not folder)

    @rule(out=places(STORE_USED))
    @some(STORE_USED)
    def remove_from_a_store(self, out: str) -> None:
        if self.world.places[out].store:
            for name in (out, f".{out}.part"):
                shutil.rmtree(self.world.home / name, ignore_errors=True)
            self.world.places[out] = Place(store=True)

    @rule(out=DATASETS, words=st.integers(0, 999))
    @some(HOLDS)
    def edit_the_card(self, out: str, words: int) -> None:
        if self.world.places[out].holds:
            card = self.world.home / out / "README.md"
            card.write_text(f"{card.read_text()}\nwords {words}\n")
            self.world.places[out] = replace(self.world.places[out], words=f"\nwords {words}\n")

    @rule(
        out=DATASETS,
        number=st.integers(0, 99),
        at=st.integers(0, 10**6),
        how=st.sampled_from(["change", "cut", "remove"]),
    )
    @some(HOLDS)
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

    @rule(out=DATASETS)
    @some(HOLDS)
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


@pytest.mark.faults
@pytest.mark.parametrize("fault", ["before", "after", "EIO", "SIGTERM"])
def test_every_request_to_a_store(known, fault: str) -> None:
    """Each meets a fault; then another experiment is refused or takes the place, and the same one goes on."""
    for at in range(1, 41):
        world = World(known, {"z": None}, "z")
        for name, moment in (("A", (fault, 2 * at)), ("B", ("none", 0)), ("A", ("none", 0))):
            args = ["generate", known.folder / f"{name}.yaml", "--quiet", "--workers", 1]
            expected = model.generate(world.places["z"], name, [])
            world.run(
                "z", expected, moment, *args, "--out", world.address("z"), made=(name, name, frozenset())
            )
        assert world.places["z"].holds
        shutil.rmtree(world.home)
