"""F7: the order in which files reach the disk, from the recorded operations of whole runs."""

import os
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.faults


class Record:
    """The operations of a run, in the order in which they were done."""

    def __init__(self, log: Path) -> None:
        self.lines = [line.split() for line in log.read_text().splitlines() if not line.startswith("-")]

    def places(self, *operation: str) -> list[int]:
        """Where an operation is recorded."""
        return [i for i, line in enumerate(self.lines) if line == list(operation)]

    def renames(self, within: Path) -> list[tuple[int, str, str]]:
        """Temporary files that got their names, and where."""
        return [
            (i, line[1], line[2])
            for i, line in enumerate(self.lines)
            if line[0] == "rename" and line[2].startswith(f"{within}/") and ".tmp-" in line[1]
        ]


def out_of_order(record: Record, folder: Path) -> tuple[int, list[str]]:
    """How many files were committed, and of which not write < fsync < rename < fsync(folder) < manifest."""
    bad, renames = [], record.renames(folder)
    (listed,) = [i for i, _, path in renames if path == f"{folder}/meta/manifest.json"]
    for i, temporary, path in renames:
        writes, syncs = record.places("write", temporary), record.places("fsync", temporary)
        after = [k for k in record.places("fsync", str(Path(path).parent)) if k > i]
        if not (writes and syncs and after):
            bad.append(f"{path}: an operation is missing")
        elif not max(writes) < max(syncs) < i < min(after) or (i != listed and min(after) >= listed):
            bad.append(
                f"{path}: written {max(writes)}, synced {max(syncs)}, renamed {i}, folder {min(after)}"
            )
        part = Path(path).parent
        made, entry = record.places("mkdir", str(part)), record.places("fsync", str(part.parent))
        if made and part.name in ("data", "meta") and not any(made[0] < k < listed for k in entry):
            bad.append(f"{path}: its folder's name was not on the disk before the manifest")
    return len(renames), bad


@pytest.mark.parametrize("workers", [1, 2])
def test_every_file_is_on_the_disk_before_its_name_and_all_names_before_the_manifest(
    tools: Any, shim: str, workers: int
) -> None:
    out, log = tools.where / "out", tools.where / "log"
    env = {**os.environ, "LD_PRELOAD": shim, "SHIM_FOLDER": str(tools.where), "SHIM_LOG": str(log)}
    made = tools.generate(tools.many, out, "--workers", workers, env=env)
    assert made.returncode == 0, made.stderr
    record = Record(log)
    files, bad = out_of_order(record, out)
    assert record.places("fsync", str(tools.where))[0] < record.renames(out)[0][0]
    shards = len(tools.hashes(out))
    assert (
        files == 2 * shards + 8
    )  # receipts; the run's experiment and note, card, four of metadata, the manifest
    for i, _, path in record.renames(out / ".run"):
        if path.endswith(".receipt"):
            shard = f"{out}/data/{Path(path).stem}-"
            renamed = [k for k, _, name in record.renames(out / "data") if name.startswith(shard)]
            assert any(renamed[0] < k < i for k in record.places("fsync", f"{out}/data")), path
    tools.figure(f"F7: {workers} workers: {files} files, {shards} of them shards: {len(bad)} out of order")
    assert not bad, "\n".join(bad)


def test_a_replacement_is_on_the_disk_before_it_counts_and_the_old_files_go_last(
    forks: Any, tools: Any
) -> None:
    out, log = tools.where / "out", tools.where / "log"
    args = ["generate", "--quiet", "--config", tools.tiny, "--out", out, "--workers", 1]
    assert forks.run(*args).code == 0
    assert forks.run(*args, "--overwrite", "--seed", 1, folder=tools.where, log=log).code == 0
    record = Record(log)
    files, bad = out_of_order(record, out / ".next")
    assert not bad, "\n".join(bad)
    (counts,) = record.places("rename", f"{out}/.next", f"{out}/.new")
    assert max(i for i, _, _ in record.renames(out / ".next")) < counts
    for part in (".next", ".next/data", ".next/meta"):
        assert any(i < counts for i in record.places("fsync", f"{out}/{part}")), part
    moves = [
        (i, line[1], line[2]) for i, line in enumerate(record.lines) if line[0] == "rename" and i > counts
    ]
    expected = [
        (f"{out}/.new/data", f"{out}/data"),
        (f"{out}/.new/meta", f"{out}/meta"),
        (f"{out}/.new/README.md", f"{out}/README.md"),
        (f"{out}/.new", f"{out}/.next"),
    ]
    assert [(source, path) for _, source, path in moves] == expected
    for before, after in pairwise([counts, *(i for i, _, _ in moves)]):
        assert any(before < i < after for i in record.places("fsync", str(out)))
    removed = [
        i
        for i, line in enumerate(record.lines)
        if line[0] == "unlink" and re.search(r"/\.next/data/.*\.parquet$", line[1])
    ]
    assert min(removed) > moves[-1][0]
    tools.figure(f"F7, replacing: {files} files written, {len(moves)} moves, 0 out of order")
