"""F11: the dataset does not depend on the time zone, the locale, the hash seed, the umask and memory.

The clock cannot be changed without rights over the machine. But no file holds a time, because runs at
different times give equal files here.
"""

import os
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.faults
TOKEN = re.compile("-[0-9a-f]{8}(?=[.]parquet$)")
CHECKSUM = re.compile(rb'-[0-9a-f]{8}(?=[.]parquet")|"checksum": "[0-9a-f]{64}"')
ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
SURROUNDINGS = {
    "another time zone": {"TZ": "Pacific/Kiritimati"},
    "an impossible time zone": {"TZ": "nowhere"},
    "ASCII": ASCII,
    "Latin-1": {"LC_ALL": "de_DE.ISO-8859-1", "PYTHONIOENCODING": "latin-1"},
    "Turkish": {"LC_ALL": "tr_TR.UTF-8", "LANG": "tr_TR.UTF-8"},
    "hash seed 0": {"PYTHONHASHSEED": "0"},
    "hash seed 1": {"PYTHONHASHSEED": "1"},
    "optimized Python": {"PYTHONOPTIMIZE": "2"},
    "warnings are errors": {"PYTHONWARNINGS": "error"},
    "no home": {"HOME": "/nonexistent", "XDG_CACHE_HOME": ""},
    "a narrow terminal": {"COLUMNS": "1", "LINES": "1"},
}


def files(folder: Path) -> dict[str, bytes]:
    """Every file's content, but for the tokens in names and the manifest's checksum, which covers them."""
    return {
        TOKEN.sub("", str(p.relative_to(folder))): CHECKSUM.sub(b"", p.read_bytes())
        for p in folder.rglob("*")
        if p.is_file()
    }


def test_surroundings_do_not_change_a_byte(tools: Any) -> None:
    """Time zone, locale, hash seed and the like change no byte of any file."""
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
    tools.figure(f"F11: {len(SURROUNDINGS)} surroundings: {len(wrong)} with another byte in any file")
    assert not wrong, "\n".join(wrong)


def test_a_umask_is_obeyed(tools: Any) -> None:
    """A umask decides who may read, and changes no data."""
    roots = set()
    for mask in (0o077, 0o022, 0o000):
        out = tools.where / f"out-{mask}"
        made = tools.generate(tools.tiny, out, preexec_fn=lambda mask=mask: os.umask(mask))
        assert made.returncode == 0, made.stderr
        roots.add(tools.root(out))
        for path in (out, *out.rglob("*")):
            assert path.stat().st_mode & 0o777 & mask == 0, path
    assert len(roots) == 1


@pytest.mark.parametrize("name", [b"caf\xc3\xa9", b"latin-\xe9", b"new\nline", b"-dash", b"\xff\xfe"])
def test_an_ascii_terminal_reads_about_any_folder(tools: Any, name: bytes) -> None:
    """A name that the terminal cannot show is written as escapes, in one line, and every command works."""
    out = os.fsencode(tools.where) + b"/" + name
    generate = [*tools.args(tools.tiny, "OUT")]
    place = generate.index("OUT")
    runs = [[*generate[:place], out, *generate[place + 1 :], *more] for more in ([], ["--seed", "1"])]
    runs += [[what, out] for what in ("info", "head", "stats", "validate")]
    for i, args in enumerate(runs):
        ran = subprocess.run(
            [tools.command, *args], env={**os.environ, **ASCII}, capture_output=True, timeout=60
        )
        said = ran.stderr.decode("latin-1")
        assert ran.returncode == (2 if i == 1 else 0), (args, said)
        assert "Traceback" not in said
        assert "a bug" not in said
        assert len(said.splitlines()) == (i == 1), said


def test_too_little_memory_gives_one_line(forks: Any, tools: Any) -> None:
    """A shard that does not fit ends the run with one line, and leaves nothing."""
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
