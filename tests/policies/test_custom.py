"""Custom policies run only where their code is allowed."""

from __future__ import annotations

import hashlib
import json
import subprocess
import sys
import textwrap

import numpy as np
import pytest

import ibdata
from ibdata import Experiment
from ibdata.errors import ConfigError, UsageError
from ibdata.experiment import as_yaml, validated
from ibdata.policies.custom import Custom, CustomError

CODE = textwrap.dedent("""
    import numpy as np

    open("imported", "w").close()

    class Actor:
        def __init__(self, gain=0.0):
            self.gain = gain

        def act(self, history, u):
            return self.gain * (2.0 * u - 1.0) + 0.001 * history[:, 0, 1:4]

        def log_prob(self, history, action):
            return np.full(len(action), -0.5)

    class Learned:
        def predict(self, observations):
            return np.tanh(observations[:, 7:10] / 100.0), None

    def made(value):
        return type("Still", (), {"predict": lambda self, x: np.full((len(x), 3), value)})()

    actor = Actor(0.25)
    nothing = object()

    def failing():
        raise RuntimeError("no weights")
""")


@pytest.fixture
def mine(tmp_path, monkeypatch):
    """A module `mine` in the current folder, forgotten afterwards."""
    (tmp_path / "mine.py").write_text(CODE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))
    yield tmp_path
    sys.modules.pop("mine", None)


PLAIN = {"name": "x", "setpoints": 70}


def described(**policy):
    return Experiment.model_validate(
        {
            "name": "own",
            "setpoints": [20.0, 70.0],
            "policies": [{"kind": "custom", **policy}],
            "steps": 4,
            "output": {"shard_rows": 4},
        }
    )


@pytest.mark.parametrize(
    ("options", "actions"),
    [
        ({"target": "mine:Actor", "uniforms": 3}, lambda h, u: 0.001 * h[:, 0, 1:4]),
        ({"target": "mine:Actor", "uniforms": 3, "params": {"gain": 0.5}},
         lambda h, u: 0.5 * (2 * u - 1) + 0.001 * h[:, 0, 1:4]),
        ({"target": "mine:actor", "uniforms": 3}, lambda h, u: 0.25 * (2 * u - 1) + 0.001 * h[:, 0, 1:4]),
        ({"target": "mine:Learned", "history": 2}, lambda h, u: np.tanh(h[:, 1, 1:4] / 100.0)),
        ({"target": "mine:made", "params": {"value": 0.125}}, lambda h, u: np.full((len(h), 3), 0.125)),
    ],
)  # fmt: skip
def test_act_and_predict_are_asked_for_actions(mine, options, actions):
    policy = Custom(**options)
    rng = np.random.default_rng(0)
    history = rng.uniform(0, 100, (7, policy.history_length, 6)).astype(np.float32)
    u = rng.random((7, policy.uniforms_per_step))
    np.testing.assert_array_equal(policy.act(history, u), actions(history, u))


def test_its_density_is_used_where_it_has_one(mine):
    history, action = np.zeros((2, 1, 6), np.float32), np.zeros((2, 3), np.float32)
    assert Custom(target="mine:actor").log_prob(history, action).tolist() == [-0.5, -0.5]
    assert np.isnan(Custom(target="mine:Learned").log_prob(history, action)).all()


@pytest.mark.parametrize(
    ("target", "line"),
    [
        ("mine:absent", "mine:absent: cannot be loaded: AttributeError"),
        ("absent_module:x", "absent_module:x: cannot be loaded: ModuleNotFoundError"),
        ("mine:failing", "mine:failing: cannot be loaded: mine.py:27: RuntimeError: no weights"),
        (
            "mine:nothing",
            "mine:nothing: found object, expected an object with act(history, u) or predict(observ",
        ),
    ],
)
def test_what_cannot_be_loaded_is_one_line_and_leaves_nothing(mine, target, line):
    with pytest.raises(CustomError) as error:
        ibdata.generate(described(target=target), "out", workers=1, allow_code=True)
    assert str(error.value).startswith(line)
    assert not (mine / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("wrap", [False, True], ids=["itself", "as a base"])
def test_code_runs_only_where_it_is_allowed_and_is_recorded(mine, wrap, capsys):
    block = {"kind": "custom", "target": "mine:actor", "uniforms": 3}
    block = {"kind": "epsilon_greedy", "base": block, "epsilon": 0.5} if wrap else block
    experiment = Experiment.model_validate({**described(target="mine:actor").plain(), "policies": [block]})
    for call in (
        lambda: ibdata.generate(experiment, "out", workers=1),
        lambda: ibdata.generate(experiment, "out", workers=2, resume=True),
    ):
        with pytest.raises(UsageError, match="found a custom policy, mine:actor, which is code"):
            call()
    assert not (mine / "imported").exists()
    made = ibdata.generate(experiment, "out", workers=2, allow_code=True)
    assert "ibdata: running the code of mine:actor" in capsys.readouterr().err
    assert made.manifest["reproducible"] == "same-environment"
    sha256 = hashlib.sha256((mine / "mine.py").read_bytes()).hexdigest()
    assert made.manifest["code"] == [
        {
            "target": "mine:actor",
            "version": None,
            "sha256": sha256,
            "files": {},
            "distributions": {"numpy": np.__version__},
        }
    ]
    assert ibdata.generate(experiment, "again", workers=1, allow_code=True).content_root == made.content_root


def test_repair_and_reproduce_need_leave_too(mine, shard_file):
    made = ibdata.generate(described(target="mine:Learned", history=2), "out", workers=1, allow_code=True)
    root = made.content_root
    shard = shard_file(mine / "out", 1)
    (mine / "out" / shard).unlink()
    for call in (ibdata.repair, ibdata.reproduce):
        with pytest.raises(UsageError, match="which is code that would run; allow_code=True"):
            call("out")
    assert ibdata.repair("out", workers=1, allow_code=True) == [shard]
    assert ibdata.reproduce("out", allow_code=True) == (2, [])
    assert ibdata.open("out").content_root == root


READING = """
    import json, sys
    import ibdata
    from ibdata.cli import main
    from ibdata.dataset.difference import difference

    ds = ibdata.open("out")
    ds.to_pandas(), ds.arrays(), ds.statistics(), ds.episodes, list(ds.iter_batches())
    assert ibdata.validate("out") == []
    assert difference(ds, ibdata.open("out")) == []
    ibdata.split("out", source=[20], target=[70])
    ibdata.merge(["out", "other"], "both")
    for command in ("info", "head", "stats", "validate"):
        try:
            main([command, "both"])
        except SystemExit as end:
            assert not end.code
    print(json.dumps(sorted(set(sys.modules) & {"mine", "pickle_of_mine"})))
"""


@pytest.mark.slow
def test_reading_checking_splitting_and_merging_never_import_it(mine):
    for seed, name in enumerate(["out", "other"]):
        experiment = described(target="mine:actor", uniforms=3).model_copy(update={"seed": seed})
        ibdata.generate(experiment, name, workers=1, allow_code=True)
    (mine / "imported").unlink()
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(READING)], capture_output=True, text=True, cwd=mine
    )
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout.splitlines()[-1]) == []
    assert not (mine / "imported").exists()


@pytest.mark.parametrize(
    "target",
    ["mine", "mine.Actor", "mine:Actor()", "../mine:Actor", "mine:a.b", "os;x:y", "", "/mine.py:Actor",
     "mine.py", "a//mine.py:Actor", "a\\mine.py:Actor", "mine.py:Actor()"],
)  # fmt: skip
def test_a_target_that_is_no_name_is_refused(target, tmp_path):
    (tmp_path / "x.yaml").write_text(
        f"name: x\nsetpoints: 70\npolicies: [{{kind: custom, target: {json.dumps(target)}}}]\n"
    )
    with pytest.raises(UsageError, match=r"policies\.0\.target: found .*, expected package.module:name"):
        ibdata.load(tmp_path / "x.yaml")


def test_evaluating_a_file_that_names_code_needs_leave(mine):
    (mine / "p.yaml").write_text("{kind: custom, target: 'mine:actor', uniforms: 3}")
    with pytest.raises(UsageError, match=r"p\.yaml: found a custom policy, which is code"):
        ibdata.evaluate("p.yaml", steps=3, episodes=2)
    assert not (mine / "imported").exists()
    from_file = ibdata.evaluate("p.yaml", steps=3, episodes=2, allow_code=True)
    typed = ibdata.evaluate({"kind": "custom", "target": "mine:actor", "uniforms": 3}, steps=3, episodes=2)
    assert from_file.returns.tolist() == typed.returns.tolist()


def test_a_suite_with_code_is_refused_before_anything_is_made(mine):
    (mine / "suite").mkdir()
    (mine / "suite/a.yaml").write_text("name: a\nsetpoints: 70\npolicies: [{kind: random}]\nsteps: 3\n")
    code = "[{kind: custom, target: 'mine:Learned', history: 2}]"
    (mine / "suite/b.yaml").write_text(f"name: b\nsetpoints: 70\npolicies: {code}\nsteps: 3\n")
    with pytest.raises(UsageError, match="b: found a custom policy"):
        ibdata.generate_all("suite", "out", workers=1)
    assert not (mine / "out").exists()
    assert list(ibdata.generate_all("suite", "out", workers=1, allow_code=True)) == ["a", "b"]


# --- files, and where they are


BESIDE = """
import numpy as np
from size_of_mine import SIZE

class Own:
    def predict(self, observations):
        return np.full((len(observations), 3), SIZE)
"""


@pytest.fixture
def beside(tmp_path, monkeypatch):
    """`run(target)` generates from exp/own.yaml, with code in exp/ and exp/code/; sys.path is restored."""
    (tmp_path / "exp/code").mkdir(parents=True)
    (tmp_path / "exp/code/own-policy.py").write_text(BESIDE)
    (tmp_path / "exp/code/size_of_mine.py").write_text("SIZE = 0.5")
    (tmp_path / "exp/policy_beside.py").write_text(
        BESIDE.replace("from size_of_mine import SIZE", "SIZE = 0.5")
    )
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", list(sys.path))

    def run(target, out="out", **options):
        (tmp_path / "exp/own.yaml").write_text(as_yaml(described(target=target)).decode())
        return ibdata.generate("exp/own.yaml", out, **{"workers": 1, "allow_code": True, **options})

    return run


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_a_module_beside_the_yaml_is_found(beside, tmp_path):
    (code,) = beside("policy_beside:Own").manifest["code"]
    assert code["sha256"] == sha256(tmp_path / "exp/policy_beside.py")
    assert "policy_beside" not in sys.modules


def test_a_module_in_the_current_folder_comes_first(beside, tmp_path):
    (tmp_path / "policy_beside.py").write_text(BESIDE.replace("from size_of_mine import SIZE", "SIZE = 0.25"))
    (code,) = beside("policy_beside:Own").manifest["code"]
    assert code["sha256"] == sha256(tmp_path / "policy_beside.py")


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_file_is_found_with_what_it_imports_and_hashed(beside, tmp_path, workers):
    made = beside("code/own-policy.py:Own", workers=workers)
    assert (made.to_pandas()["act_gain"] == 0.5).all()
    (code,) = made.manifest["code"]
    folder = tmp_path / "exp/code"
    assert code["target"] == "code/own-policy.py:Own"
    assert code["sha256"] == sha256(folder / "own-policy.py")
    assert code["files"] == {"size_of_mine.py": sha256(folder / "size_of_mine.py")}


def test_a_file_has_the_same_identity_as_a_module(beside, tmp_path):
    made = beside("code/own-policy.py:Own")
    (tmp_path / "exp/code/size_of_mine.py").write_text("SIZE = 0.25")
    with pytest.raises(UsageError, match=r"other code than the run began with, in size_of_mine\.py"):
        beside("code/own-policy.py:Own", resume=True)
    again = beside("code/own-policy.py:Own", overwrite=True)
    assert again.content_root != made.content_root
    assert (again.to_pandas()["act_gain"] == 0.25).all()


def test_a_file_that_is_not_found_is_expected_in_places_that_are_named(beside, tmp_path):
    beside("code/own-policy.py:Own")
    assert ibdata.validate("out") == []
    line = r"^code/own-policy\.py:Own: found no file 'code/own-policy\.py', expected it beside .*: "
    here = f"{tmp_path}/code/own-policy.py; "
    with pytest.raises(UsageError, match=f"{line}{here}"):
        ibdata.reproduce("out", allow_code=True)
    with pytest.raises(UsageError, match=f"{line}{tmp_path}/out/meta/code/own-policy.py or {here}"):
        ibdata.generate("out/meta/experiment.yaml", "again", workers=1, allow_code=True)
    (tmp_path / "out/meta/stats.json").unlink()
    assert ibdata.repair("out") == ["meta/stats.json"]
    (tmp_path / "exp/code").rename("code")
    assert ibdata.reproduce("out", allow_code=True) == (2, [])
    again = ibdata.generate("out/meta/experiment.yaml", "again", workers=1, allow_code=True)
    assert again.content_root == ibdata.open("out").content_root


def test_a_file_of_which_there_are_two_that_differ_is_refused(beside, tmp_path):
    (tmp_path / "code").mkdir()
    (tmp_path / "code/own-policy.py").write_text("Own = 1")
    with pytest.raises(UsageError, match=r"own-policy\.py, which differ, so nobody knows which of the two"):
        beside("code/own-policy.py:Own")


def test_a_file_with_the_name_of_another_module_is_refused(beside, tmp_path):
    (tmp_path / "exp/json.py").write_text("Own = 1")
    with pytest.raises(
        UsageError, match=r"json\.py:Own: found another module with the name json, .*; rename"
    ):
        ibdata.evaluate({"kind": "custom", "target": "exp/json.py:Own"})


def test_a_policy_in_a_file_finds_its_code_beside_it(beside, tmp_path):
    (tmp_path / "exp/p.yaml").write_text("{kind: custom, target: 'code/own-policy.py:Own'}")
    found = ibdata.evaluate("exp/p.yaml", steps=3, episodes=2, allow_code=True)
    still = ibdata.evaluate({"kind": "constant", "action": [0.5] * 3}, steps=3, episodes=2)
    assert found.returns.tolist() == still.returns.tolist()


# --- what draws nothing


LIAR = """
import itertools
import numpy as np

calls = itertools.count()

class Liar:
    def __init__(self, changes_at):
        self.changes_at = changes_at

    def predict(self, observations):
        return np.full((len(observations), 3), 0.5 if next(calls) >= self.changes_at else 0.0)

class Still:
    def predict(self, observations):
        return observations[:, 1:4] / 200.0
"""


@pytest.fixture
def liar(mine):
    (mine / "liar_of_mine.py").write_text(LIAR)
    yield "liar_of_mine:Liar"
    sys.modules.pop("liar_of_mine", None)


def test_what_is_said_to_be_deterministic_has_a_density_and_may_be_a_base(liar):
    still = {"kind": "custom", "target": "liar_of_mine:Still", "deterministic": True}
    wrapped = [
        {"kind": "gaussian", "base": still, "scale": 0.1},
        {"kind": "epsilon_greedy", "base": still, "epsilon": 0.2, "per_dimension": True},
    ]
    plain = {**described(target="x:y").plain(), "policies": [still, *wrapped]}
    made = ibdata.generate(Experiment.model_validate(plain), "out", workers=1, allow_code=True).to_pandas()
    assert (made["action_log_prob"][made["policy"] == "custom"] == 0.0).all()
    assert np.isfinite(made["action_log_prob"]).all()
    assert made["action_log_prob"].nunique() > 2


@pytest.mark.parametrize("deterministic", [False, True])
@pytest.mark.parametrize("changes_at", [1, 4, 9])
def test_what_answers_otherwise_when_asked_again_is_refused(liar, changes_at, deterministic):
    """At the first step, at the second one, and at the third one in the second file."""
    line = "step .: found other actions when the same was asked again, expected equal ones; memory must be"
    options = {"target": liar, "params": {"changes_at": changes_at}, "deterministic": deterministic}
    with pytest.raises(ibdata.IbdataError, match=line):
        ibdata.generate(described(**options), "out", workers=1, allow_code=True)


# --- what remembers


REMEMBERING = """
import numpy as np
from ibdata.policies import Policy
from ibdata.policies.given import Decision

class Deciding(Policy):
    kind: str = "deciding"
    memory_size = 3
    uniforms_per_step = 3
    uniforms_per_episode = 1
    theta: float = 0.15

    def decide(self, given):
        centre = given.episode_uniforms - 0.5
        x = (1.0 - self.theta) * given.memory + 0.2 * (2.0 * given.uniforms - 1.0)
        return Decision(centre + x, x)

    def log_density(self, given, action):
        return given.memory[:, 0] + action[:, 0]

class Resetting:
    def reset(self, n):
        self.x = np.zeros((n, 3))

    def act(self, history, u):
        self.x = 0.85 * self.x + 0.2 * (2.0 * u - 1.0)
        return self.x

class Leaking(Resetting):
    def reset(self, n):
        self.x = getattr(self, "x", np.zeros((n, 3)))

class Recurrent:
    def predict(self, observation, state=None, episode_start=None, deterministic=False):
        cell, hidden = state or np.full((2, 2, len(observation), 3), 9.0)
        cell, hidden = (np.where(episode_start[:, None], 0.0, x) for x in (cell, hidden))
        cell = 0.9 * cell + 0.001 * observation[:, 1:4]
        hidden = 0.5 * hidden + cell
        return hidden[0] - 0.5 * deterministic, (cell, hidden)
"""


@pytest.fixture
def remembering(mine):
    """Make a dataset of two policies, of which one remembers in files of so many rows."""
    (mine / "remembering.py").write_text(REMEMBERING)

    def make(name, rows=100, workers=1, **options):
        block = {"kind": "custom", "target": f"remembering:{name}", **options}
        sticky = {"kind": "sticky", "base": block, "kappa": 0.3}
        plain = {**PLAIN, "setpoints": [20, 70], "policies": [block, sticky], "episodes": 3, "steps": 12}
        experiment = validated({**plain, "output": {"shard_rows": rows}})
        out = f"{name}-{rows}-{workers}"
        return ibdata.generate(experiment, out, workers=workers, allow_code=True)

    yield make
    sys.modules.pop("remembering", None)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("Deciding", {"uniforms": 3, "params": {"theta": 0.3}}),
        ("Resetting", {"uniforms": 3}),
        ("Recurrent", {"deterministic": True}),
    ],
)
def test_what_is_remembered_in_the_open_has_one_root_over_files_and_repair(
    remembering, shard_file, mine, name, options
):
    together, apart = remembering(name, **options), remembering(name, rows=36, **options)
    assert together.content_root == apart.content_root
    assert (len(together.manifest["shards"]), len(apart.manifest["shards"])) == (2, 4)
    lost = shard_file(apart.path, 2)
    (apart.path / lost).unlink()
    assert ibdata.repair(apart.path, workers=1, allow_code=True) == [lost]
    known = np.isfinite(apart.to_pandas()["action_log_prob"])
    assert known.any() == (name != "Resetting")


@pytest.mark.slow
def test_what_is_remembered_has_one_root_over_workers(remembering):
    roots = {
        remembering("Resetting", rows=36, workers=workers, uniforms=3).content_root for workers in (1, 2, 3)
    }
    assert len(roots) == 1


def test_what_leaks_from_one_episode_into_the_next_is_refused(remembering):
    with pytest.raises(
        ibdata.IbdataError,
        match="policy custom: episode 0: step 0: found other actions when the same was asked again, .*; "
        r"memory must be returned by decide, be the state of predict, or begin anew in reset\(n\)",
    ):
        remembering("Leaking", uniforms=3)


def test_an_object_with_decide_says_which_option_is_too_small(remembering):
    line = "remembering:Deciding: found uniforms: 0, expected at least .* of Deciding; write uniforms: 3"
    with pytest.raises(CustomError, match=line):
        remembering("Deciding")


@pytest.mark.parametrize(
    ("block", "line"),
    [
        (
            {"deterministic": True, "uniforms": 3},
            "found deterministic: true and uniforms: 3, expected only one",
        ),
        ({"deterministic": 1}, "found 1, expected true or false"),
    ],
)
def test_what_draws_is_not_deterministic(block, line):
    with pytest.raises(ConfigError, match=line):
        validated({**PLAIN, "policies": [{"kind": "custom", "target": "a:b", **block}]})


def test_a_base_without_the_word_is_refused_in_one_line():
    block = {"kind": "gaussian", "base": {"kind": "custom", "target": "a:b"}, "scale": 1.0}
    with pytest.raises(
        ConfigError, match=r"base: found custom without deterministic: true, expected a policy th"
    ):
        validated({**PLAIN, "policies": [block]})


def test_the_word_changes_nothing_where_it_is_not_said():
    without, spelt = Custom(target="a:b"), Custom(target="a:b", deterministic=False)
    assert without.form() == spelt.form() == {"kind": "custom", "target": "a:b"}
    assert "deterministic" not in without.model_dump()
    assert "deterministic" not in str(Experiment.model_validate({**PLAIN, "policies": [without]}).plain())
    assert Custom(target="a:b", deterministic=True).model_dump()["deterministic"] is True
