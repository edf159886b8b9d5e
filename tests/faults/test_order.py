"""F7: the order in which files reach the disk, from the recorded operations of whole runs."""

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


def not_on_disk(record: Record, folder: Path, before: int) -> list[str]:
    """Files and folders below a folder whose content or name was not synced before an operation."""
    bad = []
    for path in {line[1] for line in record.lines[:before] if line[0] == "write"}:
        if not path.startswith(f"{folder}/") or record.places("unlink", path):
            continue
        written, synced = max(record.places("write", path)), record.places("fsync", path)
        if not any(written < k < before for k in synced):
            bad.append(f"{path}: its content")
        for inner in Path(path).parents:
            name = record.places("fsync", str(inner))
            if not any(min(record.places("create", path)) < k < before for k in name):
                bad.append(f"{path}: its name in {inner}")
            if inner == folder:
                break
    return bad


@pytest.mark.parametrize("replaces", [False, True])
def test_all_is_on_disk_before_its_name(forks: Any, tools: Any, replaces: bool) -> None:
    """A dataset gets its name when its files are on the disk, and the old files go when the name is, too."""
    out, log = tools.where / "out", tools.where / "log"
    part = out.with_name(".out.part")
    if replaces:
        assert forks.run(*tools.args(tools.many, out)).code == 0
    more = ["--overwrite", "--seed", 1] if replaces else []
    assert forks.run(*tools.args(tools.many, out, *more), folder=tools.where, log=log).code == 0
    record = Record(log)
    (named,) = record.places("rename", f"{part}/dataset", str(out))
    bad = not_on_disk(record, part / "dataset", named)
    assert not bad, "\n".join(bad)
    on_disk = min(k for k in record.places("fsync", str(tools.where)) if k > named)
    for i, (operation, *path) in enumerate(record.lines):
        old = operation == "unlink" and path[0].endswith(".parquet")
        assert not old or i > on_disk, path
    tools.figure(f"F7, {'replaced' if replaces else 'new'}: {len(record.lines)} operations, 0 out of order")
