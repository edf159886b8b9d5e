"""F5: a full disk, a limit on file sizes, and little memory."""

import os
import resource
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.faults


def limited(size: int) -> Any:
    """To run in a child: no file may grow beyond size."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


@pytest.mark.parametrize("workers", [1, 2])
def test_a_file_size_limit_gives_one_line_and_the_run_completes_once_it_is_lifted(
    tools: Any, whole: Any, workers: int
) -> None:
    root, shards = whole
    sizes = []
    for size in (0, 1, 4000, 16_000, 20_000, 24_000) if tools.full else (0, 4000, 20_000):
        out = tools.where / f"out-{size}"
        made = tools.generate(tools.many, out, "--workers", workers, preexec_fn=limited(size))
        if made.returncode == 0:
            continue
        sizes.append(size)
        assert made.returncode == 1, (size, made)
        assert tools.one_line(made.stderr), (size, made.stderr)
        assert tools.torn(out, shards) == []
        assert [name for name in tools.leftovers(out) if ".tmp-" in name or ".lock" in name] == []
        again = tools.generate(tools.many, out, "--resume", "--workers", workers)
        assert again.returncode == 0, (size, again.stderr)
        assert tools.root(out) == root
        assert tools.leftovers(out) == []
    tools.figure(f"F5: {workers} workers: exit 1, one line and resumable at file size limits {sizes}")
    assert len(sizes) >= 3


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


def test_a_full_disk_gives_one_line_and_the_run_completes_once_space_is_freed(
    tools: Any, whole: Any, small_disk: Path
) -> None:
    root, shards = whole
    out, free = small_disk / "out", []
    steps = (0, 100, 200, 300, 400) if tools.full else (0, 300)
    for filled in steps:
        (small_disk / "filler").write_bytes(bytes(filled * 1000))
        made = tools.generate(tools.many, out, "--workers", 2)
        assert made.returncode == 1, made
        assert tools.one_line(made.stderr), made.stderr
        assert tools.torn(out, shards) == []
        assert [name for name in tools.leftovers(out) if ".tmp-" in name or ".lock" in name] == []
        free.append(len(tools.hashes(out)))
        shutil.rmtree(out, ignore_errors=True)
    (small_disk / "filler").unlink()
    assert tools.generate(tools.many, out, "--workers", 2).returncode == 1
    subprocess.run(["mount", "-o", "remount,size=50m", str(small_disk)], check=True)
    resumed = tools.generate(tools.many, out, "--resume")
    assert resumed.returncode == 0, resumed.stderr
    assert tools.root(out) == root
    assert tools.leftovers(out) == []
    tools.figure(f"F5, full disk: {len(steps) + 1} runs: exit 1, one line; {free} whole shards kept; resumed")


def test_too_little_memory_gives_one_line(forks: Any, tools: Any) -> None:
    large = tools.file(
        "large.yaml",
        "name: large\nsetpoints: 50\npolicies: [{kind: random}]\nepisodes: 64\nsteps: 1000000\n"
        "output: {shard_rows: 64000000}\n",
    )
    out = tools.where / "out"
    args = ["generate", "--quiet", "--config", large, "--out", out, "--workers", 1]
    answer = forks.run(*args, megabytes=3000)
    assert answer.code == 1, answer
    assert tools.one_line(answer.output), answer.output
    assert not out.exists()
