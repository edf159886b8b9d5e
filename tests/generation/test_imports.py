"""The code that a policy really imports is that which is noted, however it is found."""

from __future__ import annotations

import os
import py_compile
import sys
import textwrap
from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.errors import UsageError
from ibdata.experiment import fresh_modules
from ibdata.experiment.imported_modules import imported

OWN = Experiment.model_validate(
    {"name": "own", "setpoints": [20, 70], "policies": [{"kind": "custom", "target": "pol_imports:P"}],
     "episodes": 1, "steps": 2, "output": {"shard_rows": 2}}
)  # fmt: skip
POLICY = """
    import numpy as np

    class P:
        def predict(self, observations):
            return np.full((len(observations), 3), SIZE)
    """
BESIDE = "import sys, pathlib\nLIB = str(pathlib.Path(__file__).with_name('lib'))\nsys.path.insert(0, LIB)\n"


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    for folder in ("lib", "pkg", "extra", "part", "installed/site-packages/part"):
        Path(folder).mkdir(parents=True)


def policy(first: str) -> None:
    Path("pol_imports.py").write_text(textwrap.dedent(first) + textwrap.dedent(POLICY))


def for_the_import_only():
    policy(BESIDE + "from helper_a import SIZE\nsys.path.remove(LIB)\n")
    return "lib/helper_a.py"


def extended_package():
    Path("pkg/__init__.py").write_text("__path__.append(__path__[0] + '/../extra')\n")
    policy("from pkg.helper_b import SIZE\n")
    return "extra/helper_b.py"


def partly_installed():
    Path("installed/site-packages/part/base.py").write_text("")
    sys.path.append(str(Path("installed/site-packages").absolute()))
    policy("from part.helper_c import SIZE\n")
    return "part/helper_c.py"


def loose():
    sys.path.append(str(Path("installed/site-packages").absolute()))
    policy("from helper_d import SIZE\n")
    return "installed/site-packages/helper_d.py"


def without_source():
    Path("mid.py").write_text("from helper_e import SIZE\n")
    py_compile.compile("mid.py", cfile="mid_e.pyc")
    policy("from mid_e import SIZE\n")
    return "helper_e.py"


def by_its_name():
    policy("import importlib\nSIZE = importlib.import_module('helper_f').SIZE\n")
    return "helper_f.py"


WAYS = (for_the_import_only, extended_package, partly_installed, loose, without_source, by_its_name)


def generate(out, size, helper, **options):
    Path(helper).write_text(f"SIZE = {size}\n")
    return ibdata.generate(OWN, out, workers=1, allow_code=True, **options)


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
def test_a_module_that_is_imported_is_noted_and_an_edit_counts_and_does_not_mix(here, way):
    helper = way()
    Path(helper).write_text("SIZE = 0.25\n")
    ibdata.generate_shards(OWN, "1/2", "half", workers=1, allow_code=True)
    Path(helper).write_text("SIZE = 0.75\n")
    with pytest.raises(UsageError, match=f"found other code .*, in {'.*/'}?{Path(helper).name};"):
        ibdata.generate_shards(OWN, "2/2", "half", workers=1, allow_code=True)
    for size in (0.75, 0.25):
        made = generate(f"all-{size}", size, helper)
        assert set(made.to_pandas()["act_velocity"]) == {size}
        assert Path(helper).name in " ".join(made.manifest["code"][0]["files"])
        assert generate(f"all-{size}", size, helper, resume=True).manifest == made.manifest


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_a_policy_may_extend_the_path_of_python(here, workers):
    policy(BESIDE + "from helper_g import SIZE\n")
    Path("lib/helper_g.py").write_text("SIZE = 0.25\n")
    for _ in range(2):
        sys.path[:] = [path for path in sys.path if not path.endswith("lib")]
        made = ibdata.generate(OWN, "out", workers=workers, allow_code=True, overwrite=True)
    assert made.manifest["code"][0]["files"].keys() == {"helper_g.py"}


@pytest.mark.slow
def test_what_somebody_imported_before_is_imported_anew_and_comes_back(here, monkeypatch):
    helper = for_the_import_only()
    monkeypatch.syspath_prepend("lib")
    Path(helper).write_text("SIZE = 0.25\n")
    import helper_a

    made = generate("out", 0.75, helper)
    assert set(made.to_pandas()["act_velocity"]) == {0.75}
    assert sys.modules.pop("helper_a") is helper_a
    assert helper_a.SIZE == 0.25


LATE = """
    import importlib
    import numpy as np

    class P:
        def predict(self, observations):
            if (observations[:, 1] <= 51.5).all():
                return np.full((len(observations), 3), 0.5)
            return np.full((len(observations), 3), importlib.import_module("helper" + "_late").SIZE)
    """


@pytest.mark.slow
def test_a_module_that_the_script_had_imported_is_late_like_any_other(here, monkeypatch):
    """The policy imports it at the fifth step, by a name that is made there."""
    Path("helper_late.py").write_text("SIZE = 0.25\n")
    Path("pol_imports.py").write_text(textwrap.dedent(LATE))
    monkeypatch.syspath_prepend(Path().absolute())
    import helper_late

    longer = Experiment.model_validate({**OWN.plain(), "steps": 12})
    with pytest.raises(UsageError, match=r"imported while it ran, .*: helper_late\.py; import it when"):
        ibdata.generate(longer, "late", workers=1, allow_code=True)
    assert sys.modules.pop("helper_late") is helper_late


def test_names_that_are_written_out_in_a_call_are_imports(here):
    policy(
        "import importlib\nSIZE = importlib.import_module('helper_f').SIZE + __import__('helper_h').SIZE\n"
    )
    for name in ("helper_f", "helper_h"):
        Path(f"{name}.py").write_text("SIZE = 0.25\n")
    sys.path.insert(0, str(Path().absolute()))
    sources, _ = imported("pol_imports")
    assert sources.keys() == {"pol_imports.py", "helper_f.py", "helper_h.py"}


@pytest.mark.slow
def test_bytecode_of_other_code_is_found_wherever_python_finds_the_module(here, monkeypatch):
    """The time and the size of the helper stay, so Python takes its bytecode for right."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    helper = Path(for_the_import_only())
    for size in (0.25, 0.75):
        helper.write_text(f"SIZE = {size}\n")
        os.utime(helper, (10**9, 10**9))
        if size == 0.25:
            ibdata.generate(OWN, "one", workers=1, allow_code=True)
    fresh_modules.imported_by_policies.clear()  # as in another process
    found = r"lib/helper_a\.py: its bytecode was that of other code, .* run again"
    with pytest.raises(UsageError, match=found):
        ibdata.generate(OWN, "two", workers=1, allow_code=True)
    assert not Path("two").exists()
    made = ibdata.generate(OWN, "two", workers=1, allow_code=True)
    assert set(made.to_pandas()["act_velocity"]) == {0.75}


@pytest.mark.slow
@pytest.mark.parametrize("other", [0.75, 0.25])  # a module of equal code may read another file beside it
def test_two_modules_of_one_name_are_refused_by_their_names(here, other):
    policies = []
    for folder, size in (("a_own", 0.25), ("b_own", other)):
        Path(folder).mkdir()
        policy("from helper_two import SIZE\n")
        Path("pol_imports.py").rename(Path(folder, f"pol_{folder}.py"))
        Path(folder, "helper_two.py").write_text(f"SIZE = {size}\n")
        policies.append({"kind": "custom", "target": f"{folder}/pol_{folder}.py:P", "name": folder})
    experiment = Experiment.model_validate({**OWN.plain(), "policies": policies})
    line = (
        r"helper_two\.py: found another module with the name helper_two in use, .*helper_two\.py; rename one"
    )
    with pytest.raises(UsageError, match=line):
        ibdata.generate(experiment, "two", workers=1, allow_code=True)


@pytest.mark.slow
def test_a_declared_file_hides_no_module_of_its_name(here, monkeypatch):
    """The policy imports `conf.py` beside its own file, and declares the one beside the YAML file."""
    Path("sub").mkdir()
    policy("from conf import SIZE\n")
    Path("pol_imports.py").rename("sub/pol_conf.py")
    block = {"kind": "custom", "target": "sub/pol_conf.py:P", "files": ["conf.py"]}
    experiment = Experiment.model_validate({**OWN.plain(), "policies": [block]})
    for path, size in (("conf.py", 0.5), ("sub/conf.py", 0.25)):
        Path(path).write_text(f"SIZE = {size}\n")
    ibdata.generate_shards(experiment, "1/2", "half", workers=1, allow_code=True)
    for path in ("sub/conf.py", "conf.py"):
        was = Path(path).read_text()
        Path(path).write_text("SIZE = 0.75\n")
        with pytest.raises(UsageError, match=r"found other code than the run began with, in .*conf\.py"):
            ibdata.generate_shards(experiment, "2/2", "half", workers=1, allow_code=True)
        Path(path).write_text(was)
    ibdata.generate_shards(experiment, "2/2", "half", workers=1, allow_code=True)
    files = ibdata.finalize("half").manifest["code"][0]["files"]
    assert {"conf.py", "conf.py as declared"} <= files.keys()


@pytest.mark.slow
def test_bytecode_with_nan_is_that_of_its_file(here, monkeypatch):
    """To Python, no two code objects with such a constant are equal."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    policy("SIZE, NAN = 0.25, 1e999 - 1e999\nOTHERS = SIZE in {0.25, 0.5}\n")
    for out in ("one", "two"):
        made = ibdata.generate(OWN, out, workers=1, allow_code=True)
        assert set(made.to_pandas()["act_velocity"]) == {0.25}
