"""F8: every change of a byte, and every truncation, is found and named."""

import json
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
import pytest

pytestmark = pytest.mark.faults


@pytest.fixture
def dataset(forks: Any, tools: Any) -> Path:
    """A small dataset of two shards, with a split."""
    out = tools.where / "out"
    options = ("--out", out, "--workers", 1, "--set", "splits={low: {setpoint: 10}}")
    answer = forks.run("generate", "--quiet", "--config", tools.tiny, *options)
    assert answer.code == 0, answer
    return out


def unnamed(folder: Path, path: Path) -> list[str]:
    """Ways of validating that do not name the file."""
    from ibdata.validation.validate import validate

    name = str(path.relative_to(folder))
    return [
        f"quick={quick}" for quick in (True, False) if name not in {p.path for p in validate(folder, quick)}
    ]


def files_of(folder: Path) -> list[Path]:
    """The dataset's files, but the card, which is the user's to edit."""
    return sorted(path for path in folder.rglob("*") if path.is_file() and path.name != "README.md")


def same_values(path: Path, changed: bytes, whole: bytes) -> bool:
    """Whether a change of a file that has no hash leaves its values, as a cut of the last newline does."""
    if path.name not in ("manifest.json", "splits.json"):
        return False
    try:
        return bool(json.loads(changed) == json.loads(whole))
    except ValueError:
        return False


def test_every_flipped_bit_is_found_and_its_file_named(tools: Any, dataset: Path) -> None:
    files, missed = files_of(dataset), []
    sizes = [path.stat().st_size for path in files]
    flips = tools.size(200, 1000)
    chosen = [*files, *tools.random.choices(files, sizes, k=flips - len(files))]
    for path in chosen:
        whole = path.read_bytes()
        place, bit = tools.random.randrange(len(whole)), tools.random.randrange(8)
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 1 << bit]) + whole[place + 1 :])
        missed += [f"{path.name}: byte {place}, bit {bit}: {how}" for how in unnamed(dataset, path)]
        path.write_bytes(whole)
    tools.figure(f"F8: {flips} bit flips over {len(files)} files, {flips - len(missed)} found and named")
    assert not missed, "\n".join(missed)
    assert tools.root(dataset)


def test_every_flipped_bit_of_the_manifest_is_found(tools: Any, dataset: Path) -> None:
    from ibdata.validation.validate import validate

    path = dataset / "meta" / "manifest.json"
    whole = path.read_bytes()
    places = range(len(whole)) if tools.full else sorted(tools.random.sample(range(len(whole)), 150))
    missed = []
    for place in places:
        for bit in range(8):
            changed = whole[:place] + bytes([whole[place] ^ 1 << bit]) + whole[place + 1 :]
            path.write_bytes(changed)
            if not same_values(path, changed, whole) and not validate(dataset, quick=True):
                missed.append(f"byte {place}, bit {bit}")
    path.write_bytes(whole)
    assert not missed, "\n".join(missed)


def boundaries(path: Path) -> set[int]:
    """Where row groups, column chunks and their pages begin or end."""
    found: set[int] = set()
    metadata = pq.read_metadata(path)
    for group in range(metadata.num_row_groups):
        for column in range(metadata.num_columns):
            chunk = metadata.row_group(group).column(column)
            starts = [chunk.data_page_offset, chunk.dictionary_page_offset or chunk.data_page_offset]
            found |= {*starts, min(starts) + chunk.total_compressed_size}
    return found


def test_every_truncation_is_found_and_its_file_named(tools: Any, dataset: Path) -> None:
    missed, cuts = [], 0
    for path in files_of(dataset):
        whole = path.read_bytes()
        lengths = {0, 1, 4, len(whole) // 2, len(whole) - 8, len(whole) - 4, len(whole) - 1}
        if path.suffix == ".parquet":
            lengths |= boundaries(path)
        lengths |= {tools.random.randrange(len(whole)) for _ in range(tools.size(5, 200))}
        for length in sorted(lengths & set(range(len(whole)))):
            if same_values(path, whole[:length], whole):
                continue
            path.write_bytes(whole[:length])
            missed += [f"{path.name}: {length} bytes: {how}" for how in unnamed(dataset, path)]
            cuts += 1
        path.write_bytes(whole)
    tools.figure(f"F8, truncation: {cuts} cuts, also at every page and column chunk, {len(missed)} missed")
    assert not missed, "\n".join(missed)
