"""What is in folders, finished or not."""

from __future__ import annotations

from pathlib import Path


def contents(folder="."):
    """Every file and folder below a folder, with the bytes of the files."""
    paths = sorted(Path(folder).rglob("*"))
    return {str(path): path.read_bytes() if path.is_file() else None for path in paths}


def part_of(place):
    """The hidden folder in which the dataset of a place is made."""
    return Path(place).with_name(f".{Path(place).name}.part")


def receipts(place):
    """The names of the receipts of an unfinished run."""
    return sorted(path.name for path in (part_of(place) / "receipts").glob("*"))


def is_right(made, plain, files):
    """Whether a folder holds the files of another with the same dataset, and no part is left beside it."""
    return files(made) == files(plain) and not part_of(made).exists()
