"""The origin of a run, its code and bits, is noted, and a run with another origin is refused."""

from __future__ import annotations

import importlib
import json
import os
import sys
import textwrap
import types
from importlib.machinery import ExtensionFileLoader, ModuleSpec
from pathlib import Path

import pytest
from helpers.folders import contents, part_of
from helpers.own_code import FILES, MODULES, PLAIN, forget, generate, sha256, stopped

import ibdata
from ibdata.errors import UsageError
from ibdata.generation import upload, worker
from ibdata.simulation import self_check
from ibdata.system.storage import Remote

slow = pytest.mark.slow


def again(**options):
    """Generate without what stops it."""
    Path("at-70-stop.py").unlink(missing_ok=True)
    return generate(**options)


EDITS = [("mine.py", "mine:Own"), *((path, path) for path in ("helper.py", "lazy.py", "weights.txt"))]


@slow
@pytest.mark.parametrize(("path", "named"), EDITS)
def test_a_run_goes_on_with_its_own_code_only(here, path, named):
    """--resume with other code is refused and changes nothing; with the code restored it goes on."""
    stopped()
    was = (here / path).read_bytes()
    (here / path).write_bytes(was + b"\n")
    before = contents(part_of("out"))
    with pytest.raises(UsageError) as error:
        generate(resume=True)
    assert str(error.value) == (
        f"out: holds an unfinished run with other code, in {named}; overwrite=True to start again, "
        "or choose another out=…"
    )
    assert (error.value.exit_code, contents(part_of("out"))) == (2, before)
    (here / path).write_bytes(was)
    assert generate(resume=True).content_root == generate("whole").content_root


@slow
def test_overwrite_discards_a_run_with_other_code(here, capsys):
    """--overwrite says that it discards a run with other code, and begins again."""
    stopped()
    (here / "helper.py").write_text("SIZE = 0.125")
    made = generate(overwrite=True)
    assert "out: the unfinished run with other code, in helper.py that was begun" in capsys.readouterr().err
    assert made.content_root == generate("whole").content_root
    assert made.manifest["code"][0]["files"]["helper.py"] == sha256("helper.py")


def test_other_code_of_a_finished_dataset(here, capsys):
    """Other code than a finished dataset's, even a comment, is refused, and a warning with --resume."""
    made = again()
    assert again().manifest == made.manifest
    text = (here / "mine.py").read_text()
    (here / "mine.py").write_text(f"# edited{text}")
    capsys.readouterr()
    with pytest.raises(
        UsageError, match=r"^out: holds the dataset of this experiment with other code, in mi"
    ):
        again()
    assert again(resume=True).manifest == made.manifest
    assert "ibdata: out: was made with other code than is here, in mine:Own\n" in capsys.readouterr().err
    assert ibdata.generate_shards("own.yaml", "1/1", "out", allow_code=True).missing == 0
    assert again(overwrite=True).manifest["code"][0]["sha256"] == sha256("mine.py")


@slow
def test_another_version_of_a_library_is_other_code(here, monkeypatch):
    """The versions of installed libraries that a policy imports are compared too."""
    (here / "lazy.py").write_text("import numpy\nSIGN = -1.0")
    stopped()
    monkeypatch.setattr("importlib.metadata.version", lambda name: "0.0.1")
    with pytest.raises(UsageError, match="with other code, in the version of numpy;"):
        generate(resume=True)


@slow
def test_a_run_goes_on_with_the_same_bits_only(here, monkeypatch):
    """A machine that computes other bits does not go on with a run, and the manifest says what it was."""
    with monkeypatch.context() as other:
        other.setattr(self_check, "digest", lambda *_: "0" * 64)
        stopped()
    with pytest.raises(
        UsageError, match=r"^out: .* run of a machine that computes other bits; overwrite=True"
    ):
        generate(resume=True)
    monkeypatch.setattr(self_check, "digest", lambda *_: "0" * 64)
    assert generate(resume=True).manifest["reproducible"] is False


# --- what is recorded


@slow
def test_what_is_edited_during_a_run_is_recorded_as_it_was(here):
    """The record holds the code with which the run began, and the run goes on with it."""
    before = {path: sha256(path) for path in FILES}
    plain = again(out="plain").content_root
    edit = "pathlib.Path({!r}).write_text('SIZE = 0.125; SIGN = 1.0; Own = None')"
    (here / "at-70-edit.py").write_text("\n".join(edit.format(path) for path in ("mine.py", "helper.py")))
    made = again()
    assert made.content_root == plain
    (code,) = made.manifest["code"]
    assert sha256("mine.py") != before["mine.py"] == code["sha256"]
    assert code["files"] == {path: before[path] for path in ("helper.py", "lazy.py", "weights.txt")}


LATE = """
    import pathlib, sys
    sys.path.insert(0, str(pathlib.Path("lib").absolute()))
    sys.modules.pop("lazy", None)
    import lazy
    sys.path.pop(0)
    """


@slow
@pytest.mark.parametrize("name", ["lazy", "found_late"])
def test_code_that_is_imported_late_is_declared_or_refused(here, name):
    """A module that a policy imports in the middle of a run, known by name or not, is to be declared."""
    (here / "lib").mkdir()
    (here / f"lib/{name}.py").write_text("SIGN = -1.0  # as in the other file")
    late = textwrap.dedent(LATE).replace("lazy", name)
    (here / "at-70-stop.py").rename("at-70-late.py").write_text(late)
    try:
        with pytest.raises(UsageError, match=f"imported while it ran, .*: {name}.py; import it when"):
            generate()
        policy = {**PLAIN["policies"][0], "files": ["weights.txt", f"lib/{name}.py"]}
        (here / "own.yaml").write_text(json.dumps({**PLAIN, "policies": [policy]}))
        files = generate(overwrite=True).manifest["code"][0]["files"]
        assert files[f"lib/{name}.py"] == sha256(f"lib/{name}.py")
    finally:
        sys.modules.pop(name, None)


FIRST = """
    import importlib

    class Own:
        def act(self, history, u):
            return importlib.import_module("found_" + "late").SIGN * u
"""


@slow
def test_code_that_is_imported_at_the_first_step_is_found(here):
    """A module that the first step imports is recorded, equally with one worker and with two."""
    (here / "found_late.py").write_text("SIGN = -1.0")
    (here / "mine.py").write_text(textwrap.dedent(FIRST))
    policy = {**PLAIN["policies"][0], "files": []}
    (here / "own.yaml").write_text(json.dumps({**PLAIN, "policies": [policy]}))
    made, other = generate(workers=2), generate("again")
    assert made.manifest["code"] == other.manifest["code"]
    assert made.content_root == other.content_root
    assert sha256("found_late.py") in made.manifest["code"][0]["files"].values()


@slow
@pytest.mark.parametrize("edit", [("helper.py", "SIZE = 0.125"), ("lazy.py", "SIGN = 1.5")])
def test_a_run_imports_what_the_files_hold(here, edit):
    """Whatever this process had imported before, a run acts by the files, and puts the modules back."""
    known = [importlib.import_module(name) for name in MODULES]
    old = again(out="old")
    experiment = ibdata.load("own.yaml")
    (here / edit[0]).write_text(edit[1])
    made = [ibdata.generate(experiment, f"new-{n}", workers=n, allow_code=True) for n in (1, 2)]
    made.append(again(out="process"))
    assert len({each.content_root for each in made} - {old.content_root}) == 1
    assert {each.manifest["code"][0]["files"][edit[0]] for each in made} == {sha256(edit[0])}
    assert not set(MODULES) & set(sys.modules)
    sys.modules.update(zip(MODULES, known, strict=True))
    assert ibdata.reproduce("process", allow_code=True) == (4, [])
    assert [sys.modules[name] for name in MODULES] == known


@slow
def test_code_beside_machine_code_must_be_its_file(here, monkeypatch):
    """A package with machine code cannot be imported anew, so that an edit of its Python is refused."""
    (here / "at-70-stop.py").unlink()
    experiment = ibdata.load("own.yaml")
    compiled = types.ModuleType("mine.compiled")
    compiled.__spec__ = ModuleSpec("mine.compiled", ExtensionFileLoader("mine.compiled", "mine.so"))
    monkeypatch.setitem(sys.modules, "mine.compiled", compiled)
    known = importlib.import_module("mine")
    ibdata.generate(experiment, "old", workers=1, allow_code=True)
    assert sys.modules["mine"] is known
    (here / "mine.py").write_text((here / "mine.py").read_text() + "\n")
    with pytest.raises(UsageError, match=r"mine\.py: was changed after this process had imported it"):
        ibdata.generate(experiment, "new", workers=1, allow_code=True)


# --- workers and finishing

BITS = """
import os, ibdata.simulation.self_check as check
check.digest = check.digest if os.getpid() == {} else lambda *_: "x"
"""


@slow
@pytest.mark.parametrize("other", ["code", "bits"])
def test_a_worker_with_another_origin_is_refused(here, monkeypatch, other):
    """A worker process compares its code and its bits with those of the run before it makes a shard."""
    (here / "at-70-stop.py").unlink()
    line = "a worker computes other bits than the machine on which the run began"
    if other == "code":
        line = r"a worker found other code than the run began with, in helper\.py"

        def beginning(job):
            (here / "helper.py").write_text("SIZE = 0.125")
            return worker.Worker(job)

        monkeypatch.setattr("ibdata.generation.workers.Worker", beginning)
    else:
        (here / "mine.py").write_text(BITS.format(os.getpid()) + (here / "mine.py").read_text())
    with pytest.raises(UsageError, match=line):
        generate(workers=2)
    assert not part_of("out").exists()


PACKAGE = """
    import pathlib
    pathlib.Path("imported").touch()

    class Own:
        def act(self, history, u):
            return 2.0 * u - 1.0
"""


@slow
def test_finalize_imports_nothing(here, ibdata):
    """`finalize` takes the record of the code from the run's note, and runs no code."""
    (here / "package").mkdir()
    (here / "package/__init__.py").write_text(textwrap.dedent(PACKAGE))
    (here / "package/module.py").write_text("from package import Own")
    policy = {"kind": "custom", "target": "package.module:Own", "uniforms": 3}
    (here / "own.yaml").write_text(json.dumps({**PLAIN, "policies": [policy]}))
    args = ("--config", "own.yaml", "--out", "out", "--shards", "1/1", "--allow-code")
    assert ibdata("generate", *args).returncode == 0
    (here / "imported").unlink()
    done = ibdata("finalize", "out", env={**os.environ, "PYTHONPATH": str(here)})
    assert (done.returncode, (here / "imported").exists()) == (0, False)
    (code,) = json.loads((here / "out/meta/manifest.json").read_text())["code"]
    assert code["sha256"] == sha256("package/module.py")
    assert code["files"] == {"package/__init__.py": sha256("package/__init__.py")}


@slow
def test_an_upload_goes_on_with_its_own_code_only(here, monkeypatch):
    """Data that wait for their upload are not uploaded as those of edited code, unless --resume is given."""
    url = f"{here.as_uri()}/there"
    monkeypatch.setattr(upload, "places", lambda url, experiment: (here / "cache/dataset", Remote(url)))

    def broken(*_):
        raise OSError("connection lost")

    with monkeypatch.context() as patched:
        patched.setattr(Remote, "put", broken)
        with pytest.raises(ibdata.IbdataError, match="connection lost; resume=True tries again"):
            again(out=url)
    (here / "helper.py").write_text("SIZE = 0.125")
    made = again(out=url)
    assert made.manifest["code"][0]["files"]["helper.py"] == sha256("helper.py")
    assert made.content_root == again(out="whole").content_root
    forget()
