"""Several finished datasets read as one, with the rows that `ibdata.merge` would copy, in the same order."""

from __future__ import annotations

import re
from bisect import bisect
from collections.abc import Iterator, Sequence
from functools import cached_property
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from ibdata._numerics.naming import LIVE, decimal, exact
from ibdata._system.storage import Storage
from ibdata.dataset.digest import content_root
from ibdata.dataset.manifest import sealed
from ibdata.dataset.models import Counts, File, Info, ShardEntry, SplitEntry, Statistics
from ibdata.dataset.stored import Stored
from ibdata.errors import UsageError, excerpt, parameter

EXPERIMENT = re.compile(r"meta/experiment(?:-([0-9]+))?\.yaml")
REPRODUCIBLE = (False, "same-environment", True)  # the least first


def as_one(parts: Sequence[Stored]) -> Stored:
    """Datasets as one; one alone stays as it is. Raises UsageError for none, or if they cannot be merged."""
    each = [one for part in parts for one in (part.parts if isinstance(part, Several) else [part])]
    if not each:
        raise UsageError("path: found an empty list, expected at least one place")
    return Several(each) if len(each) > 1 else each[0]


class Several(Stored):
    """Datasets of which each goes on with the numbers of episodes, shards and experiments of the one before.

    Raises UsageError for datasets that cannot be merged.
    """

    def __init__(self, parts: Sequence[Stored]) -> None:
        refuse_unlike(parts)
        self.parts = parts
        self._firsts: list[tuple[int, int]] = []  # the numbers of the first shard and episode of each
        shards: list[ShardEntry] = []
        experiments: list[dict[str, Any]] = []
        files: dict[str, File] = {}
        for part in parts:
            first = shards[-1].episodes[1] if shards else 0
            self._firsts.append((len(shards), first))
            for shard in part.manifest.shards:
                numbers = [number + first for number in shard.episodes]
                update = {"experiment": shard.experiment + len(experiments), "episodes": numbers}
                shards.append(shard.model_copy(update=update))
            for file in part.manifest.files:
                number = EXPERIMENT.fullmatch(file.path)
                path = file.path
                if number:
                    path = f"meta/experiment-{len(experiments) + int(number[1] or 0):05d}.yaml"
                files[path] = file.model_copy(update={"path": path})
            experiments += part.manifest.experiments
        listed = [part.manifest for part in parts]
        columns = ((column.name, column.dtype) for column in parts[0].info.columns)
        cells, indices, digests = (self.episodes[name].to_pylist() for name in ("cell", "index", "digest"))
        update = {
            "content_root": content_root(
                columns, zip(map(bytes.fromhex, cells), indices, digests, strict=True)
            ),
            "name": "several",
            "experiments": experiments,
            "rows": sum(one.rows for one in listed),
            "clipped_actions": sum(one.clipped_actions for one in listed),
            "shards": shards,
            "files": list(files.values()),
            "reproducible": min((one.reproducible for one in listed), key=REPRODUCIBLE.index),
            "code": [code for one in listed for code in one.code],
        }
        self.manifest = sealed(listed[0].model_copy(update=update))

    @property
    def name(self) -> str:
        return f"{self.parts[0].name} and {len(self.parts) - 1} more"

    @property
    def storage(self) -> Storage:
        """No place. Raises UsageError."""
        raise UsageError(
            f"{self.name}: found several datasets opened as one, expected one dataset; ibdata.merge makes one"
        )

    def read(self, path: str) -> bytes:
        """The bytes of a file of one of them; weights have the same name in each that has them."""
        return next(part for part in self.parts if path in part.manifest.entries()).read(path)

    def refuse_replaced(self) -> None:
        for part in self.parts:
            part.refuse_replaced()

    @cached_property
    def info(self) -> Info:
        info, steps = self.parts[0].info, {part.info.counts.steps for part in self.parts}
        counts = Counts(
            rows=self.manifest.rows,
            episodes=len(self.episodes),
            steps=steps.pop() if len(steps) == 1 else None,
            cells=len(self.episodes["cell"].unique()),
            shards=len(self.manifest.shards),
        )
        return info.model_copy(update={"name": self.manifest.name, "counts": counts})

    @cached_property
    def statistics(self) -> Statistics:
        """None, so that they are computed from the rows."""
        return Statistics(format="ibdata-statistics", version=1, all={}, splits={})

    @cached_property
    def episodes(self) -> pa.Table:
        tables = [
            _shifted(part.episodes, shard=shard, episode=episode)
            for part, (shard, episode) in zip(self.parts, self._firsts, strict=True)
        ]
        return pa.concat_tables(tables, promote_options="permissive").unify_dictionaries().combine_chunks()

    @property
    def splits(self) -> dict[str, SplitEntry]:
        """The splits by name; one may be whole files of one dataset, and labels in another."""
        joined: dict[str, SplitEntry] = {}
        for part, (_, first) in zip(self.parts, self._firsts, strict=True):
            for name, entry in part.splits.items():
                before = joined.get(name, SplitEntry(episodes=0, rows=0, declared=True))
                joined[name] = SplitEntry(
                    episodes=before.episodes + entry.episodes,
                    rows=before.rows + entry.rows,
                    declared=before.declared and entry.declared,
                    runs=[*before.runs, *([start + first, stop + first] for start, stop in entry.runs)],
                )
        return joined

    def rows(self, number: int, columns: Sequence[str] | None = None) -> pa.Table:
        part, number, first = self._part_of(number)
        return _shifted(part.rows(number, columns), episode=first)

    def batches(
        self, number: int, columns: Sequence[str], most: int, start: int = 0, stop: int | None = None
    ) -> Iterator[pa.RecordBatch]:
        part, number, first = self._part_of(number)
        return (_shifted(x, episode=first) for x in part.batches(number, columns, most, start, stop))

    def _part_of(self, shard: int) -> tuple[Stored, int, int]:
        """The dataset of a shard, its number there, and the number of the dataset's first episode."""
        i = bisect(self._firsts, shard, key=lambda first: first[0]) - 1
        first_shard, first_episode = self._firsts[i]
        return self.parts[i], shard - first_shard, first_episode


def _shifted(rows: Any, **numbers: int) -> Any:
    """A table or a batch, to whose columns of these names numbers are added."""
    for name, number in numbers.items():
        if name in rows.schema.names:
            place = rows.schema.get_field_index(name)
            field = rows.schema.field(place)
            shifted = pc.add(rows[name], pa.scalar(number, field.type))
            rows = rows.set_column(place, field, shifted)
    return rows


def refuse_unlike(parts: Sequence[Stored]) -> None:
    """Raise UsageError for other columns, dynamics or starts than those of the first, and for equal episodes.

    Of equal seeds and cells, one episode is the beginning of the other.
    """
    for part in parts[1:]:
        _refuse_other_kind(parts[0], part)
    owners: dict[Any, int] = {}
    for number, part in enumerate(parts):
        seeds = [part.manifest.experiments[shard.experiment]["seed"] for shard in part.manifest.shards]
        shards, cells, digests = (part.episodes[name].to_pylist() for name in ("shard", "cell", "digest"))
        of_cells = {
            (seeds[shard], cell): i for i, (shard, cell) in enumerate(zip(shards, cells, strict=True))
        }
        for address, i in of_cells.items():
            if (known := owners.setdefault(address, number)) < number:
                raise _shared(part, i, parts[known])
        for i, digest in enumerate(digests):
            if (known := owners.setdefault(digest, number)) < number:
                also = f"episode {i} is also in {parts[known].name}"
                raise UsageError(f"{part.name}: {also}; leave one of the datasets out")


def _shared(part: Stored, episode: int, known: Stored) -> UsageError:
    """The error that names the cell of an episode, which another dataset has too."""
    setpoint = exact(decimal(part.episodes["setpoint"].to_numpy()[episode]))
    is_live = any(code.target.startswith(LIVE) for code in part.manifest.code)
    return UsageError(
        f"{part.name}: setpoint {setpoint}, policy {part.episodes['policy'][episode]}: the same episodes are "
        f"also in {known.name}; {'name one of the objects, or ' if is_live else ''}make one of the datasets "
        f"with another {parameter('seed')}"
    )


def _refuse_other_kind(a: Stored, b: Stored) -> None:
    kinds = [{column.name: column.dtype for column in part.info.columns} for part in (a, b)]
    for name in dict.fromkeys([*kinds[0], *kinds[1]]):
        types = [kind.get(name, "none") for kind in kinds]
        if types[0] != types[1]:
            raise UsageError(f"{b.name}: column {name}: found {types[1]}, expected {types[0]} as in {a.name}")
    if a.info.drifting != b.info.drifting:
        raise UsageError(
            f"{b.name}: found {'moving' if b.info.drifting else 'constant'} setpoints, expected "
            f"{'moving' if a.info.drifting else 'constant'} ones as in {a.name}"
        )
    for name in ("dynamics", "start"):  # no column tells them apart
        first, second = (getattr(part.info, name) for part in (a, b))
        if first != second:
            raise UsageError(
                f"{b.name}: {name}: found {excerpt(second)}, expected {excerpt(first)} as in "
                f"{a.name}; keep both datasets, and join their arrays by numpy.concatenate"
            )
