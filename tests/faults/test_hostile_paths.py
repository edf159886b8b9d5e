"""F9: unwritable folders, planted symlinks and long names give one line, and nothing outside is touched."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.faults
NOBODY = 65534
PLANTED = ("data", "meta", ".run", ".next", ".new", ".lock")
INNER = (".new/data", ".new/meta", ".next/data", ".next/meta", ".next/.run")
OURS = ("part-00000-01234567.parquet", "x.receipt", "dataset.json", "README.md")


def generate(config: Path, out: Path, *more: object) -> list[object]:
    """A quiet run in one process."""
    return ["generate", "--quiet", "--config", config, "--out", out, "--workers", 1, *more]


def listing(folder: Path) -> dict[str, bytes | None]:
    """Everything in a folder, with the content of files."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


@pytest.fixture
def outside(tools: Any, forks: Any) -> Path:
    """Somebody else's folder: another dataset, and files that have the names of ours."""
    folder = tools.where / "outside"
    assert forks.run(*generate(tools.tiny, folder, "--seed", 9)).code == 0
    for part in (folder, folder / "data", folder / "meta", folder / ".run"):
        part.mkdir(exist_ok=True)
        for name in (
            "precious",
            ".tmp-123-precious",
            "part-00000-01234567.parquet",
            "x.receipt",
            "dataset.json",
            "README.md",
        ):
            if not (part / name).exists():
                (part / name).write_text("precious")
    return folder


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """A folder that everybody may enter, but nobody else may write to."""
    with tempfile.TemporaryDirectory() as name:
        os.chmod(name, 0o755)
        yield Path(name)


def test_a_read_only_folder_gives_one_line_and_stays_as_it_is(
    forks: Any, tools: Any, open_folder: Path
) -> None:
    user = NOBODY if os.geteuid() == 0 else 0
    config = open_folder / "tiny.yaml"
    shutil.copy(tools.tiny, config)
    old = open_folder / "old"
    assert forks.run(*generate(config, old)).code == 0
    (open_folder / "empty").mkdir()
    for folder in (open_folder, old, old / "data", old / "meta", open_folder / "empty"):
        folder.chmod(0o555)
    before = listing(open_folder)
    runs = [
        (open_folder / "new",),
        (open_folder / "a" / "b",),
        (open_folder / "empty",),
        (old, "--overwrite"),
        (old, "--overwrite", "--seed", 1),
        (old, "--resume"),
    ]
    for out, *more in runs:
        answer = forks.run(*generate(config, out, *more), user=user)
        assert answer.code in ((0, 1) if "--resume" in more else (1,)), (out, more, answer)
        assert answer.code == 0 or tools.one_line(answer.output), answer.output
    assert listing(open_folder) == before
    for folder in (open_folder, old, old / "data", old / "meta"):
        folder.chmod(0o755)
    tools.figure(f"F9: {len(runs)} runs as another user in read-only folders: one line, nothing changed")


@pytest.mark.parametrize("more", [[], ["--resume"], ["--overwrite"]], ids=lambda more: "".join(more) or "new")
def test_what_is_no_folder_gives_one_line(forks: Any, tools: Any, outside: Path, more: list[str]) -> None:
    file = tools.file("file", "precious")
    dangling, loop, to_file = (tools.where / name for name in ("dangling", "loop", "to-file"))
    dangling.symlink_to(tools.where / "nowhere")
    loop.symlink_to(loop)
    to_file.symlink_to(file)
    before = listing(tools.where)
    for out in (file, dangling, loop, to_file, file / "below", dangling / "below", loop / "below"):
        answer = forks.run(*generate(tools.tiny, out, *more))
        assert answer.code in (1, 2), (out, answer)
        assert tools.one_line(answer.output), answer.output
    assert listing(tools.where) == before


@pytest.mark.parametrize("more", [[], ["--resume"], ["--overwrite"]], ids=lambda more: "".join(more) or "new")
def test_an_out_that_links_to_a_folder_with_other_files_leaves_it_as_it_is(
    forks: Any, tools: Any, outside: Path, more: list[str]
) -> None:
    link = tools.where / "link"
    link.symlink_to(outside)
    before = listing(outside)
    answer = forks.run(*generate(tools.tiny, link, *more))
    assert answer.code == 2, answer
    assert tools.one_line(answer.output), answer.output
    assert listing(outside) == before


@pytest.mark.parametrize("name", [*PLANTED, *INNER])
@pytest.mark.parametrize("state", ["unfinished", "finished", "empty"])
def test_a_planted_link_to_a_folder_is_never_followed_to_write_or_delete(
    forks: Any, tools: Any, outside: Path, name: str, state: str
) -> None:
    wrong = []
    before = listing(outside)
    for i, more in enumerate((["--resume"], ["--overwrite", "--seed", 1], [])):
        out = tools.where / f"out-{i}"
        if state == "empty":
            out.mkdir()
        else:
            at = 30 if state == "unfinished" else 0
            made = forks.run(*generate(tools.tiny, out), folder=out, at=at, mode="before")
            assert made.code == (-9 if at else 0), made
        target = out / name
        if target.is_dir():
            shutil.rmtree(target)
        target.unlink(missing_ok=True)
        target.parent.mkdir(exist_ok=True)
        source = outside / "data" if name.endswith("data") else outside
        target.symlink_to(source / "meta" if name.endswith("meta") else source)
        answer = forks.run(*generate(tools.tiny, out, *more))
        if answer.code not in (0, 1, 2) or (answer.code and not tools.one_line(answer.output)):
            wrong.append(f"{more}: {answer}")
        after = listing(outside)
        changed = sorted(key for key in {*before, *after} if before.get(key, 0) != after.get(key, 0))
        if changed:
            wrong.append(f"{more}: exit {answer.code}: outside the folder changed: {changed}")
            break
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize(
    "name", ["data/part-00001-01234567.parquet", "meta/statistics.json", "README.md", ".run/x.receipt"]
)
def test_a_planted_link_to_a_file_is_replaced_and_not_written_through(
    forks: Any, tools: Any, name: str
) -> None:
    precious = tools.file("precious", "precious")
    for i, more in enumerate((["--resume"], ["--overwrite"])):
        out = tools.where / f"out-{i}"
        assert forks.run(*generate(tools.tiny, out), folder=out, at=30, mode="before").code == -9
        (out / name).parent.mkdir(exist_ok=True)
        (out / name).unlink(missing_ok=True)
        (out / name).symlink_to(precious)
        answer = forks.run(*generate(tools.tiny, out, *more))
        assert answer.code == 0, answer
        assert precious.read_text() == "precious"
        assert tools.root(out)
        assert tools.leftovers(out) == []


def test_a_name_of_255_bytes_is_written_and_a_longer_one_gives_one_line(forks: Any, tools: Any) -> None:
    out = tools.where / ("n" * 255)
    assert forks.run(*generate(tools.tiny, out)).code == 0
    assert tools.root(out)
    assert tools.leftovers(out) == []
    deep = tools.where
    while len(str(deep)) < 3900:
        deep = deep / ("d" * 200)
    deep = deep / ("d" * (4060 - len(str(deep))))  # its name fits, those of its files do not
    for wrong in (tools.where / ("n" * 256), tools.where / ("n" * 5000), deep):
        for more in ([], ["--resume"], ["--overwrite"], ["--dry-run"]):
            answer = forks.run(*generate(tools.tiny, wrong, *more))
            if answer.code != 0 or "--dry-run" not in more:
                assert answer.code in (1, 2), answer
                assert tools.one_line(answer.output), answer.output
    assert sorted(path.name for path in tools.where.iterdir()) == [out.name, "tiny.yaml"]
