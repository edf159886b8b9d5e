"""Leftovers of a killed run, found by the next run of the same or another experiment, or by a reader."""

import re
import shutil
import threading
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from ibdata.validation.validate import validate

pytestmark = pytest.mark.faults
MORE = ["--set", "episodes=5"]  # five shards instead of two
FEWER = ["--set", "episodes=1"]  # one


def generate(config: Path, out: Path, *more: object) -> list[object]:
    """A quiet run in one process."""
    return ["generate", "--quiet", "--config", config, "--out", out, "--workers", 1, *more]


def killed_after(forks: Any, tools: Any, out: Path, args: list[object], ending: str, where: str) -> None:
    """Kill a run after the last operation whose record begins so and ends with this pattern."""
    trial, log = tools.where / "trial", tools.where / "trial-log"
    if out.exists():
        shutil.copytree(out, trial)
    forks.run(*[trial if arg == out else arg for arg in args], folder=trial, log=log)
    lines = log.read_text().splitlines()
    at = max(i for i, line in enumerate(lines, 1) if re.search(f"^{ending} .*{where}$", line))
    shutil.rmtree(trial)
    log.unlink()
    assert forks.run(*args, folder=out, at=at, mode="after").code == -9


MOMENTS = {
    "its folder": ("mkdir", r"\.next"),
    "a shard": ("rename", r"part-00001-\w{8}\.parquet"),
    "the card": ("rename", r"\.next/README\.md"),
    "its manifest": ("rename", r"\.next/meta/manifest\.json"),
    "a receipt removed": ("unlink", r"\.receipt"),
    "the receipts removed": ("rmdir", r"\.next/\.run"),
}


@pytest.mark.parametrize("then", [["--seed", 2], FEWER, [*MORE, "--seed", 4]], ids=["same", "fewer", "more"])
@pytest.mark.parametrize("moment", MOMENTS)
def test_what_a_killed_replacement_left_does_not_disturb_that_by_another_experiment(
    forks: Any, tools: Any, moment: str, then: list[object]
) -> None:
    out = tools.where / "out"
    assert forks.run(*generate(tools.tiny, out)).code == 0
    killed_after(forks, tools, out, generate(tools.tiny, out, "--overwrite", *MORE), *MOMENTS[moment])
    assert tools.root(out)
    answer = forks.run(*generate(tools.tiny, out, "--overwrite", *then))
    assert answer.code == 0, answer
    fresh = tools.where / "fresh"
    assert forks.run(*generate(tools.tiny, fresh, *then)).code == 0
    assert tools.root(out) == tools.root(fresh)
    assert tools.leftovers(out) == []
    assert tools.hashes(out) == tools.hashes(fresh)


@pytest.mark.parametrize("then", ["--resume old", "--resume new", "--overwrite other", "repair"])
@pytest.mark.parametrize("size", [FEWER, MORE, []], ids=["fewer", "more", "same"])
def test_a_replacement_killed_when_it_counts_is_settled_by_whoever_comes_next(
    forks: Any, tools: Any, size: list[str], then: str
) -> None:
    out, fresh = tools.where / "out", tools.where / "fresh"
    new = [*size, "--seed", 1]
    assert forks.run(*generate(tools.tiny, out)).code == 0
    assert forks.run(*generate(tools.tiny, fresh, *new)).code == 0
    killed_after(forks, tools, out, generate(tools.tiny, out, "--overwrite", *new), "rename", r"/\.new")
    (problem,) = validate(out)
    assert (problem.path, problem.rule) == (".new", "unsettled")
    assert f"ibdata repair {out}" in problem.message
    if then == "--resume old":
        answer = forks.run(*generate(tools.tiny, out, "--resume"))
        assert answer.code == 2, answer
        assert tools.root(out) == tools.root(fresh)
        return
    if then == "repair":
        answer = forks.run("repair", out)
    elif then == "--resume new":
        answer = forks.run(*generate(tools.tiny, out, "--resume", *new))
    else:
        shutil.rmtree(fresh)
        assert forks.run(*generate(tools.tiny, fresh, "--seed", 5)).code == 0
        answer = forks.run(*generate(tools.tiny, out, "--overwrite", "--seed", 5))
    assert answer.code == 0, answer
    assert tools.root(out) == tools.root(fresh)
    assert tools.hashes(out) == tools.hashes(fresh)
    assert tools.leftovers(out) == []


def test_receipts_of_another_run_are_not_believed(forks: Any, tools: Any) -> None:
    out, other, fresh = (tools.where / name for name in ("out", "other", "fresh"))
    for folder, seed in ((out, 0), (other, 1)):
        kill = ("rename", "meta/manifest.json")
        killed_after(forks, tools, folder, generate(tools.tiny, folder, "--seed", seed), *kill)
        (folder / "meta" / "manifest.json").unlink()
    for name in ("part-00000.receipt", "part-00001.receipt"):
        shutil.copy(other / ".run" / name, out / ".run" / name)
    shutil.copytree(other / "data", out / "data", dirs_exist_ok=True)
    assert forks.run(*generate(tools.tiny, out, "--resume")).code == 0
    assert forks.run(*generate(tools.tiny, fresh)).code == 0
    assert tools.hashes(out) == tools.hashes(fresh)
    assert tools.root(out) == tools.root(fresh)


def test_receipts_that_are_damaged_cost_only_their_shards(forks: Any, tools: Any) -> None:
    out = tools.where / "out"
    killed_after(forks, tools, out, generate(tools.tiny, out), "rename", "meta/manifest.json")
    (out / "meta" / "manifest.json").unlink()
    kept = tools.where / "kept"
    shutil.copytree(out, kept)
    whole = (kept / ".run" / "part-00001.receipt").read_bytes()
    root = None
    for content in (b"", whole[:31], whole[:40], whole[:-1], b"\0" * 100, whole[:50] + b"x" + whole[51:]):
        shutil.rmtree(out)
        shutil.copytree(kept, out)
        (out / ".run" / "part-00001.receipt").write_bytes(content)
        answer = forks.run(*generate(tools.tiny, out, "--resume"))
        assert answer.code == 0, (content, answer)
        root = root or tools.root(out)
        assert tools.root(out) == root


@pytest.mark.parametrize(
    "name", ["data/part-00001.parquet", "meta/manifest.json", "README.md", ".lock", ".next"]
)
def test_a_folder_or_file_in_the_place_of_ours_gives_one_line(forks: Any, tools: Any, name: str) -> None:
    for i, more in enumerate((["--resume"], ["--overwrite", "--seed", 1])):
        out = tools.where / f"out-{i}"
        assert forks.run(*generate(tools.tiny, out), folder=out, at=30, mode="before").code == -9
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).unlink(missing_ok=True)
        (out / name).mkdir()
        (out / name / "precious").write_text("precious")
        answer = forks.run(*generate(tools.tiny, out, *more))
        assert answer.code in (0, 1, 2), answer
        assert answer.code == 0 or tools.one_line(answer.output), answer.output
        assert (out / name / "precious").read_text() == "precious"


def test_a_reader_beside_replacements_always_finds_a_dataset(forks: Any, tools: Any) -> None:
    from ibdata.dataset.reader import Dataset

    out = tools.where / "out"
    assert forks.run(*generate(tools.tiny, out)).code == 0
    failures: list[str] = []
    opened, done = 0, threading.Event()

    def read() -> None:
        nonlocal opened
        while not done.is_set():
            try:
                assert Dataset(out).info["counts"]
                opened += 1
            except Exception as error:
                failures.append(f"{type(error).__name__}: {error}")

    reader = threading.Thread(target=read)
    reader.start()
    for seed in range(1, tools.size(20, 200)):
        assert forks.run(*generate(tools.tiny, out, "--overwrite", "--seed", seed)).code == 0
    done.set()
    reader.join()
    tools.figure(f"F10, reading meanwhile: {opened} times opened, {len(failures)} times not")
    assert failures == []


def test_what_is_read_beside_replacements_is_one_dataset_or_an_error_and_never_a_mixture(
    forks: Any, tools: Any
) -> None:
    from ibdata.errors import IbdataError

    out, known = tools.where / "out", []
    for seed in (0, 1):
        fresh = tools.where / f"fresh-{seed}"
        assert forks.run(*generate(tools.tiny, fresh, *MORE, "--seed", seed)).code == 0
        known.append(tools.rewards(fresh)["ibdata"])
    assert forks.run(*generate(tools.tiny, out, *MORE)).code == 0
    found: dict[str, Counter[str]] = {}
    done = threading.Event()

    def read() -> None:
        while not done.is_set():
            for name, rewards in tools.rewards(out).items():
                what = "an error" if rewards is None else "one" if rewards in known else "a mixture"
                found.setdefault(name, Counter())[what] += 1
            try:
                problems = validate(out)
                what = "valid" if not problems else f"a false alarm: {problems[0]}"
            except IbdataError as error:
                what = "busy" if error.exit_code == 75 else f"an error: {error}"
            found.setdefault("validate", Counter())[what] += 1

    reader = threading.Thread(target=read)
    reader.start()
    for i in range(tools.size(40, 400)):
        args = generate(tools.tiny, out, "--overwrite", *MORE, "--seed", 1 - i % 2)
        assert forks.run(*args, readers=True).code == 0
    done.set()
    reader.join()
    tools.figure(f"F10, read meanwhile: { {name: dict(counts) for name, counts in found.items()} }")
    assert all(set(counts) <= {"one", "an error"} for name, counts in found.items() if name != "validate")
    assert all(counts["one"] for name, counts in found.items() if name != "validate"), found
    assert set(found["validate"]) <= {"valid", "busy"}, found
    assert found["ibdata"]["one"] > found["ibdata"]["an error"]


def test_a_merge_that_is_killed_is_nothing_or_whole_and_can_be_merged_again_or_settled(
    forks: Any, tools: Any
) -> None:
    base = tools.where / "merging"
    base.mkdir()
    parts, out, log = [tools.where / "a", tools.where / "b"], base / "both", tools.where / "log"
    for seed, part in enumerate(parts):
        assert forks.run(*generate(tools.tiny, part, "--seed", seed)).code == 0
    args = ["merge", *parts, "--out", out]
    assert forks.run(*args, folder=base, log=log).code == 0
    root, rows = tools.root(out), tools.rewards(out)
    lines = log.read_text().splitlines()
    counts = next(i for i, line in enumerate(lines, 1) if line.endswith(".next " + str(out / ".new")))
    wrong, cases = [], 0
    for k in range(counts - 6, len(lines) + 1):
        for mode in ("before", "after") if tools.full else ("after",):
            shutil.rmtree(out, ignore_errors=True)
            assert forks.run(*args, folder=base, at=k, mode=mode).code == -9
            case, cases = f"{mode} {k}: {lines[k - 1]}: ".replace(f"{base}/", ""), cases + 1
            problems = {problem.rule for problem in validate(out)}
            if problems - {"unsettled", "manifest"}:
                wrong.append(f"{case}{problems}")
            for name, found in tools.rewards(out).items():
                if found not in (None, rows[name]) or (found is None and not problems):
                    wrong.append(f"{case}{name} finds other rows")
            placed = (out / "meta" / "manifest.json").exists()
            answer = forks.run("repair", out) if k % 2 and "manifest" not in problems else forks.run(*args)
            if placed and not k % 2:  # then it is there, and merging again would replace it
                done = "finishes" if problems else "choose another"
                wrong += [] if answer.code == 2 and done in answer.output else [f"{case}{answer}"]
                answer = forks.run("repair", out)
            if answer.code != 0:
                wrong.append(f"{case}{answer}")
            elif tools.root(out) != root or (problems and tools.leftovers(out)):
                wrong.append(f"{case}another root, or {tools.leftovers(out)}")
    tools.figure(f"F10, merging: {cases} kills, {len(wrong)} violations")
    assert not wrong, "\n".join(wrong)
