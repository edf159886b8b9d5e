"""The size of a run, and what it would do."""

from __future__ import annotations

import os
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ibdata._numerics.arguments import public
from ibdata._numerics.naming import counted, size
from ibdata.dataset.tabular import Table, Tabular, pairs
from ibdata.experiment import KEYS, Config, Overrides, load_all
from ibdata.generation.build import Build
from ibdata.generation.generate import places_of
from ibdata.plan.columns import layout
from ibdata.plan.consent import require_consent
from ibdata.plan.dataset_spec import DatasetSpec

# Of the bytes of the numbers; for random and safe actions, much less for actions that repeat.
COMPRESSED = 0.65


class Estimate(Tabular, dict[str, Any]):
    """The size of a run, and what it would do: a dict that shows as a table.

    Its keys are `name`, `out` (where), `episodes`, `rows`, `shards` (files), `bytes` (estimated) and `action`
    (what `generate` would do). Of a folder of experiments, the numbers are sums, and `experiments` is a list
    of such dicts in place of `name` and `action`.
    """

    def tables(self) -> list[Table]:
        """The names and values, a row for each experiment."""
        rows = self.get("experiments", [self])
        return [Table(list(rows[0]), [list(row.values()) for row in rows])]

    def plain(self) -> dict[str, Any]:
        """The names and values."""
        return self

    def __repr__(self) -> str:
        runs = self.get("experiments", [])
        lines = [
            f"{run['out']}: {counted(run['rows'], 'row')}, about {size(run['bytes'])}, {run['action']}"
            for run in runs
        ]
        total = [
            ("out", f"{self['out']} (nothing is written)"),
            *((name, f"{self[name]:,}") for name in ("episodes", "rows", "shards")),
            ("bytes", f"about {size(self['bytes'])}, less where actions repeat"),
        ]
        if not runs:
            total.append(("action", self["action"]))
        return "\n".join([*lines, *([""] if lines else []), pairs(total)])


@partial(public, keys=KEYS)
def estimate(
    config: Config,
    out: str | os.PathLike[str] | None = None,
    *,
    seed: int | None = None,
    overrides: Overrides = (),
    overwrite: bool = False,
    allow_code: bool = False,
) -> Estimate:
    """Tell the size of what `generate` would make, and what it would do; nothing is written or simulated.

    Args:
        config: This and the other arguments are as in `generate`.
        out: As in `generate`.
        seed: As in `generate`.
        overrides: As in `generate`.
        overwrite: As in `generate`.
        allow_code: As in `generate`.

    Returns:
        The size, and what `generate` would do with what is at `out`.

    Raises:
        IbdataError: As in `generate`.
    """
    folder, files, experiments = load_all(config, overrides, seed)
    specs = [DatasetSpec.of(experiment) for experiment in experiments]
    for spec in specs:
        require_consent(spec, spec.name, allow_code)
    places = places_of(folder, files, specs, out)
    runs = [_estimate(spec, place, overwrite) for spec, place in zip(specs, places, strict=True)]
    if folder is None:
        return runs[0]
    total = {key: sum(run[key] for run in runs) for key in ("episodes", "rows", "shards", "bytes")}
    return Estimate({"out": str(Path(runs[0]["out"]).parent), **total, "experiments": runs})


def _estimate(spec: DatasetSpec, place: Path | str, overwrite: bool) -> Estimate:
    build, action = Build(place, spec, overwrite=overwrite), "open the finished dataset"
    if not build.look():
        finished = build.begun_shards()
        action = f"go on after {counted(finished, 'finished shard')}" if finished else "make it"
    [experiment] = spec.experiments
    row_bytes = len(layout(experiment).names) * np.dtype(experiment.output.dtype).itemsize
    return Estimate(
        name=spec.name,
        out=str(place),
        episodes=spec.episodes,
        rows=spec.rows,
        shards=len(spec.shards),
        bytes=round(COMPRESSED * row_bytes * spec.rows),
        action=action,
    )
