"""F2 and F10: each operation on the folder fails, or is the last before a kill; then the run is resumed."""

import shutil
from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.faults
KILLED = -9
HALVES = (1, 2)  # of the faults, for two processes of pytest
FAILURES = ("ENOSPC", "EIO", "full")  # full: from here on nothing more can be written


def modes_of(operation: str, k: int, full: bool) -> list[str]:
    """The faults that an operation can meet; in CI one of the failures, and one kill, in turn."""
    writes = operation in ("write", "create", "mkdir")
    failures = ["ENOSPC", "EIO", *(["full"] if writes else [])] if operation != "unlink" else ["EIO"]
    kills = ["before", "after", *(["half"] if operation == "write" else [])]
    return failures + kills if full else [failures[k % len(failures)], kills[k % len(kills)], kills[-1]]


def faults(
    forks: Any, tools: Any, folder: Path, args: list[object], exchange: bool = True
) -> list[tuple[int, str, str]]:
    """Every (k, mode, operation) of a run in the folder."""
    log = tools.where / f"log-{folder.name}"
    assert forks.run(*args, folder=folder, log=log, exchange=exchange).code == 0
    lines = log.read_text().splitlines()
    return [
        (k, mode, line)
        for k, line in zip(count(1), lines, strict=False)
        for mode in dict.fromkeys(modes_of(line.split()[0].lstrip("-"), k, tools.full))
    ]


def struck(
    forks: Any,
    prepare: Callable[[], object],
    args: list[object],
    folder: Path,
    k: int,
    mode: str,
    exchange: bool = True,
) -> Any:
    """The answer of a run that met a fault at its k-th operation.

    Threads take turns as they like, so that the k-th may be one that the fault cannot strike: then again.
    """
    for _ in range(50):
        prepare()
        answer = forks.run(*args, folder=folder, at=k, mode=mode, exchange=exchange)
        if mode in FAILURES or answer.code == KILLED:
            break
    return answer


def generate(config: Path, out: Path, *more: object) -> list[object]:
    """A quiet run in one process."""
    return ["generate", "--quiet", "--config", config, "--out", out, "--workers", 1, *more]


@pytest.mark.parametrize("half", HALVES)
def test_after_any_failed_or_last_operation_of_a_new_run_it_is_resumed_to_the_same_dataset(
    forks: Any, tools: Any, half: int
) -> None:
    base = tools.where / "new"
    base.mkdir()
    out = base / "out"
    cases = faults(forks, tools, base, generate(tools.tiny, out))[half - 1 :: 2]
    root, shards = tools.root(out), tools.hashes(out)
    wrong = []
    for k, mode, line in cases:
        args = generate(tools.tiny, out)
        answer = struck(forks, lambda: shutil.rmtree(out, ignore_errors=True), args, base, k, mode)
        case, bad = f"{mode} at {k}: {line}: ".replace(f"{base}/", ""), []
        killed = mode not in FAILURES
        if killed and answer.code != KILLED:
            bad.append(f"the fault did not happen: {answer}")
        if not killed and answer.code not in (0, 1):
            bad.append(f"exit code {answer.code}: {answer.output}")
        if answer.code == 1 and not tools.one_line(answer.output):
            bad.append(f"not one line: {answer.output}")
        finished = (out / "meta" / "manifest.json").exists()
        if answer.code == 0 and not finished:
            bad.append("exit 0 without a manifest")
        if finished and tools.root(out) != root:
            bad.append("finished with another root")
        if torn := tools.torn(out, shards):
            bad.append(f"torn: {torn}")
        temporary = [name for name in tools.leftovers(out) if ".tmp-" in name]
        if not killed and temporary and "unlink" not in line.split()[0]:
            bad.append(f"left behind: {temporary}")
        again = forks.run(*generate(tools.tiny, out, "--resume"))
        if again.code != 0:
            bad.append(f"cannot be resumed: {again}")
        elif tools.root(out) != root:
            bad.append("resumed to another root")
        elif left := tools.leftovers(out):
            bad.append(f"left after the resume: {left}")
        wrong += [case + what for what in bad]
    tools.figure(
        f"F2, half {half}: {len(cases)} faults at {len({k for k, _, _ in cases})} operations, "
        f"{len(wrong)} violations"
    )
    assert not wrong, "\n".join(wrong).replace(f"{base}/", "")


def seen_by_readers(
    tools: Any, out: Path, old: dict[str, Any], new: dict[str, Any], whole: bool
) -> list[str]:
    """Readers that find neither the old dataset nor the new one.

    An error is allowed where none is whole, and readers from outside may fail on the file of text that is
    there while the folders change places.
    """
    from ibdata.dataset.manifest import BAR

    bad = []
    barred = any(path.read_bytes() == BAR for path in (out / "data").glob("part-*"))
    for name, found in tools.rewards(out).items():
        fails = found is None and (not whole or (barred and name != "ibdata"))
        if found not in (old[name], new[name]) and not fails:
            bad.append(f"{name} found {found if found is None else len(found)} rows of neither dataset")
    return bad


@pytest.mark.parametrize("half", HALVES)
@pytest.mark.parametrize(
    ("other", "exchange"),
    [("same shape", True), ("fewer shards", True), ("more shards", True), ("same shape", False)],
)
def test_at_any_failed_or_last_operation_of_a_replacement_every_reader_finds_the_old_dataset_or_the_new_one(
    forks: Any, tools: Any, other: str, exchange: bool, half: int
) -> None:
    from ibdata.validation.validate import validate

    base = tools.where / "replaced"
    base.mkdir()
    out, kept = base / "out", tools.where / "kept"
    shape = {
        "same shape": [],
        "fewer shards": ["--set", "episodes=1"],
        "more shards": ["--set", "episodes=3"],
    }
    new = [*shape[other], "--seed", 1, "--overwrite"]
    assert forks.run(*generate(tools.tiny, kept)).code == 0
    old_root, old_rows = tools.root(kept), tools.rewards(kept)
    shutil.copytree(kept, out)
    cases = faults(forks, tools, base, generate(tools.tiny, out, *new), exchange=exchange)
    root, rows = tools.root(out), tools.rewards(out)
    if (other != "same shape" or not exchange) and not tools.full:
        cases = cases[-50:]  # what differs is how it settles
    cases = cases[half - 1 :: 2]

    def restore() -> None:
        shutil.rmtree(out)
        shutil.copytree(kept, out)

    wrong, still_old, unsettled = [], 0, 0
    for k, mode, line in cases:
        args = generate(tools.tiny, out, *new)
        answer = struck(forks, restore, args, base, k, mode, exchange=exchange)
        case, bad = f"{mode} at {k}: {line}: ".replace(f"{base}/", ""), []
        killed = mode not in FAILURES
        if killed and answer.code != KILLED:
            bad.append(f"the fault did not happen: {answer}")
        if not killed and answer.code not in (0, 1):
            bad.append(f"exit code {answer.code}: {answer.output}")
        if answer.code == 1 and not tools.one_line(answer.output):
            bad.append(f"not one line: {answer.output}")
        problems = validate(out)
        settling = [problem.rule for problem in problems] == ["unsettled"]
        unsettled += settling
        bad += [str(problem) for problem in problems if not settling]
        bad += seen_by_readers(tools, out, old_rows, rows, exchange or not settling)
        if settling:
            settled = forks.run("repair", out)
            bad += [] if settled.code == 0 else [f"cannot be settled: {settled}"]
        found = tools.root(out)
        still_old += found == old_root
        if found not in (old_root, root) or (settling and found != root):
            bad.append("neither the old root nor the new one")
        if answer.code == 0 and found != root:
            bad.append("exit 0, and the old root")
        again = forks.run(*generate(tools.tiny, out, *new))
        if again.code != 0:
            bad.append(f"cannot be overwritten: {again}")
        elif tools.root(out) != root:
            bad.append("overwritten with another root")
        elif left := tools.leftovers(out):
            bad.append(f"left after the next --overwrite: {left}")
        wrong += [case + what for what in bad]
    tools.figure(
        f"F10, {other}, {'one call' if exchange else 'two calls'}, half {half}: {len(cases)} faults: "
        f"{still_old} times the old dataset was whole, {len(cases) - still_old} times the new one, "
        f"{unsettled} of them after `repair` had settled it; five readers each: {len(wrong)} violations"
    )
    assert not wrong, "\n".join(wrong).replace(f"{base}/", "")
