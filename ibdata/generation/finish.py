"""Finishing a dataset: its card, its metadata and, last, the manifest.

What a manifest lists must follow from its experiments; `plan_problems` checks that.
"""

from __future__ import annotations

import io
import json
import math
import platform
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from ibdata._system.files import FileEntry, entry_of
from ibdata.dataset import manifest
from ibdata.dataset.digest import content_root
from ibdata.dataset.models import Code, File, Manifest, ShardEntry
from ibdata.dataset.stored import EPISODES_PATH, INFO_PATH, STATISTICS_PATH
from ibdata.errors import DatasetError
from ibdata.experiment import Experiment, as_yaml
from ibdata.generation import metadata
from ibdata.generation.card import card_text
from ibdata.generation.croissant import croissant
from ibdata.generation.shard import WrittenShard
from ibdata.plan.columns import columns
from ibdata.plan.dataset_spec import DatasetSpec, Shard
from ibdata.version import __version__

NEED_CONTENT = (EPISODES_PATH, STATISTICS_PATH)
UNSEALED = "0" * 64  # stands for the checksum until all else is known


def finish(
    spec: DatasetSpec,
    written: list[WrittenShard],
    reproducible: bool,
    code: Sequence[Code] = (),
    clipped: int | None = None,
) -> Iterator[tuple[str, bytes]]:
    """The paths and contents of all files of a dataset other than its shards, the manifest last.

    Args:
        spec: The experiments and splits of the dataset.
        written: The shards that were written, in order.
        reproducible: Whether the machine computes the same bits as all others.
        code: The code of the custom policies.
        clipped: The number of clipped actions; by default the sum over the shards.
    """
    root = root_of(spec, ((w.shard, w.summary.digests) for w in written))
    files = [w.entry for w in written]
    entries, contents = {file.path: file for file in files}, dict[str, Any]()
    for path, make in metadata_contents(spec, written, entries, root).items():
        contents[path] = make()
        data = encoded(contents[path])
        entries[path] = entry_of(path, data)
        yield path, data
    yield manifest.SPLITS, metadata.splits_file(spec)
    yield manifest.CARD, card_text(spec, files, root, contents[EPISODES_PATH])
    listed = manifest.sealed(
        Manifest(
            format=manifest.FORMAT,
            version=manifest.VERSION,
            data_version=manifest.DATA_VERSION,
            content_root=root,
            name=spec.name,
            experiments=[experiment.plain() for experiment in spec.experiments],
            rows=spec.rows,
            clipped_actions=sum(w.summary.clipped for w in written) if clipped is None else clipped,
            shards=[
                ShardEntry(path=entry.path, content=summary.content, **planned_entry(spec, shard))
                for shard, entry, summary in written
            ],
            files=[File(**entry._asdict()) for entry in entries.values()],
            versions=versions(),
            reproducible="same-environment" if code and reproducible else reproducible,
            code=list(code),
            checksum=UNSEALED,
        )
    )
    yield manifest.PATH, metadata.as_json(listed)


def planned_entry(spec: DatasetSpec, shard: Shard) -> Mapping[str, Any]:
    """The manifest's entry for a shard, without its path and its content."""
    return {
        "rows": spec.rows_in([shard]),
        "experiment": shard.experiment,
        "episodes": [shard.first + shard.offset, shard.stop + shard.offset],
        "splits": list(shard.splits),
    }


def metadata_contents(
    spec: DatasetSpec, written: list[WrittenShard], entries: Mapping[str, FileEntry], root: str
) -> dict[str, Callable[[], Any]]:
    """What makes the contents of the files in `meta` that the manifest lists, by path.

    Those of NEED_CONTENT need all shards. croissant.json, the last, needs the entries of all other files, and
    the content root.
    """
    paths = [manifest.EXPERIMENT]
    if len(spec.experiments) > 1:  # of a merged dataset
        paths = [f"meta/experiment-{i:05d}.yaml" for i in range(len(spec.experiments))]
    known: dict[str, Any] = dict(zip(paths, spec.experiments, strict=True))
    known |= {f"meta/{name}": data for name, data in spec.weights.items()}
    return {
        INFO_PATH: lambda: metadata.info(spec),
        EPISODES_PATH: lambda: metadata.episodes_table(spec, written),
        STATISTICS_PATH: lambda: metadata.statistics(spec, written),
        **{path: partial(known.__getitem__, path) for path in known},
        manifest.CROISSANT: lambda: croissant(spec, entries.values(), root),
    }


def encoded(content: Any) -> bytes:
    """The bytes of a file in `meta`: an experiment as YAML, a table as Parquet, other data as JSON."""
    if isinstance(content, Experiment):
        return as_yaml(content)
    if isinstance(content, pa.Table):
        out = io.BytesIO()
        pq.write_table(content, out, compression="zstd", write_page_checksum=True)
        return out.getvalue()
    return content if isinstance(content, bytes) else metadata.as_json(content)


def rewritten_manifest(listed: Manifest, entries: Mapping[str, FileEntry]) -> bytes:
    """The bytes of a manifest with other entries for the same files, which this ibdata has written."""
    files = [File(**entry._asdict()) for entry in entries.values()]
    changed = listed.model_copy(update={"files": files, "versions": versions()})
    return metadata.as_json(manifest.sealed(changed))


def versions() -> dict[str, str]:
    """The versions on which the bytes of the files may depend, but not the content."""
    import numba  # not earlier, because `_numerics.compiled` keeps it from reading a foreign file

    return {
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "ibdata": __version__,
        "numpy": np.__version__,
        "numba": numba.__version__,
        "pyarrow": pa.__version__,
    }


def root_of(spec: DatasetSpec, shards: Iterable[tuple[Shard, list[bytes]]]) -> str:
    """The content root of all shards in order, each with the digests of its episodes."""
    addresses = []
    for shard, digests in shards:
        experiment = spec.experiments[shard.experiment]
        for i, digest in enumerate(digests, shard.first):
            cell, index = divmod(i, experiment.episodes)
            addresses.append((experiment.cells[cell].digest, index, digest))
    return content_root(((c.name, c.dtype) for c in columns(spec.experiments[0])), addresses)


def refuse_other_plan(spec: DatasetSpec, listed: Manifest) -> None:
    """Raise DatasetError if what a manifest lists does not follow from its experiments."""
    for rule, message in plan_problems(spec, listed):
        raise DatasetError(f"{manifest.PATH}: {rule}: {message}; see ibdata validate")


def plan_problems(spec: DatasetSpec, listed: Manifest) -> Iterator[tuple[str, str]]:
    """The rules that a manifest breaks, each with what was found and expected."""
    shards = [entry.model_dump(exclude={"path", "content"}) for entry in listed.shards]
    expected_shards = [planned_entry(spec, shard) for shard in spec.shards]
    files = {file.path for file in listed.files}
    expected_files = {*(s.path for s in listed.shards), *metadata_contents(spec, [], {}, "")}
    targets = list(dict.fromkeys(code.target for code in listed.code))
    for rule, found, expected in (
        ("experiments", {"shards": shards}, {"shards": expected_shards}),
        ("rows", listed.rows, spec.rows),
        ("files", sorted(files), sorted(expected_files)),
        ("code", targets, list(dict.fromkeys(policy.code_target for policy in spec.user_objects))),
    ):
        if message := first_difference(found, expected):
            yield rule, message
    if listed.clipped_actions > listed.rows:
        yield "counts", f"clipped_actions: found {listed.clipped_actions}, expected at most one per row"
    if listed.code and listed.reproducible is True:
        yield "code", 'reproducible: found true, expected "same-environment" or false for custom policies'


def first_difference(found: Any, expected: Any, *keys: object, tolerance: float = 1e-9) -> str | None:
    """Describe the first difference of data, which are at `keys`, but for rounding; None if there is none.

    A description may be said in other words, and versions of numpy choose other quantiles.

    >>> first_difference({"a": [1, 2]}, {"a": [1, 3]})
    'a.1: found 2, expected 3'
    """
    if found == expected and type(found) is type(expected):
        return None
    pairs: Iterable[tuple[object, Any, Any]] = ()
    if isinstance(found, dict) and isinstance(expected, dict):
        names = (name for name in {**expected, **found} if name != "description")
        pairs = [(name, found.get(name), expected.get(name)) for name in names]
    elif isinstance(found, list) and isinstance(expected, list) and len(found) == len(expected):
        pairs = zip(range(len(found)), found, expected, strict=True)
    elif not _is_near(found, expected, tolerance):
        where = f"{'.'.join(map(str, keys))}: " if keys else ""
        return f"{where}found {_shown(found)}, expected {_shown(expected)}"
    for key, a, b in pairs:
        if key == "quantiles":
            tolerance = 0.01 * ((expected["max"] or 0.0) - (expected["min"] or 0.0))
        if inner := first_difference(a, b, *keys, key, tolerance=tolerance):
            return inner
    return None


def _is_near(x: Any, y: Any, tolerance: float) -> bool:
    are_floats = isinstance(x, float) and isinstance(y, float)
    return are_floats and math.isclose(x, y, rel_tol=1e-9, abs_tol=tolerance)


def _shown(value: Any) -> str:
    if isinstance(value, bytes):
        return f"{value.hex()[:12]}…"
    return f"{len(value)} values" if isinstance(value, list) else json.dumps(value)[:60]
