"""What stands in the place of a part or in it: leftovers of other runs, damaged receipts, files of a user."""

import shutil
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.faults


@pytest.fixture
def unfinished(forks: Any, tools: Any) -> Path:
    """The place of a run of which all shards are finished."""
    out = tools.where / "out"
    assert forks.run(*tools.args(tools.tiny, out, "--shards", "1/1")).code == 0
    return out


@pytest.fixture
def root(forks: Any, tools: Any) -> str:
    """The content root of the same run, undisturbed."""
    fresh = tools.where / "fresh"
    assert forks.run(*tools.args(tools.tiny, fresh)).code == 0
    return tools.root(fresh)  # type: ignore[no-any-return]


@pytest.mark.parametrize("pattern", ["receipts/*1.*", "dataset/data/part-00001*"])
def test_damage_in_a_part_costs_its_shard(
    forks: Any, tools: Any, unfinished: Path, root: str, pattern: str
) -> None:
    """A shard is missing, and made again, if its receipt or its file is not whole."""
    part, kept = tools.where / ".out.part", tools.where / "kept"
    part.rename(kept)
    (name,) = (path.relative_to(kept) for path in kept.glob(pattern))
    whole = (kept / name).read_bytes()
    for content in (b"", whole[:31], whole[:-1], b"\0" * 100, None):
        shutil.copytree(kept, part)
        (part / name).unlink()
        if content is not None:
            (part / name).write_bytes(content)
        early = forks.run("finalize", unfinished)
        assert early.code == 1, early
        assert "1 of 2 shards" in early.output
        answer = forks.run(*tools.args(tools.tiny, unfinished, "--resume"))
        assert answer.code == 0, (content, answer)
        assert tools.root(unfinished) == root
        assert tools.leftovers(unfinished) == []
        shutil.rmtree(unfinished)


@pytest.mark.parametrize("name", ["", "lock", "run.json", "receipts", "dataset"])
@pytest.mark.parametrize("kind", ["file", "folder", "link"])
def test_what_stands_in_the_place_of_ours(forks: Any, tools: Any, name: str, kind: str) -> None:
    """One line, or the dataset; what a link in the place of a part or its lock leads to is never touched."""
    mine, out = tools.where / "mine", tools.where / "out"
    mine.mkdir()
    (mine / "precious").write_text("precious")
    assert forks.run(*tools.args(tools.tiny, out, "--shards", "1/2")).code == 0
    path = tools.where / ".out.part" / name
    if path.is_dir():
        shutil.rmtree(path)
    path.unlink(missing_ok=True)
    if kind == "file":
        path.write_text("precious")
    elif kind == "folder":
        shutil.copytree(mine, path)
    else:
        path.symlink_to(mine)
    for more in (["--resume"], ["--overwrite"], ["--overwrite", "--seed", 1]):
        answer = forks.run(*tools.args(tools.tiny, out, *more))
        assert answer.code in (0, 1, 2, 3), answer
        assert "Traceback" not in answer.output
        assert "a bug of ibdata" not in answer.output
        if name in ("", "lock"):
            assert [file.read_text() for file in mine.iterdir()] == ["precious"]
    assert answer.code or tools.root(out)
