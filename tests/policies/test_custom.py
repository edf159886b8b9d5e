"""Custom policies run only where their code is allowed."""

from __future__ import annotations

import inspect
import re
from pathlib import Path

import numba
import numpy as np
import pytest
from helpers import remembering
from helpers.own_code import FORMS
from helpers.policies import proposed, ready
from helpers.refusals import refused

import ibdata
from ibdata.errors import PolicyError
from ibdata.policies.user_object import Custom
from ibdata.testing import check_policy


@pytest.fixture
def mine(code):
    """A function for the policy of a block, with a module `mine` in the current folder."""
    return lambda **block: code(FORMS, **block)


@pytest.mark.parametrize(
    ("options", "actions"),
    [
        ({"target": "mine:Actor", "draws": 3}, lambda h, u: 0.001 * h[:, 0, 1:4]),
        ({"target": "mine:Actor", "draws": 3, "params": {"gain": 0.5}},
         lambda h, u: 0.5 * (2 * u - 1) + 0.001 * h[:, 0, 1:4]),
        ({"target": "mine:actor", "draws": 3}, lambda h, u: 0.25 * (2 * u - 1) + 0.001 * h[:, 0, 1:4]),
        ({"target": "mine:Learned", "history": 2}, lambda h, u: np.tanh(h[:, 1, 1:4] / 100.0)),
        ({"target": "mine:made", "params": {"value": 0.125}}, lambda h, u: np.full((len(h), 3), 0.125)),
        ({"target": "mine:still", "params": {"value": 0.5}}, lambda h, u: np.full((len(h), 3), 0.5)),
    ],
)  # fmt: skip
def test_act_and_predict_are_asked_for_actions(mine, options, actions):
    mine(**options)
    policy = ready(Custom(**options))
    rng = np.random.default_rng(0)
    history = rng.uniform(0, 100, (7, policy.needs.history, 6)).astype(np.float32)
    u = rng.random((7, policy.needs.draws))
    np.testing.assert_array_equal(proposed(policy, history, u), actions(history, u))


@pytest.mark.parametrize(
    ("target", "line"),
    [
        ("mine:Lerned", "mine:Lerned: found no 'Lerned' in the module; did you mean 'Learned'?"),
        ("mine:by_name", "mine:by_name: found a function of obs, expected one whose first parameter is `obs"),
        ("absent_module:x", "absent_module:x: cannot be loaded: ModuleNotFoundError"),
        ("mine:failing", "mine:failing: cannot be loaded: mine.py:30: RuntimeError: no weights"),
        ("mine:nothing", "mine:nothing: found object, expected an object with decide(observed), act(history"),
        ("mine:counting", "policy custom: found other actions when the same was asked again"),
    ],
)
def test_what_cannot_be_used_is_one_line(mine, target, line):
    mine(target=target)
    block = {"kind": "custom", "target": target}
    refused(f"^{re.escape(line)}", ibdata.evaluate, block, steps=3, episodes=2, error=PolicyError)


@pytest.mark.slow
@pytest.mark.parametrize("wrap", [False, True], ids=["itself", "as a base"])
def test_code_runs_only_where_it_is_allowed(mine, wrap, capsys):
    block = {"kind": "custom", "target": "mine:actor", "draws": 3}
    own = mine(**({"kind": "epsilon_greedy", "base": block, "epsilon": 0.5} if wrap else block))
    refused("found a custom policy, mine:actor, which is code", own.run, workers=2, allow_code=False)
    assert not Path("imported").exists()
    made = own.run(workers=2)
    assert "ibdata: running the code of mine:actor" in capsys.readouterr().err
    assert made.manifest["reproducible"] == "same-environment"
    recorded = {
        "target": "mine:actor",
        "version": None,
        "sha256": own.sha256("mine.py"),
        "files": {},
        "distributions": {"numba": numba.__version__, "numpy": np.__version__},
    }
    assert made.manifest["code"] == [recorded]
    assert own.run("again").content_root == made.content_root


@pytest.mark.slow
def test_only_repair_and_reproduce_run_code_and_ask_before(mine, shard_file):
    made = mine(target="mine:Learned", history=2).run()
    Path("imported").unlink()
    assert ibdata.validate("out") == []
    ibdata.split("out", {"source": {"setpoint": 20}, "target": {"setpoint": 70}})
    ibdata.open("out").statistics()
    shard = shard_file("out", 1)
    Path("out", shard).unlink()
    for call in (ibdata.repair, ibdata.reproduce):
        refused("which is code that would run; allow_code=True if you trust it", call, "out")
    assert not Path("imported").exists()
    assert ibdata.repair("out", workers=1, allow_code=True) == [shard]
    assert ibdata.reproduce("out", allow_code=True) == (4, [])
    assert ibdata.open("out").content_root == made.content_root


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Centred", "Resetting"])
def test_what_is_remembered_is_the_same_over_files_workers_and_repair(code, shard_file, name):
    code({"remembering.py": inspect.getsource(remembering)})
    block = {"kind": "custom", "target": f"remembering.py:{name}", "draws": 3}
    sticky = {"kind": "sticky", "base": block, "kappa": 0.3}
    plain = {"name": "x", "setpoints": [20, 70], "policies": [block, sticky], "episodes": 3, "steps": 12}
    together, apart = (
        ibdata.generate(
            {**plain, "output": {"shard_rows": rows}}, f"{rows}", workers=workers, allow_code=True
        )
        for rows, workers in ((100, 1), (36, 2))
    )
    assert together.content_root == apart.content_root
    assert (len(together.manifest["shards"]), len(apart.manifest["shards"])) == (2, 4)
    lost = shard_file(apart.path, 2)
    (apart.path / lost).unlink()
    assert ibdata.repair(apart.path, workers=1, allow_code=True) == [lost]
    assert np.isfinite(apart.to_pandas()["action_log_prob"]).any() == (name == "Centred")


def test_evaluating_a_file_that_names_code_needs_leave(mine):
    block = "{kind: custom, target: 'mine:actor', draws: 3}"
    mine().edit({"p.yaml": block, "e.yaml": f"{{name: e, setpoints: 20, policies: [{block}]}}"})
    [of_experiment] = ibdata.load("e.yaml").policies
    for run in (ibdata.evaluate, check_policy):
        for policy in ("p.yaml", of_experiment):
            refused("the custom policy mine:actor of a file, which is code that", run, policy)
    assert not Path("imported").exists()
    check_policy(of_experiment, allow_code=True)
    from_file = ibdata.evaluate("p.yaml", steps=3, episodes=2, allow_code=True)
    typed = ibdata.evaluate({"kind": "custom", "target": "mine:actor", "draws": 3}, steps=3, episodes=2)
    assert from_file.returns.tolist() == typed.returns.tolist()


def test_code_may_change_its_params(code):
    """They are its own: the block, which is recorded, stays as it is."""
    text = "def made(layers):\n    layers.append(9)\n    return lambda observations: observations[:, 1:4]\n"
    code({"changing.py": text})
    policy = Custom(target="changing.py:made", params={"layers": [1]})
    assert ready(policy).params == ready(policy).params == policy.params == {"layers": [1]}
