"""What people do with the trained networks that come with ibdata: a row says what is right."""

from __future__ import annotations

import json
import re
import shutil

import numpy as np
import pytest
from helpers.networks import weights

import ibdata
from ibdata import evaluate
from ibdata.errors import ConfigError, UsageError
from ibdata.evaluation.baselines import PROTOTYPES, shipped_baselines
from ibdata.policies.weights_file import SHIPPED

pytestmark = pytest.mark.portable

NAME, OTHER = "random-bc-0", "random-bc-1"
BLOCK = {"kind": "network", "file": NAME}
SHORT = {"episodes": 3, "steps": 4, "setpoint": [20, 70]}
SMALL = {"name": "small", "setpoints": 70, "episodes": 2, "steps": 5}


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture(scope="module")
def beside():
    return evaluate({"mine": [f"random-bc-{seed}" for seed in range(3)]}, against="random")


def command(run, *words):
    return run("evaluate", *words, "--episodes", "3", "--steps", "4", "-q", "--json")


def made(folder, *policies, **options):
    return ibdata.generate(SMALL | {"policies": list(policies)} | options, folder)


def test_a_name_at_the_command(run):
    """Somebody evaluates an agent by its name. It is the network of the shipped file, and so labelled."""
    code, out, _ = command(run, NAME)
    results = json.loads(out)["results"]
    assert (code, results[0]["policy"]) == (0, NAME)
    [result] = evaluate(SHIPPED / f"{NAME}.safetensors", episodes=3, steps=4).results
    assert json.loads(json.dumps(result._asdict())) == results[0]


def test_a_name_in_python_as_a_block_and_as_a_file():
    """Somebody names an agent in three ways. The returns are the same."""
    found = evaluate([NAME, BLOCK, f"{NAME}.safetensors", {"mine": NAME}], **SHORT)
    assert [x.policy for x in found.results[::3]] == [NAME, "network", f"{NAME}-2", "mine"]
    assert (found.returns == found.returns[0]).all()


def test_the_same_agent_twice():
    """Somebody lists an agent twice. Each has its label, and they do not differ."""
    found = evaluate([NAME, NAME], **SHORT)
    assert [x.policy for x in found.results[::3]] == [NAME, f"{NAME}-2"]
    assert {x.mean_difference for x in found.differences if x.minus == NAME} == {0.0}


def test_the_same_agent_twice_in_a_label(here):
    """Somebody counts an agent, or a copy of its file, as two seeds. That is refused."""
    shutil.copy(SHIPPED / f"{NAME}.safetensors", "mine.safetensors")
    for two in ([NAME, NAME], [NAME, "mine.safetensors"], [NAME, BLOCK]):
        with pytest.raises(UsageError, match="policy bc: found the same policy twice"):
            evaluate({"bc": two}, **SHORT)


def test_an_own_file_of_the_same_name(here):
    """Somebody trains their own random-bc-0. A path is theirs, and the bare name ibdata's."""
    (here / f"{NAME}.safetensors").write_bytes(weights(seed=1))
    found = evaluate([NAME, f"{NAME}.safetensors", f"./{NAME}.safetensors"], **SHORT)
    assert (found.returns[1] == found.returns[2]).all()
    assert (found.returns[0] != found.returns[1]).any()


def test_all_seeds_by_a_pattern(run, here):
    """Somebody names the seeds of ibdata by a pattern. Own files come first; what fits nothing is refused."""
    code, out, _ = command(run, "bc=random-bc-*")
    assert (code, json.loads(out)["algorithms"][0]["seeds"]) == (0, 3)
    (here / "random-bc-7.safetensors").write_bytes(weights(seed=1))
    assert json.loads(command(run, "bc=random-bc-*")[1])["algorithms"][0]["seeds"] == 1
    code, _, err = command(run, "x=random-xx-*")
    assert (code, err) == (2, "x=random-xx-*: found no such file, expected at least one\n")


def test_beside_the_line_of_its_own_set(beside):
    """Somebody compares three agents with `random`. They get the very line that stands there for them."""
    mine, ours = (
        next(x for x in beside.algorithms if (x.algorithm, x.source, x.setpoint) == (*name, None))
        for name in (("mine", "yours"), ("bc", "10 episodes each"))
    )
    for one, other in zip(mine[2:], ours[2:], strict=True):
        # Lines are stored as float32.
        assert one == (None if other is None else pytest.approx(other, rel=1e-6))
    stored = [x for x in ibdata.baselines().itertuples() if x[1:4] == ("random", "10 episodes each", "bc")]
    for returns, line in zip(beside.returns, [x for x in stored if x.steps == 100][::2], strict=True):
        np.testing.assert_array_equal(returns.astype(np.float32), line.returns)


def test_against_another_set(beside):
    """Somebody compares an agent of `random` with a set at setpoint 70. A note says so."""
    found = evaluate(NAME, against="optimized-40")
    assert any(note.startswith(f"{NAME}: it was trained on other data than") for note in found.notes)
    assert not any("other data" in note for note in beside.notes)


def test_in_yaml_by_name(run, here):
    """Somebody lists agents in an experiment. Labels are their names; the dataset has both."""
    (here / "a.yaml").write_text(json.dumps(SMALL | {"policies": [NAME, OTHER]}))
    assert run("generate", "a.yaml", "--out", "data", "-q")[0] == 0
    ds = ibdata.open("data")
    assert sorted(ds.episodes["policy"].unique()) == [NAME, OTHER]
    assert len(list((here / "data/meta").glob("*.safetensors"))) == 2
    assert run("validate", "data")[0] == 0
    assert len(ds.select(policy=NAME)) == 10


def test_a_name_and_its_block_are_one_policy():
    """Somebody lists an agent by name and by block. It is refused as any policy that is there twice."""
    with pytest.raises(ConfigError, match=r"policies.1: found the same policy as policies.0"):
        ibdata.load(SMALL | {"policies": [NAME, BLOCK]})


def test_as_a_base(here):
    """Somebody adds random actions to an agent by its name. The base is its block."""
    noisy = {"kind": "epsilon_greedy", "epsilon": 0.5}
    one, other = (made(str(i), {**noisy, "base": base}) for i, base in enumerate((NAME, BLOCK)))
    assert one.content_root == other.content_root


def test_by_an_option_of_the_command(run):
    """Somebody puts an agent into a shipped experiment by --set, and then names it."""
    for words, name in (((), NAME), (("--set", "policies.0.name=a"), "a")):
        code, out, _ = run("config", "show", "random", "--set", f"policies=[{NAME}]", *words, "--json")
        assert (code, json.loads(out)["policies"][0]["name"]) == (0, name)


def test_a_misspelt_name(run):
    """Somebody mistypes a name, anywhere that takes one. The nearest one is suggested."""
    meant = "; did you mean 'random-bc-0'"
    with pytest.raises(UsageError, match=f"policy: found 'rndom-bc-0'{meant}"):
        evaluate("rndom-bc-0")
    with pytest.raises(ConfigError, match=f"policies.0: found 'rndom-bc-0'{meant}"):
        ibdata.load(SMALL | {"policies": ["rndom-bc-0"]})
    with pytest.raises(ConfigError, match=f"found no file 'rndom-bc-0', expected .* folder{meant}"):
        evaluate({"kind": "network", "file": "rndom-bc-0"})


def test_a_name_as_a_kind():
    """Somebody writes the name where the kind stands. They are told how a network is written."""
    with pytest.raises(ConfigError, match=rf"which is a network; write {{kind: network, file: {NAME}}}"):
        ibdata.load(SMALL | {"policies": [{"kind": NAME, "name": "a"}]})


def test_draws_from_a_network_without_deviations():
    """Somebody wants draws from BC, which was not trained with any. It is refused."""
    with pytest.raises(ConfigError, match="found weights without log_std"):
        ibdata.load(SMALL | {"policies": [{"kind": "sampled", "share": 0.5, "base": BLOCK}]})


def test_moved_elsewhere_and_merged(here):
    """Somebody makes two agents' data in two folders and merges them. It is the data of one experiment."""
    both = made("both", NAME, OTHER)
    merged = ibdata.merge([made("a", NAME).path, made("b", OTHER).path], "merged")
    assert sorted(x.stem for x in (here / "merged/meta").glob("*.safetensors")) == sorted(
        x.stem for x in (here / "both/meta").glob("*.safetensors")
    )
    rows, expected = (x.to_pandas().filter(regex="observation|action|reward") for x in (merged, both))
    np.testing.assert_array_equal(rows.to_numpy(), expected.to_numpy())


def test_a_dataset_made_again_from_its_own_experiment(here):
    """Somebody gives the recorded experiment of a dataset back. The network is that of the dataset."""
    ds = made("a", NAME)
    again = ibdata.generate("a/meta/experiment.yaml", "b")
    assert again.content_root == ds.content_root
    assert again.episodes["policy"].unique().tolist() == [NAME]


def test_a_table_with_agents_is_played_again(run, here):
    """Somebody saves a table with agents. --again finds their networks without any file."""
    assert command(run, f"bc={NAME}", f"bc={OTHER}", "--save", "t.json")[0] == 0
    assert run("evaluate", "--again", "t.json", "-q")[0] == 0


def test_true_values_of_an_agent(here):
    """Somebody asks for the true values of an agent by its name. They are those of its file."""
    ds = made("a", "random")
    values = [ibdata.true_values(ds, (0, 3), x, episodes=2, steps=3) for x in (NAME, BLOCK)]
    np.testing.assert_array_equal(values[0].values, values[1].values)


def test_a_target_that_takes_one_action(here):
    """Somebody makes an agent the target of importance weights. The data lack its actions."""
    with pytest.raises(UsageError, match=f"expected data of a policy that can take every action of {NAME}"):
        ibdata.importance(made("a", "random"), NAME)


def test_the_list_of_networks(run, beside):
    """Somebody looks for agents. The list has each name, and the set, algorithm and score of agents."""
    networks = json.loads(run("config", "policies", "--json")[1])["networks"]
    assert [x["name"] for x in networks] == sorted(path.stem for path in SHIPPED.iterdir())
    agents = [x for x in networks if "score" in x]
    assert [x["name"] for x in agents] == [x["name"] for x in networks if x["name"].startswith("random-")]
    [first] = [x for x in agents if x["name"] == NAME]
    assert (first["set"], first["algorithm"], first["seed"]) == ("random", "bc", 0)
    expected = next(x.score for x in beside.results if (x.policy, x.setpoint) == (f"mine ({NAME})", None))
    assert first["score"] == pytest.approx(expected, abs=1e-4)
    assert re.search(rf"^    {NAME} \(score \d+\.\d\): bc, seed 0", run("config", "policies")[1], re.M)


def test_the_results_of_an_agent_in_the_data_frame():
    """Somebody looks for the lines of an agent. Its SHA-256 stands in them."""
    frame = ibdata.baselines()
    sha256 = ibdata.load(SMALL | {"policies": [NAME]}).policies[0].sha256
    lines = frame[frame["weights"] == sha256]
    assert lines["algorithm"].unique().tolist() == ["bc"]
    assert len(lines) == 3
    known = {line.weights for line in shipped_baselines([PROTOTYPES])} - {None}
    assert set(frame["weights"].dropna()) == known
