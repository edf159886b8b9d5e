"""Finishing a dataset: card, metadata and, last, the manifest."""

from __future__ import annotations

import hashlib
import platform
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
from ibdata.dataset.shard import Written
from ibdata.experiment import Experiment, as_yaml
from ibdata.version import __version__


def finish(
    experiment: Experiment, written: list[Written], folder: Path, reproducible: bool
) -> dict[str, Any]:
    """Commit card, metadata and, last, the manifest; the manifest."""
    written = sorted(written, key=lambda w: w.shard.number)
    root = _root(experiment, written)
    made = {
        "meta/info.json": metadata.as_json(metadata.info(experiment, written)),
        "meta/episodes.parquet": metadata.episodes_parquet(experiment, written),
        "meta/stats.json": metadata.as_json(metadata.stats(experiment, layout(experiment).names, written)),
        "meta/experiment.yaml": as_yaml(experiment),
        manifest.CARD: card(experiment, written, root),
    }
    entries = [w.entry for w in written] + [write(folder, path, data) for path, data in made.items()]
    made_manifest = _manifest(experiment, written, entries, root, reproducible)
    write(folder, manifest.PATH, metadata.as_json(made_manifest))
    return made_manifest


def _root(experiment: Experiment, written: list[Written]) -> str:
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
                "content": hashlib.sha256(b"".join(w.content.digests)).hexdigest(),
            }
            for w in written
        ],
        "files": [entry._asdict() for entry in entries],
        "versions": {
            "python": platform.python_version(),
            "platform": f"{platform.system()} {platform.machine()}",
            "ibdata": __version__,
            "numpy": np.__version__,
            "numba": numba.__version__,
            "pyarrow": pa.__version__,
        },
    }
    return {**content, "checksum": manifest.checksum(content)}
