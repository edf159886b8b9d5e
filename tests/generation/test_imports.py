"""The code that a policy really imports is that which is noted, however it is found."""

from __future__ import annotations

import os
import sys
import textwrap
from pathlib import Path

import pytest

import ibdata
from ibdata import Experiment
from ibdata.errors import UsageError
from ibdata.experiment import fresh_modules

pytestmark = pytest.mark.slow
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
    for folder in ("lib", "installed/site-packages"):
        Path(folder).mkdir(parents=True)


def policy(first: str) -> None:
    Path("pol_imports.py").write_text(textwrap.dedent(first) + textwrap.dedent(POLICY))


def for_the_import_only():
    policy(BESIDE + "from helper_a import SIZE\nsys.path.remove(LIB)\n")
    return "lib/helper_a.py"


def loose():
    sys.path.append(str(Path("installed/site-packages").absolute()))
    policy("from helper_d import SIZE\n")
    return "installed/site-packages/helper_d.py"


def by_its_name():
    policy("import importlib\nSIZE = importlib.import_module('helper_f').SIZE\n")
    return "helper_f.py"


WAYS = (for_the_import_only, loose, by_its_name)


def generate(out, size, helper, **options):
    Path(helper).write_text(f"SIZE = {size}\n")
    return ibdata.generate(OWN, out, workers=1, allow_code=True, **options)


def half(text="1/2"):
    return ibdata.generate_shards(OWN, text, "half", workers=1, allow_code=True)


@pytest.mark.parametrize("way", WAYS)
def test_an_imported_module_is_part_of_the_code(here, way):
    """However Python finds a module, it is recorded, and an edit of it neither passes nor mixes."""
    helper = way()
    Path(helper).write_text("SIZE = 0.25\n")
    half()
    Path(helper).write_text("SIZE = 0.75\n")
    with pytest.raises(UsageError, match=f"with other code, in {'.*/'}?{Path(helper).name};"):
        half("2/2")
    for size in (0.75, 0.25):
        made = generate(f"all-{size}", size, helper)
        assert set(made.to_pandas()["act_velocity"]) == {size}
        assert Path(helper).name in " ".join(made.manifest["code"][0]["files"])
        assert generate(f"all-{size}", size, helper, resume=True).manifest == made.manifest


@pytest.mark.parametrize("workers", [1, 2])
def test_a_policy_may_extend_the_path_of_python(here, workers):
    """A folder that a policy adds to `sys.path` is found in every process, and does not stay there."""
    policy(BESIDE + "from helper_g import SIZE\n")
    Path("lib/helper_g.py").write_text("SIZE = 0.25\n")
    before = list(sys.path)
    for _ in range(2):
        made = ibdata.generate(OWN, "out", workers=workers, allow_code=True, overwrite=True)
        assert sys.path == before
    assert made.manifest["code"][0]["files"].keys() == {"helper_g.py"}


def test_modules_of_the_session_come_back(here, monkeypatch):
    """A module that the session had imported is imported anew for a run, and is the session's afterwards."""
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


def test_a_late_import_is_refused_even_if_known(here, monkeypatch):
    """A module that the session knows, and a policy imports at its fifth step, is not recorded: refused."""
    Path("helper_late.py").write_text("SIZE = 0.25\n")
    Path("pol_imports.py").write_text(textwrap.dedent(LATE))
    monkeypatch.syspath_prepend(Path().absolute())
    import helper_late

    longer = Experiment.model_validate({**OWN.plain(), "steps": 12})
    with pytest.raises(UsageError, match=r"imported while it ran, .*: helper_late\.py; import it when"):
        ibdata.generate(longer, "late", workers=1, allow_code=True)
    assert sys.modules.pop("helper_late") is helper_late


def test_stale_bytecode_is_found(here, monkeypatch):
    """Bytecode of other code, which Python takes for right by time and size, is refused once and removed."""
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


def test_bytecode_with_nan_is_that_of_its_file(here, monkeypatch):
    """To Python, no two code objects with NaN are equal; such bytecode is not taken for stale."""
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    policy("SIZE, NAN = 0.25, 1e999 - 1e999\nOTHERS = SIZE in {0.25, 0.5}\n")
    for out in ("one", "two"):
        made = ibdata.generate(OWN, out, workers=1, allow_code=True)
        assert set(made.to_pandas()["act_velocity"]) == {0.25}


@pytest.mark.parametrize("other", [0.75, 0.25])  # a module of equal code may read another file beside it
def test_two_modules_of_one_name_are_refused(here, other):
    """Python imports only one module of a name, so two policies that mean two of them are refused."""
    policies = []
    for folder, size in (("a_own", 0.25), ("b_own", other)):
        Path(folder).mkdir()
        policy("from helper_two import SIZE\n")
        Path("pol_imports.py").rename(Path(folder, f"pol_{folder}.py"))
        Path(folder, "helper_two.py").write_text(f"SIZE = {size}\n")
        policies.append({"kind": "custom", "target": f"{folder}/pol_{folder}.py:P", "name": folder})
    experiment = Experiment.model_validate({**OWN.plain(), "policies": policies})
    with pytest.raises(UsageError, match=r"helper_two\.py: found another module with the name helper_two in"):
        ibdata.generate(experiment, "two", workers=1, allow_code=True)
