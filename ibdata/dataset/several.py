"""Several finished datasets read as one, with the rows that `ibdata.merge` would copy, in the same order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from itertools import count
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from ibdata._numerics.naming import exact
from ibdata._system.storage import Storage
from ibdata.dataset.digest import content_root
from ibdata.dataset.manifest import sealed
from ibdata.dataset.models import Counts, File, Info, ShardEntry, SplitEntry, Statistics
from ibdata.dataset.stored import Stored
from ibdata.errors import UsageError, excerpt, parameter, printable


class Several(Stored):
    """Datasets of which each goes on with the numbers of episodes, shards and experiments of the one before.

    Raises UsageError for datasets that cannot be merged.
    """

    def __init__(self, parts: Sequence[Stored]) -> None:
        _refuse_unlike(parts)
        self.parts = parts
        self._begun: list[tuple[Stored, int, int]] = []  # each dataset, its first shard and first episode
        self._places: list[tuple[Stored, int, int]] = []  # each shard's dataset, number there, first episode
        shards: list[ShardEntry] = []
        experiments: list[dict[str, Any]] = []
        files: dict[str, File] = {}
        for part in parts:
            first = shards[-1].episodes[1] if shards else 0
            self._begun.append((part, len(shards), first))
            for number, shard in enumerate(part.manifest.shards):
                episodes = [episode + first for episode in shard.episodes]
                update = {"experiment": shard.experiment + len(experiments), "episodes": episodes}
                shards.append(shard.model_copy(update=update))
                self._places.append((part, number, first))
            names = (f"meta/experiment-{i:05d}.yaml" for i in count(len(experiments)))
            for file in part.manifest.files:
                path = next(names) if file.path.startswith("meta/experiment") else file.path
                files[path] = file.model_copy(update={"path": path})
            experiments += part.manifest.experiments
        listed = [part.manifest for part in parts]
        columns = ((column.name, column.dtype) for column in parts[0].info.columns)
        cells, indices, digests = (self.episodes[x].to_numpy().tolist() for x in ("cell", "index", "digest"))
        addresses = zip(map(bytes.fromhex, cells), indices, digests, strict=True)
        update = {
            "content_root": content_root(columns, addresses),
            "name": "several",
            "experiments": experiments,
            "rows": sum(one.rows for one in listed),
            "clipped_actions": sum(one.clipped_actions for one in listed),
            "shards": shards,
            "files": list(files.values()),
            "reproducible": min((one.reproducible for one in listed), key=lambda x: (bool(x), x is True)),
            "code": [code for one in listed for code in one.code],
        }
        self.manifest = sealed(listed[0].model_copy(update=update))

    @property
    def name(self) -> str:
        return f"{self.parts[0].name} and {len(self.parts) - 1} more"

    @property
    def storage(self) -> Storage:  # type: ignore[override]  # they have no place
        raise UsageError(
            f"{self.name}: found several datasets opened as one, expected one dataset; ibdata.merge makes one"
        )

    def read(self, path: str) -> bytes:
        return next(part for part in self.parts if path in part.manifest.entries()).read(path)

    @cached_property
    def info(self) -> Info:
        lengths = self.episodes["length"].unique().to_pylist()
        counts = Counts(
            rows=self.manifest.rows,
            episodes=len(self.episodes),
            steps=lengths[0] if len(lengths) == 1 else None,
            cells=len(self.episodes["cell"].unique()),
            shards=len(self.manifest.shards),
        )
        return self.parts[0].info.model_copy(update={"name": self.manifest.name, "counts": counts})

    @cached_property
    def statistics(self) -> Statistics:
        return Statistics(format="ibdata-statistics", version=1, all={}, splits={})  # made of the rows

    @cached_property
    def episodes(self) -> pa.Table:
        tables = [_shifted(part.episodes, shard=shard, episode=first) for part, shard, first in self._begun]
        return pa.concat_tables(tables, promote_options="permissive").unify_dictionaries().combine_chunks()

    @property
    def splits(self) -> dict[str, SplitEntry]:
        """The splits by name. One may be whole files of some datasets and labels in others."""
        joined: dict[str, SplitEntry] = {}
        for part, _, first in self._begun:
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
        part, own, first = self._places[number]
        return _shifted(part.rows(own, columns), episode=first)

    def batches(
        self, number: int, columns: Sequence[str], most: int, start: int = 0, stop: int | None = None
    ) -> Iterator[pa.RecordBatch]:
        part, own, first = self._places[number]
        for batch in part.batches(own, columns, most, start, stop):
            yield _shifted(batch, episode=first)


def _shifted(rows: Any, **numbers: int) -> Any:
    """A table or a batch with these numbers added to the columns of these names, if it has them."""
    for name in numbers.keys() & {*rows.schema.names}:
        place = rows.schema.get_field_index(name)
        field = rows.schema.field(place)
        rows = rows.set_column(place, field, pc.add(rows[name], pa.scalar(numbers[name], field.type)))
    return rows


def _refuse_unlike(parts: Sequence[Stored]) -> None:
    """Raise UsageError for other columns, dynamics or starts than those of the first, or for equal episodes.

    Of equal seeds and cells, one episode is the beginning of the other.
    """
    owners: dict[Any, int] = {}
    for number, part in enumerate(parts):
        first, kind = _kind(parts[0].info), _kind(part.info)
        if other := next((name for name in {**first, **kind} if first.get(name) != kind.get(name)), None):
            raise UsageError(
                f"{part.name}: {other}: found {excerpt(kind.get(other))}, expected "
                f"{excerpt(first.get(other))} as in {parts[0].name}; keep both, and join their arrays by "
                "numpy.concatenate"
            )
        seeds = [part.manifest.experiments[shard.experiment]["seed"] for shard in part.manifest.shards]
        names = ("setpoint", "policy", "shard", "cell", "digest")
        columns = [part.episodes[name].to_numpy() for name in names]
        for setpoint, policy, shard, cell, digest in zip(*columns, strict=True):
            known = min(owners.setdefault(key, number) for key in ((seeds[shard], cell), digest))
            if known < number:
                raise UsageError(
                    f"{part.name}: setpoint {exact(setpoint)}, policy {printable(policy)}: the same episodes "
                    f"are also in {parts[known].name}; leave one out, or make it with another "
                    f"{parameter('seed')}"
                )


def _kind(info: Info) -> dict[str, Any]:
    """What all rows of a dataset have in common; no column tells two dynamics or two starts apart."""
    columns = {f"column {column.name}": column.dtype for column in info.columns}
    setpoints = "moving" if info.drifting else "constant"
    return {**columns, "setpoints": setpoints, "dynamics": info.dynamics, "start": info.start}
