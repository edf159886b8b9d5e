"""What stands in the place of a part or in it, such as files and links of a user."""

import shutil
from typing import Any

import pytest

pytestmark = pytest.mark.faults


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
