"""The files of the experiments that come with ibdata."""

from __future__ import annotations

import os
from pathlib import Path


def root() -> Path:
    """The folder of the files."""
    here = Path(__file__).resolve().parent.parent
    # Installed, the configs lie inside the package; in a checkout, beside it.
    return next(path for path in (here / "configs", here.parent / "configs") if path.is_dir())


def canonical_file() -> Path:
    """The content roots and figures of the datasets of these experiments."""
    packaged = root() / "canonical.json"
    return packaged if packaged.exists() else root().parent / "docs" / "canonical.json"


def configs_in(folder: Path) -> list[Path]:
    """The configs in a folder, in order; none if the path is that of no folder."""
    return sorted(folder.glob("[!.]*.yaml")) if os.path.isdir(folder) else []  # False for an invalid name


def shipped() -> dict[str, Path]:
    """The configs that come with ibdata, by name without '.yaml'; in a suite the name is suite/name."""
    folders = [root(), *sorted(root().iterdir())]
    paths = [path for folder in folders for path in configs_in(folder)]
    return {path.relative_to(root()).with_suffix("").as_posix(): path for path in paths}


def suites() -> dict[str, Path]:
    """The folders of configs that come with ibdata, by name."""
    return {path.name: path for path in sorted(root().iterdir()) if configs_in(path)}
