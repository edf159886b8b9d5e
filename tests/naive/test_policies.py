"""What people do with policies of their own in a normal year: edit them, name them, save them, check them."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from helpers.networks import Environment, Model

import ibdata
from ibdata.errors import PolicyError, UsageError
from ibdata.testing import check_policy

CODE = "import numpy as np\n{}\ndef policy(observations): return np.full((len(observations), 3), {})\n"
FEW = {"setpoint": 70, "episodes": 2, "steps": 5, "allow_code": True}
MODULE, FILE = (
    {"kind": "custom", "target": target} for target in ("mod_of_mine:policy", "file_of_mine.py:policy")
)


@pytest.fixture
def here(tmp_path, monkeypatch):
    """An empty current folder, in which a test writes code; its modules are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", ["", *sys.path])
    known = set(sys.modules)
    yield tmp_path
    for name in set(sys.modules) - known:
        if name.split(".")[0].endswith("_of_mine"):
            del sys.modules[name]


def write(name, action, imports=""):
    with open(name, "w", encoding="utf-8") as file:
        file.write(CODE.format(imports, action))


def played(policy, **options):
    return ibdata.evaluate(policy, **{**FEW, **options}).returns.tolist()


def always(action):
    return played({"kind": "constant", "action": [action] * 3})


@pytest.mark.parametrize("block", [MODULE, FILE], ids=["module", "file"])
def test_code_is_edited_and_evaluated_again(here, block):
    """Somebody edits a policy in an open notebook and evaluates it again: the new code is played."""
    name = block["target"].split(":")[0].removesuffix(".py") + ".py"
    for action in (0.5, -0.5):
        write(name, action)
        assert played(block) == always(action)


def test_a_helper_is_edited_and_the_policy_is_not(here):
    """The file that changes is one that the policy imports: the new helper is played."""
    write("file_of_mine.py", "helper_of_mine.SIZE", "import helper_of_mine")
    for size in (0.5, 0.7):  # of as many bytes, and within a second
        (here / "helper_of_mine.py").write_text(f"SIZE = {size}")
        assert played(FILE) == always(size)


def test_a_module_of_a_package_is_edited(here):
    """The policy is in a package of folders, and so is what it imports from there."""
    (here / "pack_of_mine/inner").mkdir(parents=True)
    write(
        "pack_of_mine/acting.py",
        "inner.sizes.SIZE",
        "from pack_of_mine import inner; import pack_of_mine.inner.sizes",
    )
    for size in (0.5, -0.25):
        (here / "pack_of_mine/inner/sizes.py").write_text(f"SIZE = {size}")
        assert played({"kind": "custom", "target": "pack_of_mine.acting:policy"}) == always(size)


def test_a_module_that_is_imported_already_is_edited(here):
    """It was imported by hand: the call plays the file, and the module in the session stays what it was."""
    write("mod_of_mine.py", 0.5)
    import mod_of_mine

    write("mod_of_mine.py", -0.5)
    assert played(MODULE) == always(-0.5)
    assert sys.modules["mod_of_mine"] is mod_of_mine
    assert played(mod_of_mine.policy) == always(0.5)


@pytest.mark.slow
def test_data_and_score_are_of_one_code(here):
    """Evaluate, edit, evaluate, generate: the data and the last score are of the file as it is."""
    write("mod_of_mine.py", 0.5)
    before = played(MODULE)
    write("mod_of_mine.py", -0.5)
    assert played(MODULE) == always(-0.5) != before
    made = {"name": "m", "setpoints": 70, "episodes": 1, "steps": 3, "policies": [MODULE]}
    assert (ibdata.generate(made, workers=1, allow_code=True).arrays()["actions"] == -0.5).all()


def test_true_values_and_check_policy_take_the_edited_code(here):
    """The other calls that take a block read it anew, too."""
    made = {"name": "m", "setpoints": 70, "episodes": 1, "steps": 4, "policies": ["random"]}
    ds = ibdata.generate(made, workers=1)
    values = []
    for action in (0.5, -0.5):
        write("mod_of_mine.py", action)
        block = {"kind": "constant", "action": [action] * 3}
        one, two = (
            ibdata.true_values(ds, [0], policy=x, steps=3, episodes=2, allow_code=True)
            for x in (MODULE, block)
        )
        np.testing.assert_array_equal(one.values, two.values)
        values.append(one.values)
    assert values[0] != values[1]
    write("mod_of_mine.py", "np.nan")
    with pytest.raises(PolicyError, match="expected finite numbers"):
        check_policy(MODULE, allow_code=True)


def test_two_projects_have_helpers_of_one_name(here):
    """Two folders, each with its own `helper.py`, are compared in one call: each has its own helper."""
    blocks = []
    for folder, size in (("one", 0.5), ("two", -0.5)):
        (here / folder).mkdir()
        write(f"{folder}/file_of_mine.py", "helper_of_mine.SIZE", "import helper_of_mine")
        (here / folder / "helper_of_mine.py").write_text(f"SIZE = {size}")
        blocks.append({"kind": "custom", "target": f"{folder}/file_of_mine.py:policy"})
    assert played(blocks[0]) + played(blocks[1]) == always(0.5) + always(-0.5) == played(blocks)
    with pytest.raises(
        UsageError, match=r"found another module with the name helper_of_mine in use.*; rename"
    ):
        played({"kind": "mixture", "bases": blocks})


def test_policies_are_evaluated_in_threads(here):
    """A sweep in a pool of threads: each plays its own code, and the session is as before."""
    for number in range(4):
        (here / f"project{number}").mkdir()
        (here / f"project{number}/sizes_of_mine.py").write_text(f"SIZE = {number / 4}")
        write(f"project{number}/acting.py", "sizes_of_mine.SIZE", "import sizes_of_mine")
    blocks = [{"kind": "custom", "target": f"project{number}/acting.py:policy"} for number in range(4)]
    before = sys.path[:], sys.dont_write_bytecode, set(sys.modules)
    with ThreadPoolExecutor(4) as threads:
        returns = list(threads.map(played, blocks * 2))
    assert returns == [always(number / 4) for number in range(4)] * 2
    assert (sys.path, sys.dont_write_bytecode) == before[:2]
    assert before[2] <= set(sys.modules)
    assert "sizes_of_mine" not in sys.modules


def test_a_broken_edit_is_mended(here):
    """An edit does not compile: one line with its place, and the mended file is played."""
    write("mod_of_mine.py", "0.5")
    assert played(MODULE) == always(0.5)
    write("mod_of_mine.py", "0.5)")
    with pytest.raises(PolicyError, match=r"mod_of_mine\.py:3: SyntaxError"):
        played(MODULE)
    write("mod_of_mine.py", "-0.5")
    assert played(MODULE) == always(-0.5)


def trained_at(setpoint, std):
    """A stand-in for a model of SB3 whose VecNormalize saw this setpoint with this standard deviation."""
    own = type("IndustrialBenchmarkEnv", (Environment,), {"__module__": "ibdata.environment.single"})()
    mean, var = (
        np.array([setpoint, 50.0, 50.0, 50.0, 30.0, 160.0]),
        np.array([std, 9.0, 9.0, 9.0, 9.0, 9.0]) ** 2,
    )
    own.normalize = type("VecNormalize", (), {})()
    vars(own.normalize).update(
        norm_obs=True, obs_rms=type("Rms", (), {"mean": mean, "var": var}), epsilon=0.0
    )
    vars(own.normalize).update(
        clip_obs=10.0, normalize_obs=lambda x: np.clip((x - mean) / np.sqrt(var), -10, 10).astype(np.float32)
    )
    return Model(own)


def test_a_network_of_one_setpoint_is_saved(here, capsys):
    """Trained at 70 and nowhere else, and saved: nothing is said of setpoints that nobody asked for."""
    ibdata.save_network("a.safetensors", trained_at(70.0, 1e-3))
    assert capsys.readouterr().err == ""
    network = {"kind": "network", "file": "a.safetensors"}
    for setpoints, far in ((70, []), ([60, 70], ["60: up to 1e+04 standard deviations from 70"])):
        notes = ibdata.evaluate(network, setpoints, episodes=2, steps=3).notes
        found = [note.split(",")[0] for note in notes if note.startswith("network: ")]
        assert found == [f"network: setpoint {line}" for line in far]


def test_check_policy_is_given_histories_of_another_length():
    """Observations of one step are no history of six: one line says how many the policy needs."""
    one = np.random.default_rng(0).uniform(0, 100, (8, 1, 6)).astype(np.float32)
    for policy, length in (("optimized", 6), ("expert", 2)):
        with pytest.raises(
            UsageError, match=rf"^histories: found shape \(8, 1, 6\), expected \(n, {length}, 6\)"
        ):
            check_policy(policy, one)
    check_policy(lambda seen: seen[:, 1:4] / 100.0, one)


@pytest.mark.parametrize("change", [lambda x: x[0], lambda x: x[:0], lambda x: x[..., :5], lambda x: "ab"])
def test_check_policy_is_given_other_arrays(change):
    """No episode, a lone one, five columns, or a text: one line."""
    histories = np.random.default_rng(0).uniform(0, 100, (8, 1, 6)).astype(np.float32)
    with pytest.raises(UsageError, match=r"^histories: found .*, expected "):
        check_policy("safe", change(histories))


def test_check_policy_is_given_observations_of_a_dataset(here):
    """Those of `arrays` with a history, shaped as they are told, and more of them than the policy needs."""
    ds = ibdata.generate(
        {"name": "m", "setpoints": 70, "episodes": 2, "steps": 30, "policies": ["random"]}, workers=1
    )
    flat = ds.arrays(history=8)["observations"]
    check_policy(lambda seen: seen[:, 19:22] / 100.0, flat.reshape(len(flat), 8, 6), history=4)
    with pytest.raises(
        UsageError, match=rf"^histories: found shape \({len(flat)}, 48\), expected \(n, 1, 6\)"
    ):
        check_policy("safe", flat)


def test_one_policy_is_evaluated_twice(here):
    """The same call gives the same numbers, alone, beside others, and after others."""
    write("mod_of_mine.py", 0.5)
    alone = played(MODULE)
    assert played(MODULE) == alone
    assert played(["random", MODULE])[1:] == alone == played([MODULE, "safe"])[:1]
