"""Files with custom policies: where they are looked for, what they may import, and their lines in errors."""

from __future__ import annotations

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from helpers.policies import proposed, ready
from helpers.refusals import refused

import ibdata
from ibdata.errors import UsageError
from ibdata.evaluation.policies import as_policy
from ibdata.policies.checked import AnswerError
from ibdata.policies.code import error_line

BESIDE = """
    import numpy as np
    from size_of_mine import SIZE

    class Own:
        def predict(self, observations):
            return np.full((len(observations), 3), SIZE)
    """
OWN = {
    "code/own-policy.py": BESIDE,
    "code/size_of_mine.py": "SIZE = 0.5",
    "policy_beside.py": BESIDE.replace("from size_of_mine import SIZE", "SIZE = 0.5"),
}


@pytest.fixture
def beside(code):
    """A policy in exp/code/, of the experiment exp/own.yaml."""
    return code(OWN, "exp", target="code/own-policy.py:Own")


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_a_file_is_found_with_what_it_imports_of_which_an_edit_makes_new_data(beside, workers):
    made = beside.run(workers=workers)
    assert (made.to_pandas()["act_gain"] == 0.5).all()
    (code,) = made.manifest["code"]
    assert code["target"] == "code/own-policy.py:Own"
    assert code["sha256"] == beside.sha256("code/own-policy.py")
    assert code["files"] == {"size_of_mine.py": beside.sha256("code/size_of_mine.py")}
    beside.edit({"code/size_of_mine.py": "SIZE = 0.25"})
    again = beside.run(overwrite=True)
    assert again.content_root != made.content_root
    assert (again.to_pandas()["act_gain"] == 0.25).all()


@pytest.mark.slow
def test_a_missing_file_is_expected_in_places_that_are_named(beside, tmp_path):
    beside.run()
    assert ibdata.validate("out") == []
    line = r"^code/own-policy\.py:Own: found no file 'code/own-policy\.py', expected it beside .*: "
    here = f"{tmp_path}/code/own-policy.py; "
    refused(f"{line}{here}", ibdata.reproduce, "out", allow_code=True)
    missing = r"policies\.0\.target: found no file 'code/own-policy\.py', expected it beside .*: "
    named = rf"^out/meta/experiment\.yaml:\d+:\d+: {missing}"
    with pytest.raises(UsageError, match=f"{named}{tmp_path}/out/meta/code/own-policy.py or {here}"):
        ibdata.generate("out/meta/experiment.yaml", "again", workers=1, allow_code=True)
    (tmp_path / "exp/code").rename("code")
    assert ibdata.reproduce("out", allow_code=True) == (4, [])
    again = ibdata.generate("out/meta/experiment.yaml", "again", workers=1, allow_code=True)
    assert again.content_root == ibdata.open("out").content_root


def test_a_policy_keeps_its_folder_where_it_is_checked_again(beside):
    """In an experiment and an evaluation; and a copy of a policy around it has the folder too."""
    block = {"kind": "custom", "target": "policy_beside.py:Own"}
    beside.edit({"around.yaml": json.dumps({"kind": "epsilon_greedy", "base": block, "epsilon": 0.1})})
    around = as_policy("exp/around.yaml", allow_code=True)
    described = {"name": "x", "setpoints": 70, "policies": [around.base]}
    made = [ibdata.Experiment(**described), ibdata.load(described)]
    changed = around.model_copy(update={"epsilon": 0.2})
    new = around.model_copy(update={"base": {**block, "draws": 1}})
    for policy in [around, changed, new, *(each.policies[0] for each in made)]:
        assert ready(policy).checked_with["folder"] == Path("exp")


def test_policies_of_several_files_are_found_beside_each(code):
    """Also by the process in which they act, and by the search for what was edited since."""
    text = "def own(observations):\n    return 0 * observations[:, :3] + {}"
    quarter, half = (
        code({f"of-{gain}.py": text.format(gain)}, f"of-{gain}", target=f"of-{gain}.py:own")
        for gain in (0.25, 0.5)
    )
    policies = [policy for own in (quarter, half) for policy in ibdata.load(own.config).policies]
    several = {"name": "own", "setpoints": 70, "policies": policies, "steps": 4}
    made = ibdata.generate(several, "made", workers=1, allow_code=True)
    assert set(made.to_pandas()["act_gain"]) == {0.25, 0.5}
    half.edit({"of-0.5.py": "own = None"})
    with pytest.raises(UsageError, match=r"made: holds .* other code, in of-0\.5\.py:own"):
        ibdata.generate(several, "made", workers=1, allow_code=True)


FAILING = {
    "code_of_mine.py": """
        import json, sys

        def index(): return [][7]
        def in_the_standard_library(): return json.loads("{")
        def two_lines(): raise RuntimeError("one\\n  two")
        def silent(): raise KeyError
        def leave(): sys.exit("enough")
        def from_text(): exec("1 / 0")
        def no_python(): import broken_code
        """,
    "broken_code.py": "x = 1\nx = = 2\n",
}


def caught(call):
    with pytest.raises(BaseException) as error:  # noqa: PT011
        call()
    return error_line(error.value)


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("index", "code_of_mine.py:4: IndexError: list index out of range"),
        ("in_the_standard_library", "code_of_mine.py:5: JSONDecodeError: Expecting property name enclosed"),
        ("two_lines", "code_of_mine.py:6: RuntimeError: one two"),
        ("silent", "code_of_mine.py:7: KeyError"),
        ("leave", "code_of_mine.py:8: SystemExit: enough"),
        ("from_text", "code_of_mine.py:9: ZeroDivisionError: division by zero"),
        ("no_python", "broken_code.py:2: SyntaxError: invalid syntax"),
    ],
)
def test_an_error_names_the_innermost_line_of_a_users_file(code, tmp_path, monkeypatch, name, line):
    code(FAILING)
    monkeypatch.syspath_prepend(tmp_path)
    fails = runpy.run_path(str(tmp_path / "code_of_mine.py"))[name]
    found = caught(fails)
    assert found.startswith(line)
    assert "\n" not in found
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert caught(fails) == f"{tmp_path}/{found}"


@pytest.mark.parametrize(
    ("raised", "caught"),
    [
        (BaseException, AnswerError("BaseException: x; it was given")),
        (GeneratorExit, AnswerError("GeneratorExit: x; it was given")),
        (KeyboardInterrupt, KeyboardInterrupt("x")),
    ],
)
def test_all_that_code_raises_is_its_error_but_ctrl_c(raised, caught):
    def fails(observations):
        raise raised("x")

    with pytest.raises(type(caught), match=str(caught)):
        proposed(ready(as_policy(fails)), np.zeros((2, 1, 6), dtype=np.float32))
