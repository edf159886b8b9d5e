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
from helpers.own_code import FILES, MODULES, PLAIN, forget, generate, sha256, stopped
from ibdata.system.object_store import Remote

import ibdata
from ibdata.errors import UsageError
from ibdata.generation import upload
from ibdata.simulation import self_check

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("path", "named"),
    [("mine.py", "mine:Own"), *((path, path) for path in ("helper.py", "lazy.py", "weights.txt"))],
)
def test_a_run_is_resumed_with_the_code_that_it_began_with_only(here, path, named):
    stopped()
    was = (here / path).read_bytes()
    (here / path).write_bytes(was + b"\n")
    before = sorted(Path("out").rglob("*"))
    with pytest.raises(UsageError) as error:
        generate(resume=True)
    assert str(error.value) == (
        f"out: found other code than the run began with, in {named}; restore it and resume=True, "
        "or start again with overwrite=True or another out=…"
    )
    assert error.value.exit_code == 2
    assert sorted(Path("out").rglob("*")) == before
    (here / path).write_bytes(was)
    assert generate(resume=True).content_root == generate("whole").content_root


@pytest.mark.parametrize("ranges", [False, True])
def test_a_finished_dataset_of_other_code_is_not_passed_over(here, ranges):
    (here / "at-70-stop.py").unlink()
    made = generate()

    def again():
        if not ranges:
            return generate(resume=True)
        forget()
        return ibdata.generate_shards("own.yaml", "1/1", "out", workers=1, allow_code=True)

    again()
    (here / "helper.py").write_text("SIZE = 0.125")
    with pytest.raises(UsageError, match=r"^out: found other code than the run began with, in helper\.py;"):
        again()
    assert ibdata.open("out").manifest == made.manifest


@pytest.mark.parametrize("finished", [False, True])
@pytest.mark.parametrize("machine", ["here", "elsewhere"])
def test_an_upload_goes_on_with_the_code_that_it_began_with_only(here, monkeypatch, finished, machine):
    (here / "at-70-stop.py").unlink()
    url = f"{here.as_uri()}/there"
    monkeypatch.setattr(upload, "cache_base", lambda: str(here / "here"))
    if finished:
        generate(url)
    else:
        with monkeypatch.context() as broken:
            broken.setattr(Remote, "remove", lambda self, path: next(iter(())))
            with pytest.raises(StopIteration):
                generate(url)
        (here / "there/meta/manifest.json").unlink()
    before = sorted(Path("there").rglob("*"))
    monkeypatch.setattr(upload, "cache_base", lambda: str(here / machine))
    was = (here / "helper.py").read_text()
    (here / "helper.py").write_text("SIZE = 0.125")
    with pytest.raises(UsageError, match=r"there: found other code than the run began with, in helper\.py;"):
        generate(url, resume=True)
    assert sorted(Path("there").rglob("*")) == before
    (here / "helper.py").write_text(was)
    assert generate(url, resume=True).content_root == generate("whole").content_root
    assert ibdata.validate(url) == []


LATE = """
    import pathlib, sys
    sys.path.insert(0, str(pathlib.Path("lib").absolute()))
    sys.modules.pop("lazy", None)
    import lazy
    sys.path.pop(0)
    """


@pytest.mark.parametrize("name", ["lazy", "found_late"])
def test_code_that_is_imported_late_is_declared_or_refused(here, name):
    """Once under a name of which another file was recorded, once under a new one."""
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


@pytest.mark.parametrize("files", [[], ["found_late.py"]])
def test_code_that_is_imported_at_the_first_step_is_found_in_every_process(here, files):
    (here / "found_late.py").write_text("SIGN = -1.0")
    (here / "mine.py").write_text(textwrap.dedent(FIRST))
    policy = {**PLAIN["policies"][0], "files": files}
    (here / "own.yaml").write_text(json.dumps({**PLAIN, "policies": [policy]}))
    made = generate(workers=2)
    assert made.manifest["code"] == generate("again").manifest["code"]
    assert made.content_root == ibdata.open("again").content_root
    assert sha256("found_late.py") in made.manifest["code"][0]["files"].values()


def test_starting_again_with_other_code_needs_no_more_than_overwrite(here):
    stopped()
    (here / "helper.py").write_text("SIZE = 0.125")
    assert generate(overwrite=True).content_root == generate("whole").content_root


def test_a_replacement_that_was_stopped_is_begun_again_where_the_code_is_another(here):
    (here / "at-70-stop.py").rename("later")
    generate()
    (here / "later").rename("at-70-stop.py")
    stopped(overwrite=True)
    (here / "helper.py").write_text("SIZE = 0.125")
    made = generate(overwrite=True)
    assert made.content_root == generate("whole").content_root
    assert made.manifest["code"][0]["files"]["helper.py"] == sha256("helper.py")


def test_another_version_of_an_installed_library_is_refused(here, monkeypatch):
    (here / "lazy.py").write_text("import numpy\nSIGN = -1.0")
    stopped()
    monkeypatch.setattr("importlib.metadata.version", lambda name: "0.0.1")
    with pytest.raises(UsageError, match="other code than the run began with, in the version of numpy;"):
        generate(resume=True)


def test_what_is_edited_during_the_run_is_recorded_as_it_was_before(here):
    (here / "at-70-stop.py").unlink()
    before = {path: sha256(path) for path in FILES if (here / path).exists()}
    plain = generate("plain").content_root
    edit = "pathlib.Path({!r}).write_text('SIZE = 0.125; SIGN = 1.0; Own = None')"
    (here / "at-70-edit.py").write_text("\n".join(edit.format(path) for path in ("mine.py", "helper.py")))
    made = generate()
    assert made.content_root == plain
    (code,) = made.manifest["code"]
    assert sha256("mine.py") != before["mine.py"] == code["sha256"]
    files = ("helper.py", "lazy.py", "weights.txt")
    assert code["files"] == {path: before[path] for path in files}


EDITED = """
    from pathlib import Path
    from ibdata.generation import worker_pool
    from ibdata.simulation import self_check

    begin = worker_pool._start

    def start(*args):  # what a worker does first
        {}
        begin(*args)
"""


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (
            "Path('helper.py').write_text('SIZE = 0.125')",
            "found other code than the run began with, in helper.py;",
        ),
        ("self_check.digest = lambda *_: '0' * 64", "this machine computes other bits than the one on which"),
    ],
)
def test_a_worker_with_other_code_or_bits_than_the_run_is_refused(here, monkeypatch, change, found):
    (here / "at-70-stop.py").unlink()
    installed = here / "site-packages"  # whose modules stay where they are during a run
    installed.mkdir()
    (installed / "edited.py").write_text(textwrap.dedent(EDITED).format(change))
    monkeypatch.syspath_prepend(installed)
    monkeypatch.setattr("ibdata.generation.worker_pool._start", importlib.import_module("edited").start)
    try:
        with pytest.raises(UsageError, match=f": {found}"):
            generate(workers=2)
    finally:
        del sys.modules["edited"]
    assert not (here / "out").exists()


@pytest.mark.parametrize("edit", [("helper.py", "SIZE = 0.125"), ("lazy.py", "SIGN = 1.5")])
def test_a_run_imports_what_the_files_hold_whatever_was_imported_before(here, edit):
    (here / "at-70-stop.py").unlink()
    known = [importlib.import_module(name) for name in MODULES]
    experiment = ibdata.load("own.yaml")
    old = ibdata.generate(experiment, "old", workers=1, allow_code=True)
    (here / edit[0]).write_text(edit[1])
    made = [
        ibdata.generate(experiment, f"new-{workers}", workers=workers, allow_code=True) for workers in (1, 2)
    ]
    forget()
    new = ibdata.generate("own.yaml", "process", workers=1, allow_code=True)
    assert len({each.content_root for each in (*made, new)} - {old.content_root}) == 1
    assert {each.manifest["code"][0]["files"][edit[0]] for each in made} == {sha256(edit[0])}
    assert not set(MODULES) & set(sys.modules)
    sys.modules.update(zip(MODULES, known, strict=True))
    assert ibdata.reproduce("process", allow_code=True) == (4, [])
    assert [sys.modules[name] for name in MODULES] == known


def test_code_beside_machine_code_stays_and_must_be_what_its_file_holds(here, monkeypatch):
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


# --- bits


def test_a_run_goes_on_where_the_bits_are_those_it_began_with_only(here, monkeypatch):
    with monkeypatch.context() as other:
        other.setattr(self_check, "digest", lambda *_: "0" * 64)
        stopped()
    with pytest.raises(UsageError, match=r"^out: this machine computes other bits than .* resume=True on"):
        generate(resume=True)
    monkeypatch.setattr(self_check, "digest", lambda *_: "0" * 64)
    assert generate(resume=True).manifest["reproducible"] is False


# --- finishing


PACKAGE = """
    import pathlib
    pathlib.Path("imported").touch()

    class Own:
        def act(self, history, u):
            return 2.0 * u - 1.0
"""


@pytest.mark.slow
@pytest.mark.parametrize("noted", [True, False])
def test_finalize_imports_nothing(here, noted, ibdata):
    (here / "package").mkdir()
    (here / "package/__init__.py").write_text(textwrap.dedent(PACKAGE))
    (here / "package/module.py").write_text("from package import Own")
    policy = {"kind": "custom", "target": "package.module:Own", "uniforms": 3}
    (here / "own.yaml").write_text(json.dumps({**PLAIN, "policies": [policy]}))
    args = ("--config", "own.yaml", "--out", "out", "--shards", "1/1", "--allow-code")
    assert ibdata("generate", *args).returncode == 0
    (here / "imported").unlink()
    if not noted:
        (here / "out/.run/run.json").unlink()
    done = ibdata("finalize", "out", env={**os.environ, "PYTHONPATH": str(here)})
    assert not (here / "imported").exists()
    if noted:
        assert done.returncode == 0, done.stderr
        (code,) = json.loads((here / "out/meta/manifest.json").read_text())["code"]
        assert code["sha256"] == sha256("package/module.py")
        assert code["files"] == {"package/__init__.py": sha256("package/__init__.py")}
    else:
        assert done.returncode == 2
        assert done.stderr.startswith("out/.run/run.json: missing or damaged, so the code that made")


@pytest.mark.parametrize(
    "content", [b"", b"{}", b"[1]", b" " * 2**20 + b"{}", b'{"known_answer": "0", "code": []}', None]
)
def test_a_note_that_is_missing_or_damaged_is_one_line(here, content):
    stopped()
    (here / "out/.run/run.json").unlink()
    if content is not None:
        (here / "out/.run/run.json").write_bytes(content)
    for call in (lambda: generate(resume=True), lambda: ibdata.finalize("out")):
        with pytest.raises(UsageError, match=r"^out/\.run/run\.json: missing or damaged, so the code"):
            call()
    assert generate(overwrite=True).content_root == generate("whole").content_root
