"""What custom policies import: it is recorded however it is found, and the session imports none of it."""

import sys
import textwrap
from pathlib import Path

import pytest

import ibdata
from ibdata.errors import UsageError

pytestmark = pytest.mark.slow
OWN = {
    "name": "own",
    "setpoints": [20, 70],
    "policies": [{"kind": "custom", "target": "pol_imports:P"}],
    "episodes": 1,
    "steps": 2,
    "output": {"shard_rows": 2},
}
POLICY = """
    import numpy as np

    class P:
        def predict(self, observations):
            {}
            return np.full((len(observations), 3), SIZE)
    """
BESIDE = """
    import sys, pathlib
    LIB = str(pathlib.Path(__file__).with_name('lib'))
    sys.path.insert(0, LIB)
    from helper_a import SIZE
    sys.path.remove(LIB)
    """
BY_NAME = "import importlib\nSIZE = importlib.import_module('helper_' + 'f').SIZE\n"
WAYS = {  # code at the top, and at the first step; the module that it imports
    "for the import only": (BESIDE, "pass", "lib/helper_a.py"),
    "by its name": (BY_NAME, "pass", "helper_f.py"),
    "at the first step": ("", "from helper_g import SIZE", "helper_g.py"),
}


@pytest.fixture(autouse=True)
def here(monkeypatch):
    monkeypatch.setattr(sys, "path", [*sys.path])
    Path("lib").mkdir()


def policy(first, step="pass"):
    Path("pol_imports.py").write_text(textwrap.dedent(first) + textwrap.dedent(POLICY).format(step))


def generate(out, **options):
    return ibdata.generate(OWN, out, **{"workers": 1, "allow_code": True, **options})


@pytest.mark.parametrize(("first", "step", "path"), WAYS.values(), ids=WAYS)
def test_an_imported_module_is_recorded_and_does_not_mix(first, step, path):
    policy(first, step)
    helper, before = Path(path), set(sys.modules)
    helper.write_text("SIZE = 0.25\n")
    generate("half", shards="1/2")
    helper.write_text("SIZE = 0.75\n")
    with pytest.raises(UsageError, match=f"with other code, in (.*/)?{helper.name};"):
        generate("half", shards="2/2")
    for size, workers in ((0.75, 1), (0.25, 2)):
        helper.write_text(f"SIZE = {size}\n")
        made = generate(f"all-{size}", workers=workers)
        assert set(made.to_pandas()["act_velocity"]) == {size}
        assert helper.name in " ".join(made.manifest["code"][0]["files"])
    assert not [name for name in set(sys.modules) - before if "helper" in name or "pol_imports" in name]


def test_what_the_session_changed_in_a_module_does_not_count(monkeypatch):
    policy("from helper_i import SIZE\n")
    Path("helper_i.py").write_text("SIZE = 0.25\n")
    monkeypatch.syspath_prepend(Path().absolute())
    import helper_i

    helper_i.SIZE = 0.75
    assert set(generate("out").to_pandas()["act_velocity"]) == {0.25}
    assert sys.modules.pop("helper_i") is helper_i
