"""The shipped sets on which scripts train, made once and kept."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import ibdata


@lru_cache(maxsize=2)
def dataset(name: str, data: Path, steps: int | None = None) -> ibdata.Dataset:
    """The dataset of a shipped experiment, or the first steps of its episodes, without splits."""
    folder = data / (name.replace("/", "-") + (f"-{steps}-steps" if steps else ""))
    changes: dict[str, Any] = {"splits": {}, **({"steps": steps} if steps else {})}
    return ibdata.generate(name, folder, overrides=changes, workers=1, resume=True)


@lru_cache(maxsize=1)
def rows(name: str, data: Path) -> Any:
    """Its rows as the algorithms take them."""
    from training.offline import rows_of

    return rows_of(dataset(name, data))
