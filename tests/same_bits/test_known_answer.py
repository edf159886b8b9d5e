"""The known answer tells a machine with other bits, and the golden roots tell a package with other bits."""

from __future__ import annotations

import os
import shutil

import pytest

pytestmark = pytest.mark.same_bits

FORCED = {"spec": {"size": "tiny", "known_answer": "0" * 64}}
COMPILE = 'numba.njit(cache=True, nogil=True, error_model="numpy")'
# What another machine might do, as a change of the package: file, old text, new text.
CHANGES = {
    "fused multiply-add": ("compiling.py", COMPILE, "numba.njit(cache=True, fastmath={'contract'})"),
    "fastmath": ("compiling.py", COMPILE, "numba.njit(cache=True, fastmath=True)"),
    "exp of the C library": (
        "dynamics/exact.py",
        "    k = np.rint(x",
        "    return math.exp(x)\n    k = np.rint(x",
    ),
    "log of the C library": ("dynamics/exact.py", "    bits = ", "    return math.log(x)\n    bits = "),
}
if os.environ.get("IBDATA_SAME_BITS") != "full":
    CHANGES = {name: CHANGES[name] for name in ("fused multiply-add", "exp of the C library")}


@pytest.fixture(scope="module")
def changed(matrix, new_row, tmp_path_factory):
    """What children print of copies of the package with one change each."""
    rows = {}
    for name, (file, old, new) in CHANGES.items():
        copy = tmp_path_factory.mktemp("changed")
        shutil.copytree(
            new_row("").package / "ibdata", copy / "ibdata", ignore=shutil.ignore_patterns("__pycache__")
        )
        shutil.copytree(new_row("").package / "configs", copy / "configs")
        path = copy / "ibdata" / file
        text = path.read_text()
        assert text.count(old) == 1, (file, old)
        path.write_text(text.replace(old, new))
        rows[name] = new_row(f"package with {name}", spec={"size": "small"}, own_code=True, package=copy)
    matrix.start(rows.values())
    return {name: matrix.result(row) for name, row in rows.items()}


def test_a_machine_with_another_answer_says_so_and_its_manifest_too(matrix, new_row, golden):
    result = matrix.result(new_row("known answer forced to differ", **FORCED))
    assert {made["reproducible"] for made in result["results"].values()} == {False}
    assert {name: made["root"] for name, made in result["results"].items()} == golden["roots"]["tiny"]
    line = "ibdata: this machine computes other bits than others; the manifest says reproducible: false\n"
    assert result["stderr"].count(line) == len(result["results"])


def test_a_machine_with_the_known_answer_says_nothing(unmodified):
    assert "other bits" not in unmodified["stderr"]


@pytest.mark.parametrize("name", CHANGES)
def test_the_golden_roots_would_show(name, changed, golden):
    """Every dataset in float64 shows it; in float32 a difference may be rounded away."""
    for experiment in ("moving", "printed", "printed-moving"):
        assert changed[name]["results"][experiment]["root"] != golden["roots"]["small"][experiment]


@pytest.mark.parametrize("name", CHANGES)
def test_the_known_answer_would_show(name, changed):
    """Else a machine with other bits writes `reproducible: true`."""
    assert {made["reproducible"] for made in changed[name]["results"].values()} == {False}
