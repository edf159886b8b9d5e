"""What macOS leaves beside a dataset's files, ._* and .DS_Store, never matters."""

import shutil
from pathlib import Path

from helpers.folders import contents, litter

import ibdata
from ibdata._system.files import paths_in
from ibdata.tools.listing import datasets_in


def test_only_its_files_are_passed_over(tmp_path):
    for name in (".DS_Store", "._a", ".a", "a", "_a"):
        (tmp_path / name).write_text("")
    (tmp_path / "._folder").mkdir()
    assert [path.name for path in paths_in(tmp_path)] == ["._folder", ".a", "_a", "a"]


def test_a_dataset_is_whole(tiny, tmp_path):
    litter(littered := Path(shutil.copytree(tiny[0].path, tmp_path / "set/littered")))
    before = contents(littered)
    assert ibdata.validate(littered) == ibdata.validate(littered, quick=True) == []
    assert ibdata.repair(littered, workers=1) == []
    assert ibdata.validate(littered.as_uri()) == []
    assert contents(littered) == before
    assert [listed.state for listed in datasets_in(littered.parent)] == ["finished"]
