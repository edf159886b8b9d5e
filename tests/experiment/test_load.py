"""Loading an experiment reports all problems at once, each as file:line:column: key: found, expected."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ibdata.experiment import Experiment
from ibdata.experiment.yaml import Document
from ibdata.policies import POLICIES, Deterministic, Wrapper
from ibdata.policies.compound import Choice

NAME = "expected a name of a-z, 0-9, _ and -, at most 64 characters"
WORDS = {  # of refused.txt
    "KINDS": ", ".join(POLICIES),
    "KEYS": ", ".join(Experiment.model_fields),
    "BASES": ", ".join(kind for kind, policy in POLICIES.items() if not issubclass(policy, Wrapper | Choice)),
    "FIXED": ", ".join(  # without `live`, which no file can have
        kind for kind, policy in POLICIES.items() if issubclass(policy, Deterministic) or kind == "custom"
    ),
}
# What stands in refused.txt: a line, and its problem indented below it.
TABLE = Path(__file__).with_name("refused.txt").read_text(encoding="utf-8")
REFUSED = {
    line: re.sub(r"\{([A-Z]+)\}", lambda word: WORDS[word[1]], problem)
    for line, problem in re.findall(r"^(\w.*)\n    (.*)$", TABLE, flags=re.MULTILINE)
}
# Problems of several values together, and of the dynamics, which the JSON Schema does not see.
TOGETHER = re.compile(
    "in this order|one of the setpoints|expected some of|splits.a.policy: found '|shares episodes| twice|"
    "below start|more than 10000|the same policy|in a base|expected it to be"
)
HOSTILE = ["", "..", "a/b", "a\\b", "-rf", "_a", "a.b", "a b", "a\n", "a\0", "\u0430", "a\u202eb", "a" * 65]


@pytest.mark.parametrize(("line", "problem"), REFUSED.items(), ids=REFUSED)
def test_a_bad_line_is_one_problem_at_its_place(problems, with_lines, schema, line, problem):
    """An editor that knows the schema shows it too."""
    text = with_lines(line)
    assert problems(text) == [f"x.yaml:{problem}"]
    assert schema.is_valid(Document(text).data) == bool(TOGETHER.search(problem))


@pytest.mark.parametrize("name", HOSTILE, ids=ascii)
@pytest.mark.parametrize("line", ["name: {}", "splits: {{{}: {{}}}}"], ids=["name", "split"])
def test_a_name_that_could_be_a_path_or_another_is_refused(problems, with_lines, line, name):
    quoted = '"' + "".join(f"\\U{ord(letter):08x}" for letter in name) + '"'
    [problem] = problems(with_lines(line.format(quoted)))
    assert problem.startswith("x.yaml:1:")
    assert problem.endswith(NAME)
    assert problem.isprintable()


@pytest.mark.parametrize(
    "splits",
    [
        "{a: {episodes: 2}, b: {episodes: {start: 2, stop: 3}}}",
        "{a: {setpoint: 70, policy: safe}, b: {setpoint: 70, policy: random}}",
        "{a: {setpoint: 70}, b: {setpoint: [10]}}",
        "{a: {}, b: {overlap: true}}",
        "{a: {overlap: true}, b: {}}",
    ],
)
def test_splits_may_be_disjoint_in_any_way_or_overlap(loaded, with_lines, splits):
    policies = "policies: [{kind: random}, {kind: safe}]"
    text = with_lines(f"splits: {splits}", "episodes: 4", "setpoints: [10, 70]", policies)
    assert list(loaded(text).splits) == ["a", "b"]


NO_MAPPING = ["1:1: found no mapping, expected an experiment such as 'name: …'"]
WHOLE_FILES = {
    "": NO_MAPPING,
    "[]": NO_MAPPING,
    "name: x\nname: y\n": ["2:1: name: found twice, expected once"],
    "steps: 3": [f"1:1: {key}: missing, expected a value" for key in ("name", "setpoints", "policies")],
    "steps:\nname: x\nsetpoints: 70\npolicies: [safe]": ["1:1: steps: found null, expected a whole number"],
    "name: X\nsetpoints: 101\npolicies: [{kind: rndom}, {kind: constant, foo: 1}]\nsteps: true\nbar: 1\n": [
        f"1:7: name: found 'X', {NAME}",
        "2:12: setpoints: found 101, expected a number of at most 100",
        "3:19: policies.0.kind: found 'rndom'; did you mean 'random'?",
        "3:44: policies.1.foo: no such option; expected one of kind, name, action",
        "4:8: steps: found true, expected a whole number",
        f"5:1: bar: no such option; expected one of {WORDS['KEYS']}",
    ],
    "name: x\nsetpoints: [70, 70]\npolicies: [safe, safe]\nsplits: {a: {setpoint: 71}, b: {episodes: 9}}": [
        "2:12: setpoints: found 70 twice, expected each setpoint once",
        "3:18: policies.1: found the same policy as policies.0; remove one of the two",
        "4:24: splits.a.setpoint: found 71, expected one of the setpoints 70",
        "4:43: splits.b.episodes: found episodes 0 to 8, expected some of 0 to 0; change it, or leave "
        "out all splits by the override splits={}",
    ],
}


@pytest.mark.parametrize(("text", "lines"), WHOLE_FILES.items())
def test_a_file_has_all_its_problems_told_at_once(problems, text, lines):
    assert problems(text) == [f"x.yaml:{line}" for line in lines]
