"""F5: a full disk, a limit on file sizes, and little memory."""

import os
import resource
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.faults


def assert_ended_well(tools: Any, out: Path, made: Any) -> None:
    """One line, no dataset, and an unfinished run only if it can be resumed."""
    assert made.returncode == 1, made
    assert tools.one_line(made.stderr), made.stderr
    assert not out.exists()
    assert bool(tools.leftovers(out)) == bool(tools.receipts(out))


@pytest.mark.parametrize("workers", [1, 2])
def test_a_limit_of_file_sizes(tools: Any, whole: Any, workers: int) -> None:
    """A file that may not grow ends the run with one line; it completes once the limit is lifted."""
    sizes = []
    for size in (0, 1, 4000, 16_000, 20_000, 24_000) if tools.full else (0, 4000, 20_000):
        out = tools.where / f"out-{size}"
        made = tools.generate(
            tools.many, out, "--workers", workers,
            preexec_fn=lambda size=size: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)),
        )  # fmt: skip
        if made.returncode == 0:
            continue
        sizes.append(size)
        assert_ended_well(tools, out, made)
        again = tools.generate(tools.many, out, "--resume", "--workers", workers)
        assert again.returncode == 0, (size, again.stderr)
        assert tools.root(out) == whole[0]
        assert tools.leftovers(out) == []
    tools.figure(f"F5: {workers} workers: exit 1, one line and resumable at file size limits {sizes}")
    assert len(sizes) >= 2


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of its own, of 500 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=500k", "faults", str(disk)], capture_output=True, text=True
    )
    if mounted.returncode != 0:
        assert os.geteuid() != 0 or "permi" in mounted.stderr or "denied" in mounted.stderr, mounted.stderr
        pytest.skip("no file system can be mounted here; the shim's mode `full` is a full disk too")
    try:
        yield disk
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk(tools: Any, whole: Any, small_disk: Path) -> None:
    """A full disk ends the run with one line; it completes once there is space."""
    out, kept = small_disk / "out", []
    for filled in (0, 100, 200, 300, 400) if tools.full else (300, 0):
        (small_disk / "filler").write_bytes(bytes(filled * 1000))
        assert_ended_well(tools, out, tools.generate(tools.many, out, "--resume"))
        kept.append(tools.receipts(out))
    (small_disk / "filler").unlink()
    subprocess.run(["mount", "-o", "remount,size=50m", str(small_disk)], check=True)
    resumed = tools.generate(tools.many, out, "--resume")
    assert resumed.returncode == 0, resumed.stderr
    assert tools.root(out) == whole[0]
    assert tools.leftovers(out) == []
    tools.figure(f"F5, full disk: exit 1, one line; {kept} whole shards kept; resumed")


def test_too_little_memory_gives_one_line(forks: Any, tools: Any) -> None:
    """A shard that does not fit ends the run with one line, and leaves nothing."""
    large = tools.file(
        "large.yaml",
        "name: large\nsetpoints: 50\npolicies: [{kind: random}]\nepisodes: 64\nsteps: 1000000\n"
        "output: {shard_rows: 64000000}\n",
    )
    out = tools.where / "out"
    answer = forks.run(*tools.args(large, out), megabytes=3000)
    assert answer.code == 1, answer
    assert tools.one_line(answer.output), answer.output
    assert not out.exists()
    assert tools.leftovers(out) == []
