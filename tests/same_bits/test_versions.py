"""The oldest library versions that pyproject.toml allows, and the pinned newest ones."""

import os
import re
import subprocess
import sys

import pytest
from helpers import PACKAGE, ROOT
from same_bits.matrix import UNMODIFIED, Row

pytestmark = pytest.mark.same_bits

DEPENDENCIES = re.search(r"^dependencies = \[(.*?)^\]", (ROOT / "pyproject.toml").read_text(), re.M | re.S)[1]
LOWEST = {name: low for name, low in re.findall(r'"([\w.-]+)>=([\d.]+)"', DEPENDENCIES)}
PINNED = dict(re.findall(r"^([\w.-]+)==(\S+)", (ROOT / "constraints.txt").read_text(), re.M))
REPORTED = ("numpy", "numba", "pyarrow")


@pytest.fixture(scope="module")
def lowest(matrix, tmp_path_factory):
    """A row with a Python that has every dependency in the lowest version allowed."""
    folder = tmp_path_factory.mktemp("lowest")
    python = folder / "bin" / "python"
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True, timeout=120)
    pip = subprocess.run(
        [python, "-m", "pip", "install", "--quiet", "--only-binary=:all:"]
        + [f"{name}=={low}" for name, low in LOWEST.items()],
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert pip.returncode == 0, f"the lower bounds {LOWEST} do not install together: {pip.stderr}"
    return Row("lowest versions", python=str(python), own_code=True)


def test_the_pinned_versions_run_here_and_made_the_golden_files(unmodified, golden):
    assert {name: unmodified["versions"][name] for name in REPORTED} == {
        name: PINNED[name] for name in REPORTED
    }
    assert golden["pyarrow"] == PINNED["pyarrow"]
    assert len(LOWEST) == DEPENDENCIES.count(",") >= 8


def test_the_lowest_versions_make_the_same_data(matrix, lowest, check):
    result = matrix.result(lowest)
    for name in REPORTED:
        assert f"{result['versions'][name]}.".startswith(f"{LOWEST[name]}."), (name, result["versions"])
    check(result, lowest)


def test_lowest_and_pinned_versions_validate_each_other(matrix, lowest, unmodified):
    names = matrix.result(lowest)["results"]
    for maker, python in ((UNMODIFIED, lowest.python), (lowest, sys.executable)):
        for name in names:
            out = matrix.place(maker) / name
            command = [python, "-m", "ibdata", "validate", "--quiet", str(out)]
            env = {**os.environ, "PYTHONPATH": str(PACKAGE)}
            done = subprocess.run(command, env=env, capture_output=True, text=True, check=False)
            assert (done.returncode, done.stdout) == (0, f"{out}: valid\n"), (maker.name, done)
