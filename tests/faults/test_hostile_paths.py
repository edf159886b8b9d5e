"""Unwritable folders, links, long names, locales and a umask: one line, and nothing outside is touched."""

import os
import shutil
import tempfile
from pathlib import Path

import pytest
from helpers.folders import contents

pytestmark = pytest.mark.faults
NOBODY = 65534
SPLIT = ["--by", "episode", "fractions=[0.5, 0.5]"]


@pytest.fixture
def open_folder():
    """A folder that everybody may enter, but nobody else may write to."""
    with tempfile.TemporaryDirectory() as name:
        os.chmod(name, 0o755)
        yield Path(name)


def test_read_only_folders(forks, tools, open_folder):
    """What may not be written gives one line and stays; a dataset that is already there needs no right."""
    user = NOBODY if os.geteuid() == 0 else 0
    config, old, empty = open_folder / "tiny.yaml", open_folder / "old", open_folder / "empty"
    shutil.copy(tools.tiny, config)
    assert forks.run(*tools.args(config, old)).code == 0
    empty.mkdir()
    folders = (open_folder, old, old / "data", old / "meta", empty)
    for folder in folders:
        folder.chmod(0o555)
    before = contents(open_folder)
    refused = [(1, tools.args(config, out)) for out in (open_folder / "new", open_folder / "a/b", empty)]
    refused += [
        (2, tools.args(config, old, *more)) for more in (["--overwrite"], ["--overwrite", "--seed", 1])
    ]
    for code, args in refused:
        answer = forks.run(*args, user=user)
        assert answer.code == code, answer
        assert tools.one_line(answer.output), answer.output
    assert forks.run(*tools.args(config, old), user=user).code == 0
    for args in (["card", old], ["repair", old], ["split", old, *SPLIT]):
        answer = forks.run(*args, user=user)
        assert answer.code in (0, 1, 2), answer
        assert answer.code == 0 or tools.one_line(answer.output), answer.output
    assert contents(open_folder) == before
    for folder in folders:
        folder.chmod(0o755)


@pytest.mark.parametrize("name", ["meta/manifest.json", "meta/splits.json", "README.md"])
def test_links_in_a_dataset_are_not_written_through(forks, tools, name):
    """A dataset's files may be links, as in a cache: no command changes what they lead to."""
    out, elsewhere = tools.where / "out", tools.where / "elsewhere"
    assert forks.run(*tools.args(tools.tiny, out)).code == 0
    (out / name).rename(elsewhere)
    (out / name).symlink_to(elsewhere)
    before = elsewhere.read_bytes()
    overwriting = tools.args(tools.tiny, out, "--overwrite")
    for args in (["split", out, *SPLIT], ["card", out], ["repair", out], overwriting):
        answer = forks.run(*args)
        assert answer.code == 0, answer
        assert elsewhere.read_bytes() == before
        assert tools.root(out)


def test_long_names(forks, tools):
    """A name as long as its part's may be is written, and a longer one gives one line."""
    out = tools.where / ("n" * 249)  # the part is .NAME.part
    assert forks.run(*tools.args(tools.tiny, out)).code == 0
    assert tools.root(out)
    for wrong in (tools.where / ("n" * 250), tools.where / ("n" * 5000)):
        answer = forks.run(*tools.args(tools.tiny, wrong))
        assert answer.code in (1, 2), answer
        assert tools.one_line(answer.output), answer.output
    assert sorted(path.name for path in tools.where.iterdir()) == ["many.yaml", out.name, "tiny.yaml"]


SURROUNDINGS = {
    "another time zone": {"TZ": "Pacific/Kiritimati"},
    "ASCII": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    "Latin-1": {"LC_ALL": "de_DE.ISO-8859-1", "PYTHONIOENCODING": "latin-1"},
    "hash seed 1": {"PYTHONHASHSEED": "1"},
    "optimized Python": {"PYTHONOPTIMIZE": "2"},
    "warnings are errors": {"PYTHONWARNINGS": "error"},
}


def test_surroundings_do_not_change_a_byte(tools, files):
    usual = tools.where / "usual"
    assert tools.generate(tools.tiny, usual).returncode == 0
    expected, wrong = files(usual), []
    for name, env in SURROUNDINGS.items():
        out = tools.where / name
        made = tools.generate(tools.tiny, out, env={**os.environ, **env}, encoding="latin-1")
        if made.returncode != 0 or files(out) != expected:
            wrong.append(f"{name}: {made.stderr or 'other bytes'}")
    assert not wrong, "\n".join(wrong)


def test_a_umask_is_obeyed(tools):
    """It decides who may read, and changes no data."""
    roots = set()
    for mask in (0o077, 0o022, 0o000):
        out = tools.where / f"out-{mask}"
        made = tools.generate(tools.tiny, out, umask=mask)
        assert made.returncode == 0, made.stderr
        roots.add(tools.root(out))
        for path in (out, *out.rglob("*")):
            assert path.stat().st_mode & 0o777 & mask == 0, path
    assert len(roots) == 1
