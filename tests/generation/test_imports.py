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


def policy(first, step="pass", path="pol_imports.py"):
    Path(path).write_text(textwrap.dedent(first) + textwrap.dedent(POLICY).format(step))


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


@pytest.mark.parametrize("named", ["from helper_two import SIZE", "import helper_two as h; SIZE = h.SIZE"])
def test_helpers_of_one_name_in_two_folders_are_refused(named):
    policies = []
    for folder, size in (("a_own", 0.25), ("b_own", 0.75)):
        Path(folder).mkdir()
        policy(f"{named}\n", path=f"{folder}/policy.py")
        Path(folder, "helper_two.py").write_text(f"SIZE = {size}\n")
        policies.append({"kind": "custom", "target": f"{folder}/policy.py:P", "name": folder})
    line = r"b_own/helper_two\.py: found another module with the name helper_two in use, .*/a_own/"
    with pytest.raises(UsageError, match=line):
        ibdata.generate({**OWN, "policies": policies}, "two", allow_code=True)


def test_what_the_session_changed_in_a_module_does_not_count(monkeypatch):
    policy("from helper_i import SIZE\n")
    Path("helper_i.py").write_text("SIZE = 0.25\n")
    monkeypatch.syspath_prepend(Path().absolute())
    import helper_i

    helper_i.SIZE = 0.75
    assert set(generate("out").to_pandas()["act_velocity"]) == {0.25}
    assert sys.modules.pop("helper_i") is helper_i
