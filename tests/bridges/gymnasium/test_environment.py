"""One environment: Gymnasium's own checks, how it is found, its seeds, refusals, pictures and snippets."""

import re
import subprocess
import sys

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from helpers import ROOT
from helpers.pages import blocks

from ibdata.dynamics import PAPER
from ibdata.environment import IndustrialBenchmarkEnv
from ibdata.errors import ConfigError, UsageError

ID = "ibdata/IndustrialBenchmark-v0"
SETTINGS = (
    {},
    {"setpoint": "drifting", "start": {"burn_in": [0, 9]}, "history": 3},
    {"dynamics": {"base": "paper", "eta_mean": 0.1}, "start": "uniform", "view": {"reward_scale": 0.01}},
    {"dynamics": PAPER, "setpoint": {"drifting": 99}, "discrete_actions": True},
    {"setpoint": 70, "render_mode": "rgb_array"},
)


@pytest.mark.parametrize(
    ("imported", "name"),
    [
        ("gymnasium", f"ibdata.environment:{ID}"),
        ("gymnasium", f"ibdata:{ID}"),
        ("gymnasium, ibdata", ID),
        ("ibdata.environment, gymnasium", ID),
    ],
)
def test_gymnasium_makes_it_after_any_import(imported, name):
    code = f"import {imported}; print(gymnasium.make({name!r}, setpoint=70).reset(seed=0)[0][0])"
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True)
    assert (done.stdout, done.stderr) == ("70.0\n", "")


@pytest.mark.parametrize("given", SETTINGS)
def test_gymnasium_s_checker_passes_without_a_warning(given):
    """Spaces, types, seeds. Warnings are errors in this suite."""
    env = gymnasium.make(ID, **given).unwrapped
    check_env(env, skip_render_check="render_mode" not in given)
    started = [env.reset()[0].tolist() for _ in range(2)]
    assert started[0] != started[1]  # without a seed, the generator goes on


def test_the_first_episode_of_seed_0_stays_as_it_is():
    """PCG64's integers are promised stable and the rest is exact: the same on any machine and version.

    Made by these lines, with gymnasium 1.4.0 and numpy 2.4.6.
    """
    env = gymnasium.make(ID, setpoint=70)
    seen, _ = env.reset(seed=0)
    assert seen.tolist() == [70.0, 50.0, 50.0, 50.0, 33.015926361083984, 118.99102020263672]
    rewards = [env.step(np.array([1, -1, 0.5], dtype=np.float32))[1] for _ in range(20)]
    assert rewards[-1] == float.fromhex("-0x1.b60903b4b479ap+7")


def begun():
    env = IndustrialBenchmarkEnv()
    env.reset(seed=0)
    return env


REFUSED = {
    "a setpoint": (lambda: gymnasium.make(ID, setpoint=170), ConfigError, "setpoint: found 170, expected"),
    "a name": (
        lambda: gymnasium.make(ID, setpoints=70),
        TypeError,  # of which TorchRL's GymEnv(ID) looks for Python's words
        "setpoints: got an unexpected keyword argument 'setpoints'; did you mean 'setpoint'",
    ),
    "another type": (lambda: gymnasium.make(ID, history="2"), TypeError, "history: found '2', expected a"),
    "a negative seed": (lambda: begun().reset(seed=-1), UsageError, "seed: found -1, expected a whole num"),
    "a seed of text": (lambda: begun().reset(seed="1"), UsageError, "seed: found '1', expected a whole num"),
    "an action": (lambda: begun().step([0, 0]), UsageError, "action: found .*, expected three finite"),
    "a step too early": (
        lambda: IndustrialBenchmarkEnv().step(np.zeros(3)),
        gymnasium.error.ResetNeeded,
        "step: found no episode",
    ),
}


@pytest.mark.parametrize(("call", "kind", "message"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_meant_is_refused_in_one_line(call, kind, message):
    with pytest.raises(kind, match=f"^{message}"):
        call()


PAGES = "\n".join((ROOT / page).read_text(encoding="utf-8") for page in ("docs/environment.md", "README.md"))
SHOWN = dict(re.findall(r"^```python\n(.*?)^```\n\n```text\n(.*?)^```$", PAGES, re.MULTILINE | re.DOTALL))
CODE = [x for x in blocks(PAGES, "python") if "\nimport gymnasium\n" in f"\n{x}" or ".make(" in x]


@pytest.mark.parametrize("block", CODE)
def test_a_snippet_with_gymnasium_runs_and_prints_what_the_page_shows(tmp_path, block):
    command = [sys.executable, "-W", "error", "-c", block]
    done = subprocess.run(command, cwd=tmp_path, check=True, stdout=subprocess.PIPE, text=True)
    assert done.stdout == SHOWN.get(block, done.stdout)


def test_a_page_shows_which_steps_are_transitions():
    assert any("transitions" in printed for printed in SHOWN.values())
