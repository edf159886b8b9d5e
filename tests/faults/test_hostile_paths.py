"""F9: unwritable folders, links and long names give one line, and nothing outside is touched."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.faults
NOBODY = 65534


def listing(folder: Path) -> dict[str, bytes | None]:
    """Everything in a folder, with the content of files."""
    return {
        str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None
        for path in folder.rglob("*")
    }


@pytest.fixture
def open_folder() -> Iterator[Path]:
    """A folder that everybody may enter, but nobody else may write to."""
    with tempfile.TemporaryDirectory() as name:
        os.chmod(name, 0o755)
        yield Path(name)


def test_read_only_folders(forks: Any, tools: Any, open_folder: Path) -> None:
    """What may not be written gives one line and stays; a dataset that is already there needs no right."""
    user = NOBODY if os.geteuid() == 0 else 0
    config, old = open_folder / "tiny.yaml", open_folder / "old"
    shutil.copy(tools.tiny, config)
    assert forks.run(*tools.args(config, old)).code == 0
    (open_folder / "empty").mkdir()
    for folder in (open_folder, old, old / "data", old / "meta", open_folder / "empty"):
        folder.chmod(0o555)
    before = listing(open_folder)
    for name in ("new", "a/b", "empty"):
        answer = forks.run(*tools.args(config, open_folder / name), user=user)
        assert answer.code == 1, (name, answer)
        assert tools.one_line(answer.output), answer.output
    for more in (["--overwrite"], ["--overwrite", "--seed", 1]):
        answer = forks.run(*tools.args(config, old, *more), user=user)
        assert answer.code == 2, answer
        assert tools.one_line(answer.output), answer.output
    for more in ([], ["--resume"]):
        assert forks.run(*tools.args(config, old, *more), user=user).code == 0
    for command in ("card", "repair", "split --by episode --fractions 0.5,0.5"):
        name, *options = command.split()
        answer = forks.run(name, old, *options, user=user)
        assert answer.code in (0, 1, 2), answer
        assert answer.code == 0 or tools.one_line(answer.output), answer.output
    assert listing(open_folder) == before
    for folder in (open_folder, old, old / "data", old / "meta"):
        folder.chmod(0o755)
    tools.figure("F9: 10 runs as another user in read-only folders: one line, nothing changed")


@pytest.mark.parametrize("name", ["meta/manifest.json", "meta/splits.json", "README.md"])
def test_links_in_a_dataset_are_not_written_through(forks: Any, tools: Any, name: str) -> None:
    """A dataset's files may be links, as in a cache: no command changes what they lead to."""
    out, elsewhere = tools.where / "out", tools.where / "elsewhere"
    assert forks.run(*tools.args(tools.tiny, out)).code == 0
    (out / name).rename(elsewhere)
    (out / name).symlink_to(elsewhere)
    before = elsewhere.read_bytes()
    split = ["split", out, "--by", "episode", "--fractions", "0.5,0.5"]
    for args in (split, ["card", out], ["repair", out], tools.args(tools.tiny, out, "--overwrite")):
        answer = forks.run(*args)
        assert answer.code == 0, answer
        assert elsewhere.read_bytes() == before
        assert tools.root(out)


def test_long_names(forks: Any, tools: Any) -> None:
    """A name as long as its part's may be is written, and a longer one gives one line."""
    out = tools.where / ("n" * 249)  # the part is .NAME.part
    assert forks.run(*tools.args(tools.tiny, out)).code == 0
    assert tools.root(out)
    deep = tools.where
    while len(str(deep)) < 3900:
        deep = deep / ("d" * 200)
    deep = deep / ("d" * (4060 - len(str(deep))))  # its name fits, those of its files do not
    for wrong in (tools.where / ("n" * 250), tools.where / ("n" * 5000), deep):
        for more in ([], ["--resume"], ["--overwrite"], ["--dry-run"]):
            answer = forks.run(*tools.args(tools.tiny, wrong, *more))
            if answer.code != 0 or "--dry-run" not in more:
                assert answer.code in (1, 2), answer
                assert tools.one_line(answer.output), answer.output
    assert sorted(path.name for path in tools.where.iterdir()) == [out.name, "tiny.yaml"]
