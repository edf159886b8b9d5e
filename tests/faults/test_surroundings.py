"""The dataset does not depend on the time zone, the locale, the hash seed, the umask and memory.

The clock cannot be changed without rights over the machine. But no file holds a time, because runs at
different times give equal files here.
"""

import os

import pytest

pytestmark = pytest.mark.faults
SURROUNDINGS = {
    "another time zone": {"TZ": "Pacific/Kiritimati"},
    "an impossible time zone": {"TZ": "nowhere"},
    "ASCII": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    "Latin-1": {"LC_ALL": "de_DE.ISO-8859-1", "PYTHONIOENCODING": "latin-1"},
    "Turkish": {"LC_ALL": "tr_TR.UTF-8", "LANG": "tr_TR.UTF-8"},
    "hash seed 0": {"PYTHONHASHSEED": "0"},
    "hash seed 1": {"PYTHONHASHSEED": "1"},
    "optimized Python": {"PYTHONOPTIMIZE": "2"},
    "warnings are errors": {"PYTHONWARNINGS": "error"},
    "no home": {"HOME": "/nonexistent", "XDG_CACHE_HOME": ""},
    "a narrow terminal": {"COLUMNS": "1", "LINES": "1"},
}


def test_surroundings_do_not_change_a_byte(tools, files):
    usual = tools.where / "usual"
    assert tools.generate(tools.tiny, usual).returncode == 0
    expected, wrong = files(usual), []
    for name, env in SURROUNDINGS.items():
        if name == "no home" and not tools.full:
            continue  # without its cache everything is compiled: a minute
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


def test_too_little_memory_gives_one_line(forks, tools):
    """A shard that does not fit ends the run, and leaves nothing."""
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
