"""The dataset does not depend on the time zone, the locale, the hash seed and the umask."""

import os

import pytest

pytestmark = pytest.mark.faults
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
