"""Finishing a dataset: card, metadata and, last, the manifest."""

from __future__ import annotations

import platform
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pyarrow as pa

from ibdata.columns import columns, layout
from ibdata.dataset import manifest, metadata
from ibdata.dataset.card import card
from ibdata.dataset.digest import content_root
from ibdata.dataset.files import FileEntry, write
from ibdata.dataset.shard import Written, content_of
from ibdata.experiment import Experiment, as_yaml
from ibdata.version import __version__


def finish(
    experiment: Experiment, written: list[Written], folder: Path, reproducible: bool
) -> dict[str, Any]:
    """Commit card, metadata and, last, the manifest; the manifest."""
    written = sorted(written, key=lambda w: w.shard.number)
    root = root_of(experiment, written)
    entries = [w.entry for w in written]
    entries += [write(folder, path, make()) for path, make in documents(experiment, written, root).items()]
    made_manifest = _manifest(experiment, written, entries, root, reproducible)
    write(folder, manifest.PATH, metadata.as_json(made_manifest))
    return made_manifest


def documents(experiment: Experiment, written: list[Written], root: str) -> dict[str, Callable[[], bytes]]:
    """What makes each of the files beside the shards; only episodes and stats need the shards' content."""
    return {
        "meta/info.json": lambda: metadata.as_json(metadata.info(experiment, written)),
        "meta/episodes.parquet": lambda: metadata.episodes_parquet(experiment, written),
        "meta/stats.json": lambda: metadata.as_json(
            metadata.stats(experiment, layout(experiment).names, written)
        ),
        "meta/experiment.yaml": lambda: as_yaml(experiment),
        manifest.CARD: lambda: card(experiment, written, root),
    }


def versions() -> dict[str, str]:
    """What the bytes of files may depend on; the content does not."""
    return {
        "python": platform.python_version(),
        "platform": f"{platform.system()} {platform.machine()}",
        "ibdata": __version__,
        "numpy": np.__version__,
        "numba": numba.__version__,
        "pyarrow": pa.__version__,
    }


def root_of(experiment: Experiment, written: list[Written]) -> str:
    """The content root of shards in order."""
    digests = [digest for w in written for digest in w.content.digests]
    cells = experiment.cells
    return content_root(
        ((c.name, c.dtype) for c in columns(experiment)),
        ((cells[i // experiment.episodes].digest, i % experiment.episodes, d) for i, d in enumerate(digests)),
    )


def _manifest(
    experiment: Experiment, written: list[Written], entries: list[FileEntry], root: str, reproducible: bool
) -> dict[str, Any]:
    content = {
        "format": manifest.FORMAT,
        "version": manifest.VERSION,
        "data_version": manifest.DATA_VERSION,
        "name": experiment.name,
        "content_root": root,
        "reproducible": reproducible,
        "experiment": experiment.plain(),
        "rows": experiment.rows,
        "clipped_actions": sum(w.content.clipped for w in written),
        "shards": [
            {
                "path": w.entry.path,
                "rows": (w.shard.stop - w.shard.first) * experiment.steps,
                "episodes": [w.shard.first, w.shard.stop],
                "splits": list(w.shard.splits),
                "content": content_of(w.content.digests),
            }
            for w in written
        ],
        "files": [entry._asdict() for entry in entries],
        "versions": versions(),
    }
    return {**content, "checksum": manifest.checksum(content)}
