"""What people do with a table of algorithms: a row says what somebody does in a year, and what is right."""

from __future__ import annotations

import csv
import hashlib
import json
import re
import shutil

import numpy as np
import pytest
from helpers.networks import metadata as metadata_of
from helpers.networks import tensors, weights, written

from ibdata import evaluate
from ibdata._numerics.confidence import t_quantile
from ibdata.errors import UsageError

pytestmark = pytest.mark.portable

SHORT = {"episodes": 6, "steps": 5, "setpoint": [20, 70]}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    for i in range(3):
        (folder / f"iql-{i}.safetensors").write_bytes(weights(seed=i))
    for i in range(2):
        (folder / f"bc-{i}.safetensors").write_bytes(weights(seed=10 + i))
    return folder


@pytest.fixture
def runs(made, tmp_path, monkeypatch):
    """The current folder has runs/ with three networks of IQL and two of BC."""
    shutil.copytree(made, tmp_path / "runs")
    monkeypatch.chdir(tmp_path)
    return tmp_path / "runs"


def files(name):
    return [f"runs/{name}-{i}.safetensors" for i in range(3 if name == "iql" else 2)]


def lines_of(found, label, setpoint=None):
    return next(x for x in found.algorithms if (x.algorithm, x.setpoint) == (label, setpoint))


def command(run, *words):
    return run("evaluate", *words, "--episodes", "3", "--steps", "4", "-q")


def test_three_seeds_by_a_glob(runs, run):
    """Somebody names the files of three seeds by a glob, which no shell expands. They are one line."""
    code, out, _ = command(run, "iql=runs/iql-*.safetensors", "bc=runs/bc-0.safetensors", "--json")
    found = json.loads(out)["algorithms"]
    assert code == 0
    assert [(x["algorithm"], x["seeds"]) for x in found[:2]] == [("iql", 3), ("bc", 1)]


def test_a_glob_that_matches_nothing(runs, run):
    """Somebody mistypes a glob. It is refused, and no other policy stands for it."""
    code, _, err = command(run, "iql=runs/ilq-*.safetensors")
    assert (code, err) == (2, "iql=runs/ilq-*.safetensors: found no such file, expected at least one\n")


def test_equal_labels_are_one_algorithm(runs, run):
    """Somebody lets a shell expand iql=runs/iql-{0,1,2}. Three words with one label are one line."""
    together = command(run, "iql=runs/iql-*.safetensors", "--json")[1]
    assert command(run, *(f"iql={file}" for file in files("iql")), "--json")[1] == together


def test_a_path_with_an_equals_sign(runs, run):
    """Somebody names folders lr=0.001. What stands before the sign is a label only if it is a word."""
    (runs / "lr=0.001").mkdir()
    shutil.copy(runs / "bc-0.safetensors", runs / "lr=0.001/bc.safetensors")
    shutil.copy(runs / "bc-0.safetensors", "lr=0.1.safetensors")
    for word, label in (
        ("runs/lr=0.001/bc.safetensors", "bc"),
        ("x=runs/lr=0.001/bc.safetensors", "x"),
        ("lr=0.1.safetensors", "lr=0.1"),
    ):
        code, out, _ = command(run, word, "--json")
        assert (code, json.loads(out)["results"][0]["policy"]) == (0, label)


def test_the_interval_of_three_seeds(runs):
    """Somebody reads ± of three seeds. It is for new trainings and new episodes, by hand."""
    found = evaluate({"iql": files("iql")}, **SHORT)
    line, returns = lines_of(found, "iql"), found.returns
    means = returns.mean(axis=(1, 2))
    episodes = returns.mean(axis=0)
    errors = episodes.std(axis=1, ddof=1) / np.sqrt(6)
    freedom = (errors**2).sum() ** 2 / (errors**4 / 5).sum()
    seeds = 4.302653 * means.std(ddof=1) / np.sqrt(3)
    by_hand = np.hypot(seeds, t_quantile(freedom) * np.sqrt((errors**2).sum()) / 2)
    assert line.half_width == pytest.approx(by_hand, rel=1e-5)
    assert line.half_width > 1.1 * seeds or line.half_width == pytest.approx(seeds, rel=0.2)
    assert line.mean_return == pytest.approx(returns.mean())
    assert (line.lowest, line.highest) == (pytest.approx(means.min()), pytest.approx(means.max()))
    assert line.spread == pytest.approx(means.std(ddof=1))
    assert line.standard_error == pytest.approx(np.sqrt((errors**2).sum()) / 2)


def test_two_algorithms(runs):
    """Somebody compares IQL with BC. Each has its own spread; equal numbers of seeds are no pairs."""
    found = evaluate({"bc": files("bc"), "iql": files("iql")}, setpoint=70, episodes=400, steps=2)
    [difference] = [x for x in found.differences if x.minus == "bc"]
    bc, iql = found.returns[:2].mean(axis=(1, 2)), found.returns[2:].mean(axis=(1, 2))
    assert (difference.policy, difference.minus) == ("iql", "bc")
    assert difference.mean_difference == pytest.approx(iql.mean() - bc.mean())
    terms = 12.7062 * bc.std(ddof=1) / np.sqrt(2), 4.302653 * iql.std(ddof=1) / np.sqrt(3)
    half = (difference.interval[1] - difference.interval[0]) / 2
    assert half >= np.hypot(*terms) * 0.9999
    assert half == pytest.approx(np.hypot(*terms), rel=0.05)  # 400 episodes add little


def test_one_seed(runs):
    """Somebody has one seed. It has no interval, and a note says that it speaks of its network."""
    found = evaluate({"iql": files("iql"), "bc": files("bc")[:1]}, **SHORT)
    line = lines_of(found, "bc")
    assert (line.seeds, line.half_width, line.optimized_half_width) == (1, None, None)
    assert line.above_optimized < 0
    assert all(x.interval is None for x in found.differences if "bc" in (x.policy, x.minus))
    assert "± –" in repr(found)
    assert any("it speaks of its network" in note for note in found.notes)


def test_a_known_policy_is_no_seed():
    """Somebody compares a formula with a set. It has no seeds; its interval is that of the episodes."""
    found = evaluate("safe", against="transfer")
    line, [result] = lines_of(found, "safe", 75.0), found.results
    assert line.seeds is None
    assert line.half_width == pytest.approx((result.interval[1] - result.interval[0]) / 2)
    assert line.behaviour_half_width > 0


@pytest.mark.parametrize("name", ["optimized-40", "d4rl-like/medium", "random-paper", "drifting"])
def test_the_known_policies_of_every_set(name):
    """Somebody looks for the references of a set. All sets have them, in both dynamics and moving."""
    found = evaluate("safe", against=name, episodes=None)
    overall = found.algorithms[-1].setpoint
    known = {x.algorithm: x for x in found.algorithms if x.source == "known" and x.setpoint == overall}
    assert known.keys() >= {"behaviour", "constant", "optimized", "expert"}
    assert known["optimized"].score == pytest.approx(100.0)
    assert known["constant"].mean_return < known["optimized"].mean_return < known["expert"].mean_return
    assert len({(x.algorithm, x.source) for x in found.algorithms}) == sum(
        x.setpoint == overall for x in found.algorithms
    )


def test_the_same_network_twice(runs):
    """Somebody copies a network under another name. Two seeds that are one are refused."""
    shutil.copy(runs / "iql-0.safetensors", runs / "iql-9.safetensors")
    with pytest.raises(UsageError, match="policy iql: found the same policy twice; one label is one"):
        evaluate({"iql": [*files("iql"), "runs/iql-9.safetensors"]}, **SHORT)
    same = lambda seen: seen[:, 1:4] / 100  # noqa: E731
    with pytest.raises(UsageError, match="policy a: found the same policy twice"):
        evaluate({"a": [same, same]}, **SHORT)


def test_networks_that_differ_in_a_label(runs):
    """Somebody mixes networks of other frames or layers in a label. It is refused."""
    for odd in (weights(frames=3, seed=5), weights(hidden=(4,), seed=5)):
        (runs / "odd.safetensors").write_bytes(odd)
        with pytest.raises(UsageError, match="policy iql: found networks of different frames or layers"):
            evaluate({"iql": [files("iql")[0], "runs/odd.safetensors"]}, **SHORT)


def test_formulas_in_a_label():
    """Somebody puts two formulas under one label. They are no seeds of anything."""
    with pytest.raises(UsageError, match="policy x: found safe, which is not trained"):
        evaluate({"x": ["safe", "bad"]}, **SHORT)
    with pytest.raises(UsageError, match="policy x: found no policy"):
        evaluate({"x": []}, **SHORT)


def test_scalings_that_differ(runs):
    """Somebody trains two seeds on different data. Their scalings tell, and a note says so."""
    other = written(tensors(seed=7), metadata_of(mean="[50, 49, 50, 49, 37, 166]"))
    (runs / "other.safetensors").write_bytes(other)
    found = evaluate({"iql": [files("iql")[0], "runs/other.safetensors"]}, **SHORT)
    assert "iql: its networks scale observations differently, so they saw different data" in found.notes
    assert not any("differently" in note for note in evaluate({"iql": files("iql")}, **SHORT).notes)


def test_a_network_of_another_set(runs):
    """Somebody trains on `random` and compares on `optimized-40`. A note says that the set is another one."""
    found = evaluate({"iql": files("iql")}, against="optimized-40")
    assert any(
        note.startswith("iql: it was trained on other data than siemens-offline/") for note in found.notes
    )


def test_a_scaler_that_saw_one_setpoint(runs):
    """Somebody trains at one setpoint and evaluates at two. A note says so, in saved tables too."""
    one = metadata_of(mean="[70, 49, 50, 49, 37, 166]", std="[0.001, 12, 30, 29, 31, 139]")
    (runs / "one.safetensors").write_bytes(written(tensors(seed=7), one))
    found = evaluate({"iql": [files("iql")[0], "runs/one.safetensors"]}, **SHORT)
    notes = [note for note in found.notes if note.startswith("iql (one): ") and "20" in note]
    assert notes
    for ending in (".tex", ".md", ".json"):
        assert notes[0][:40] in found.save(runs / f"t{ending}").read_text()


class Turning:
    def __init__(self, by):
        self.by = by

    def predict(self, observations):
        return np.full((len(observations), 3), self.by)


def test_objects_of_python_in_a_label():
    """Somebody gives agents as objects. Each is a seed, with the history of the label."""
    agents = [Turning(0.1), Turning(0.3)]
    found = evaluate({"mine": agents, "its": Turning(0.2)}, history={"mine": 4}, **SHORT)
    line = lines_of(found, "mine")
    assert line.seeds == 2
    alone = [evaluate(agent, history=4, **SHORT).returns[0] for agent in agents]
    np.testing.assert_array_equal(found.returns[:2], alone)


def test_called_twice(runs):
    """Somebody calls it twice. The tables are the same."""
    one, two = (evaluate({"iql": files("iql")}, **SHORT) for _ in range(2))
    assert one.algorithms == two.algorithms


def test_seeds_in_another_order(runs):
    """Somebody lists seeds and labels in another order. Each line stays as it is."""
    one = evaluate({"iql": files("iql"), "bc": files("bc")}, **SHORT)
    other = evaluate({"bc": files("bc")[::-1], "iql": files("iql")[::-1]}, **SHORT)
    for label in ("iql", "bc"):
        for a, b in zip(lines_of(one, label), lines_of(other, label), strict=True):
            assert a == pytest.approx(b, rel=1e-12) if isinstance(a, float) else a == b


def test_labels_that_alternate(runs, run):
    """Somebody lists the files of a loop over seeds, in which labels alternate. Each line has its own."""
    words = ("iql=runs/iql-0.safetensors", "bc=runs/bc-0.safetensors", "iql=runs/iql-1.safetensors")
    assert command(run, *words, "--save", "runs/t.json")[0] == 0
    together = evaluate({"iql": files("iql")[:2], "bc": files("bc")[0]}, episodes=3, steps=4)
    saved = json.loads((runs / "t.json").read_text())
    assert saved["algorithms"] == [x._asdict() for x in together.algorithms]
    assert run("evaluate", "--again", "runs/t.json", "-q")[0] == 0


def test_in_a_loop_over_setpoints(runs):
    """Somebody evaluates each setpoint alone. The lines are those of one call."""
    together = evaluate({"iql": files("iql")}, **SHORT)
    for p in (20.0, 70.0):
        alone = evaluate({"iql": files("iql")}, **{**SHORT, "setpoint": p})
        assert lines_of(alone, "iql", p) == lines_of(together, "iql", p)


def test_a_score_of_several_seeds(runs):
    """Somebody compares the score with those of the seeds. It is their mean."""
    found = evaluate({"iql": files("iql")}, setpoint=[40, 70], episodes=40, steps=60)
    overall = [x.score for x in found.results if x.setpoint is None]
    assert lines_of(found, "iql").score == pytest.approx(np.mean(overall))


@pytest.mark.parametrize(
    ("name", "settings"), [("random", {}), pytest.param("random", {"steps": 1000}, marks=pytest.mark.slow)]
)
def test_a_terminal_of_80_columns(name, settings):
    """Somebody prints the table of a set in a terminal. All rows are there, in 80 columns."""
    found = evaluate("safe", against=name, **settings)
    shown = repr(found).split("\n")
    assert max(len(line) for line in shown if line not in found.notes and line not in found.said) <= 80
    rows = sum(line.startswith(("safe ", "bc ", "model-based ")) for line in shown)
    assert rows == 1 + 1 + 3 + 4


def test_many_setpoints_in_a_terminal():
    """Somebody evaluates at every whole setpoint. All results are printed, in 80 columns."""
    shown = repr(evaluate(["safe", "optimized"], list(range(101)), episodes=2, steps=2)).split("\n")
    assert max(map(len, shown[:204])) <= 80
    assert sum(line.startswith(("safe ", "optimized ")) for line in shown) == 2 * 102 + 102


def test_saved_as_people_need_it(runs):
    """Somebody saves the table for a paper, a page and a program. All hold the same numbers."""
    found = evaluate({"iql_a": files("iql"), "bc": files("bc")[:1], "50 % & more": Turning(0.1)}, **SHORT)
    latex = found.save(runs / "t.tex").read_text()
    assert r"iql\_a & 3 & $-$" in latex
    assert r"50 \% \& more & 1 & " in latex
    assert r"& score & $-$ optimized \\" in latex
    assert "| spread | error |" in (found.save(runs / "wide.md").read_text())
    assert re.search(r"\$\\pm\$ +-- &", latex)
    body = latex[latex.index(r"\toprule") :]
    assert not any(bad in body for bad in ("–", "−", "±"))
    assert "| bc | 1 | −" in found.save(runs / "t.md").read_text()
    plain = evaluate("safe", **SHORT).save(runs / "plain.tex").read_text()
    assert "safe & -- & $-$" in plain
    with found.save(runs / "t.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [(row["setpoint"], float(row["mean_return"])) for row in rows[:3]] == [
        (x, lines_of(found, "iql_a", float(x) if x else None).mean_return) for x in ("20.0", "70.0", "")
    ]
    assert rows[3]["half_width"] == ""


def test_saved_where_it_cannot_be(runs, run):
    """Somebody saves to another ending, a missing folder or an old file. It is refused at once."""
    (runs / "old.tex").write_text("mine")
    for path, message in (
        ("t.xlsx", "found the ending '.xlsx', expected one of"),
        ("no/t.tex", "found no folder"),
    ):
        code, _, err = command(run, "safe", "--save", path)
        assert code == 2
        assert message in err
    assert (
        "runs/old.tex: exists already; --overwrite to replace it"
        in command(run, "safe", "--save", "runs/old.tex")[2]
    )
    assert command(run, "safe", "--save", "runs/old.tex", "--overwrite")[0] == 0
    assert r"\toprule" in (runs / "old.tex").read_text()


@pytest.fixture
def saved(runs, run):
    """A table that somebody saved, and moved with its networks."""
    words = (
        "iql=runs/iql-*.safetensors",
        "{kind: gaussian, base: {kind: bad}, scale: 0.1}",
        "--save",
        "t.json",
    )
    assert command(run, *words, "--setpoint", "20", "--setpoint", "70")[0] == 0
    runs.rename(runs.parent / "there")
    return runs.parent / "t.json"


def test_played_again(saved, run):
    """A reviewer plays a table again, with the networks beside it or elsewhere. It is the same."""
    code, out, err = run("evaluate", "--again", "t.json", "--with", "there", "-q")
    assert (code, out, err) == (0, "What was played again is the same as t.json\n", "")
    files = [word for i in range(3) for word in ("--with", f"there/iql-{i}.safetensors")]
    assert run("evaluate", "--again", "t.json", *files, "-q")[0] == 0
    saved.rename(saved.parent / "there/t.json")
    assert run("evaluate", "--again", "there/t.json", "-q")[0] == 0
    assert str(saved.parent) not in (saved.parent / "there/t.json").read_text()


def test_other_weights_under_the_same_name(saved, run):
    """Somebody trains again over the old file. It is refused with both hashes, and so is a missing one."""
    first = saved.parent / "there/iql-0.safetensors"
    old = hashlib.sha256(first.read_bytes()).hexdigest()
    first.write_bytes(weights(seed=77))
    new = hashlib.sha256(first.read_bytes()).hexdigest()
    code, _, err = run("evaluate", "--again", "t.json", "--with", "there", "-q")
    assert (code, err) == (2, f"t.json: iql-0.safetensors: found SHA-256 {new}, expected SHA-256 {old}\n")
    first.unlink()
    code, _, err = run("evaluate", "--again", "t.json", "--with", "there", "-q")
    assert code == 2
    assert "iql-0.safetensors: found no such file" in err


def change(saved, *keys, value):
    data = json.loads(saved.read_text())
    inner = data
    for key in keys[:-1]:
        inner = inner[key]
    inner[keys[-1]] = value
    saved.write_text(json.dumps(data))


GROUP = ("groups", "iql", 0)
FORGED = [
    (("algorithms", 2, "mean_return"), -1.5, 3, "iql: mean_return: found -"),
    (("algorithms", 3, "score"), 99.0, 3, "gaussian: score: found"),
    ((*GROUP, "returns_sha256"), "0" * 64, 3, "iql (iql-0): found other returns, with the mean -"),
    (("set_content_root",), "0" * 64, 3, "content root of the set: found None, expected 000"),
]  # fmt: skip


@pytest.mark.parametrize(("keys", "value", "code", "message"), FORGED)
def test_a_table_that_is_embellished(saved, run, keys, value, code, message):
    """Somebody writes better numbers into the file. What was played says which differ; exit code 3."""
    change(saved, *keys, value=value)
    found = run("evaluate", "--again", "t.json", "--with", "there", "-q")
    assert found[0] == code
    assert message in found[2]
    assert found[2].count("\n") == 1


CODE = {"kind": "custom", "target": "evil:act"}
HOSTILE = [
    (("settings", "episodes"), 10**8, "and 3,200,000,000 steps, expected at most 200 each and 1,000,000,000"),
    (("settings", "steps"), 10**8, "and 2,400,000,000 steps"),
    (("settings", "setpoint"), "x", "setpoint: found"),
    (("settings", "against"), "../x", "against: found '../x'"),
    ((*GROUP, "networks"), {"0" * 64: "../../etc/passwd"}, "String should match pattern"),
    ((*GROUP, "networks"), {"0" * 64: "/dev/zero"}, "String should match pattern"),
    ((*GROUP, "policy", "file"), "/dev/zero", "which is none of its networks"),
    ((*GROUP, "policy"), {"kind": "network", "file": "there/iql-0.safetensors"}, "none of its networks"),
    ((*GROUP, "policy"), {"kind": "sampled", "base": {"file": "/dev/zero"}, "share": 1.0}, "none of its"),
    ((*GROUP, "policy"), CODE, "code that would run; --allow-code if you trust it"),
    ((*GROUP, "policy"), {"kind": "live", "target": "x"}, "found an object of a Python session"),
    (("layout",), "ibdata-table-9", "layout: "),
    (("groups",), {"x": [{}] * 300}, "policy: Field required"),
]  # fmt: skip


@pytest.mark.parametrize(("keys", "value", "message"), HOSTILE)
def test_a_file_of_a_stranger(saved, run, keys, value, message, monkeypatch):
    """A stranger's file asks for too much, for other files or for code. It is refused in one line."""
    (saved.parent / "evil.py").write_text("raise SystemExit(99)")
    monkeypatch.setattr("ibdata.evaluation.play", None)
    change(saved, *keys, value=value)
    code, _, err = run("evaluate", "--again", "t.json", "--with", "there", "-q")
    assert code == 2
    assert message in err
    assert err.count("\n") == 1


def test_no_json_and_a_pipe(saved, run):
    """Somebody gives another file. One line says what was expected."""
    for word in ("there/iql-0.safetensors", "there", "missing.json"):
        code, _, err = run("evaluate", "--again", word, "-q")
        assert (code, err.count("\n")) == (2, 1)


def test_settings_beside_a_saved_table(saved, run):
    """Somebody gives steps or a policy beside --again. The file has its own, so they are refused."""
    for words in (["--steps", "9"], ["safe"], ["--save", "u.tex"]):
        code, _, err = run("evaluate", "--again", "t.json", *words)
        assert code == 2
        assert "found it beside --again" in err
    assert "found it without --again" in command(run, "safe", "--with", "there")[2]


def test_custom_code_is_played_again(runs, run):
    """Somebody's table has custom code. It runs only with consent."""
    (runs / "own.py").write_text("def act(observations):\n    return observations[:, 1:4] / 200\n")
    (runs / "own.yaml").write_text("{kind: custom, target: own.py:act}\n")
    assert command(run, "runs/own.yaml", "--allow-code", "--save", "runs/t.json")[0] == 0
    assert "code that would run" in run("evaluate", "--again", "runs/t.json", "-q")[2]
    assert run("evaluate", "--again", "runs/t.json", "--allow-code", "-q")[0] == 0
    (runs / "own.py").write_text("def act(observations):\n    return observations[:, 1:4] / 100\n")
    code, _, err = run("evaluate", "--again", "runs/t.json", "--allow-code", "-q")
    assert (code, "the table of custom code: found other numbers" in err) == (3, True)


def test_a_table_of_a_set_again(runs, run):
    """Somebody saves a comparison with a set. It holds the content root, and is the same again."""
    words = ("iql=runs/iql-[01]*", "--against", "transfer", "--save", "runs/t.json", "-q")
    assert run("evaluate", *words)[0] == 0
    assert len(json.loads((runs / "t.json").read_text())["set_content_root"]) == 64
    assert run("evaluate", "--again", "runs/t.json", "-q")[0] == 0


def test_the_seeds_of_a_label_by_their_files(runs, run):
    """Somebody looks for the worst seed. Its line has the name of its file, or its number in the call."""
    found = evaluate({"iql": files("iql")[1:], "its": [Turning(0.1), Turning(0.2)]}, **SHORT)
    names = dict.fromkeys(result.policy for result in found.results)
    assert list(names) == ["iql (iql-1)", "iql (iql-2)", "its (1)", "its (2)"]
    alike = evaluate({"its": [Turning(0.1), Turning(0.2)], "its (1)": Turning(0.3)}, **SHORT)
    assert list(dict.fromkeys(x.policy for x in alike.results)) == ["its (1)", "its (2)", "its (1)-2"]
    assert len({x.mean_return for x in alike.results if x.setpoint is None}) == 3
    alone = evaluate("runs/iql-2.safetensors", **SHORT).results[-1]
    assert [x.mean_return for x in found.results if x.policy == "iql (iql-2)"][-1] == alone.mean_return
    printed = command(run, "iql=runs/iql-*.safetensors", "its=runs/bc-0.safetensors", "--wide")[1]
    assert "\niql (iql-0) " in printed
    assert printed.count("its    iql ") == 1  # differences are over all setpoints, as `label minus`
