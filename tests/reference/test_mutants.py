"""Planted bugs: each is applied to a copy of the dynamics, and must be found on a short tape.

The expected states are those of the unchanged code, which `test_published.py` compares with the published
package. So the comparison could not find a bug that is not found here.
"""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from helpers import ROOT
from reference import tapes

import ibdata.dynamics

pytestmark = pytest.mark.slow

DYNAMICS = Path(ibdata.dynamics.__file__).parent

MUTANTS = {  # name: file, then old and new for each changed text
    "unchanged": ("step.py",),
    "exponential scale": ("variants.py", "eta_mean=0.1,", "eta_mean=0.11,"),
    "probability not bounded": (
        "variants.py", "bernoulli_bounds=(0.001, 0.999)", "bernoulli_bounds=(0.0, 1.0)"),
    "cost noise": ("variants.py", "consumption_noise=0.005,", "consumption_noise=0.0055,"),
    "velocity and gain swapped": (
        "step.py", "action[i, 0]", "action[i, 1]", "action[i, 1]", "action[i, 0]"),
    "effective actions swapped in the noise": (
        "step.py",
        "BERNOULLI_V, i], x[VE", "BERNOULLI_V, i], x[GE", "BERNOULLI_G, i], x[GE", "BERNOULLI_G, i], x[VE"),
    "fatigue amplification": ("fatigue.py", "AMPLIFICATION = 1.1\n", "AMPLIFICATION = 1.12\n"),
    "latent decay": ("fatigue.py", "0.9 * mu", "0.89 * mu"),
    "cost coefficients swapped": ("consumption.py", "4.0 * v + 2.5 * g", "2.5 * v + 4.0 * g"),
    "convolution delayed by one": (
        "step.py", "convolved_cost(costs, i", "convolved_cost(costs[[*range(1, 10), 9]], i"),
    "convolution reversed": ("step.py", "convolved_cost(costs, i", "convolved_cost(costs[::-1], i"),
    "Goldstone sign": ("step.py", "= penalty(int", "= -penalty(int"),
    "Goldstone bias sign": ("miscalibration.py", "+ KAPPA * rho_s * w", "- KAPPA * rho_s * w"),
    "reward of t-1": ("step.py", "return new\n", "return new.replace(reward=state.reward)\n"),
    "latents cross-coupled": (  # as in the authors' code of 2017
        "step.py",
        "update_mu(x[MU_V, i]", "update_mu(x[MU_G, i]", "update_mu(x[MU_G, i]", "update_mu(x[MU_V, i]"),
    "history window reversed": (
        "consumption.py",
        "range(9, 0, -1)", "range(9)", "else history[lag - 1, i]", "else history[lag + 1, i]",
        "        history[0, i] = theta", "        history[9, i] = theta"),
    "consumption and fatigue swapped in the reward": (
        "step.py", "reward(x[C, i], x[F, i])", "reward(x[F, i], x[C, i])"),
    "the old setpoint used": (
        "step.py",
        "    _steer(x, action", "    old = x[P].copy()\n    _steer(x, action",
        "_update_fatigue(x, z, k)\n    _update_consumption(x, z, k)",
        "new, x[P] = x[P].copy(), old\n    _update_fatigue(x, z, k)\n"
        "    _update_consumption(x, z, k)\n    x[P] = new"),
    "setpoint moved twice": ("setpoint.py", "return moved(p, b),", "return moved(moved(p, b), b),"),
    "setpoint turns before moving": ("variants.py", "drift_flip=(0.0, 0.5)", "drift_flip=(0.5, 0.0)"),
    "segment one step longer": ("setpoint.py", "k.flip_after), left - 1", "k.flip_after), left"),
    "shift steps at the gain's rate": ("step.py", "steer(x[H, i], D_H", "steer(x[H, i], D_G"),
    "alpha threshold as printed": ("variants.py", "alpha_threshold=5.0", "alpha_threshold=1.2"),
    "domain not reset after a turn": (
        "miscalibration.py", "return 1, 1, 0", "return delta_hat, psi_next, 0"),
}  # fmt: skip


def mutate(name, folder):
    """A package `ibdata` in `folder` with a copy of the dynamics in which the mutant's text is changed."""
    package = folder / "ibdata"
    for room in ("dynamics", "numerics", "system"):
        shutil.copytree(DYNAMICS.parent / room, package / room, ignore=shutil.ignore_patterns("__pycache__"))
    for file_of_all in ("errors.py", "variables.py"):
        shutil.copy(DYNAMICS.parent / file_of_all, package)
    (package / "__init__.py").touch()
    file, *texts = MUTANTS[name]
    path = package / "dynamics" / file
    text = path.read_text(encoding="utf-8")
    changes = dict(zip(texts[::2], texts[1::2], strict=True))
    assert {old: text.count(old) for old in changes} == dict.fromkeys(changes, 1), name
    for at, old in sorted(((text.index(old), old) for old in changes), reverse=True):
        text = text[:at] + changes[old] + text[at + len(old) :]
    path.write_text(text, encoding="utf-8")
    return folder


def replay(folder, files):
    """The report of `reference/tapes.py` with the package in `folder`, not compiled; errors are raised."""
    path = os.pathsep.join([str(folder), str(ROOT / "tests")])
    env = os.environ | {"PYTHONPATH": path, "PYTHONDONTWRITEBYTECODE": "1"}
    env |= {"NUMBA_DISABLE_JIT": "1", "IBDATA_CACHE_DIR": str(folder)}
    command = [sys.executable, "-m", "reference.tapes", *files]
    child = subprocess.run(command, cwd=folder, env=env, capture_output=True, text=True)
    assert child.returncode == 0, child.stderr
    report = json.loads(child.stdout)
    assert Path(report["file"]).is_relative_to(folder), report["file"]
    return report["worst"]


@pytest.fixture(scope="module")
def worst(tmp_path_factory):
    """A future for each mutant: the largest differences by field, None for one that is not a number."""
    root = tmp_path_factory.mktemp("mutants")
    files = []
    for drifting in (False, True):
        tape = tapes.make((2, 50, 98), drifting, 300, 8)
        files.append(str(root / f"{drifting}.npz"))
        tapes.save(files[-1], tape, tapes.run_ibdata(tape, "siemens"))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        yield {
            name: pool.submit(lambda n, folder: replay(mutate(n, folder), files), name, root / f"mutant{i}")
            for i, name in enumerate(MUTANTS)
        }


def test_an_unchanged_copy_gives_the_compiled_states(worst):
    """Else every mutant would be "caught"."""
    found = worst["unchanged"].result()
    assert {field: x for field, x in found.items() if x is None or x > tapes.TOLERANCE} == {}


@pytest.mark.parametrize("name", [name for name in MUTANTS if name != "unchanged"])
def test_a_planted_bug_is_caught(name, worst):
    """At least one value lies beyond the tolerance of the comparison with the published package."""
    found = worst[name].result()
    assert [field for field, x in found.items() if x is None or x > tapes.TOLERANCE]
