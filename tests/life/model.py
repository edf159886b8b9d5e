"""What a place for a dataset holds, and what each command is expected to answer and to leave there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import wraps
from typing import NamedTuple, ParamSpec

MANIFEST, LABELS = "meta/manifest.json", "meta/splits.json"
NAMES = {"episode": {"train", "test"}, "policy": {"random", "safe"}}  # of the splits by episode and by policy


def options(by: str) -> list[str]:
    """Those of the command `split`."""
    return ["--by", by, *(["fractions=[0.5, 0.5]"] if by == "episode" else [])]


Made = tuple[str, str | None, frozenset[str]]  # a dataset: its content, experiment and splits


class Run(NamedTuple):
    """An unfinished run: what it makes, and how many of its shards are finished."""

    made: Made
    done: int
    shards: int


@dataclass(frozen=True)
class Place:
    """What is known of one place; the default is that nothing is there."""

    holds: str | None = None  # the name of its content root: A, B, AB or BA
    experiment: str | None = None  # that makes it; none makes a merged dataset, or a copy with other files
    splits: frozenset[str] = frozenset()
    declared: frozenset[str] = frozenset()
    damaged: frozenset[str] = frozenset()
    store: bool = False  # at a URL, and no folder
    part: bool = False  # whether a hidden part is beside it
    run: Run | None = None  # which is in the part; a published one, or one without a shard, is rubbish
    file: bool = False  # of a user, in the place of the folder
    note: str | None = None  # a user's file inside
    words: str | None = None  # that a user has added to the card

    def refuses(self, made: Made) -> bool:
        """Whether the run of another dataset is in the way of this one."""
        return self.run is not None and self.run.made != made

    def made(self, holds: str, experiment: str | None, splits: frozenset[str] = frozenset()) -> Place:
        """A new dataset here, with the declared splits."""
        return Place(holds, experiment, splits, splits, store=self.store)


class Expected(NamedTuple):
    """The exit codes that a command may have, and the place after exit code 0."""

    codes: frozenset[int]
    after: Place


P = ParamSpec("P")
DONE, USAGE, NO, ANY = (frozenset(codes) for codes in ((0,), (2,), (1, 2, 3), (0, 1, 2, 3)))


def generate(place: Place, experiment: str, flags: Sequence[str]) -> Expected:
    """A whole dataset; what is there stays unless --overwrite is said, and nobody's files are deleted."""
    overwrite = "--overwrite" in flags
    if place.store and overwrite:
        return Expected(USAGE, place)
    codes, after = DONE, place.made(experiment, experiment)
    if place.file:
        codes = USAGE
    elif place.holds and not overwrite:
        after = place
        codes = DONE if place.experiment == experiment else USAGE
    elif place.note or (not overwrite and place.refuses((experiment, experiment, frozenset()))):
        codes = USAGE
    if (place.damaged and not overwrite) or MANIFEST in place.damaged:  # it may not be told whose it is
        codes = NO if codes == USAGE else ANY
    return Expected(codes, after)


def generate_range(place: Place, experiment: str) -> Expected:
    """Some shards, where nobody has others."""
    if place.holds:
        codes = DONE if place.experiment == experiment else USAGE
        return Expected(ANY if place.damaged else codes, place)
    other = place.refuses((experiment, experiment, frozenset()))
    codes = USAGE if place.file or place.note or other else DONE
    if place.store and place.note and not other:
        codes = DONE | USAGE  # where a publication was killed, its files are not told from a user's yet
    return Expected(codes, replace(place))


def finalize(place: Place) -> Expected:
    """The dataset of the run, if its shards are all finished."""
    if place.holds:  # an unfinished replacement is never finished unasked
        return Expected(ANY if place.damaged or place.part else DONE, place)
    if not place.run or place.file or place.note:
        return Expected(NO, place)
    run = place.run
    return Expected(DONE if run.done == run.shards else NO, place.made(*run.made))


def in_folders(command: Callable[P, Expected]) -> Callable[P, Expected]:
    """A command that refuses every place in a store."""

    @wraps(command)
    def expected(*args: P.args, **kwargs: P.kwargs) -> Expected:
        place, *others = args
        assert isinstance(place, Place)
        each = [place, *others, *(each for other in others if isinstance(other, list) for each in other)]
        if any(isinstance(one, Place) and one.store for one in each):
            return Expected(USAGE, place)
        return command(*args, **kwargs)

    return expected


def new(place: Place, after: Place, sources: Sequence[Place]) -> Expected:
    """A dataset from others, where nothing is yet."""
    if not all(source.holds for source in sources):
        return Expected(NO, place)
    made = str(after.holds), None, after.splits
    if place.file or place.note or place.holds or place.refuses(made):
        return Expected(NO, place)
    return Expected(ANY if any(source.damaged for source in sources) else DONE, after)


@in_folders
def merge(place: Place, sources: Sequence[Place]) -> Expected:
    """A dataset of all rows, whose splits have files."""
    holds = "".join(source.holds or "" for source in sources)
    splits = frozenset[str]().union(*(source.splits for source in sources))
    expected = new(place, place.made(holds, None, splits), sources)
    return expected if len(set(holds)) == len(holds) else Expected(NO, place)


@in_folders
def materialize(place: Place, source: Place, by: str) -> Expected:
    """A copy whose splits have files."""
    labelled = split(source, by)
    expected = new(place, place.made(str(source.holds), None, labelled.after.splits), [source])
    return expected if 0 in labelled.codes else Expected(NO, place)


@in_folders
def split(place: Place, by: str) -> Expected:
    """Labels, where no split of that name was declared."""
    if not place.holds or NAMES[by] & place.declared:
        return Expected(NO, place)
    return Expected(ANY if place.damaged else DONE, replace(place, splits=place.splits | NAMES[by]))


@in_folders
def card(place: Place, overwrite: bool) -> Expected:
    """A new card; without --overwrite not over a user's words, and perhaps not over one of other splits."""
    codes = DONE if overwrite else USAGE if place.words else DONE | USAGE
    return Expected(NO if not place.holds else ANY if place.damaged else codes, replace(place, words=None))


@in_folders
def repair(place: Place) -> Expected:
    """The dataset, whole; not without its manifest. Labels that were lost stay lost."""
    if not place.holds or MANIFEST in place.damaged:
        return Expected(NO, place)
    splits = place.declared if LABELS in place.damaged else place.splits
    needed = {"meta/experiment.yaml"} & place.damaged
    return Expected(ANY if needed or place.note else DONE, replace(place, damaged=frozenset(), splits=splits))
