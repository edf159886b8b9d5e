"""The known answer detects a machine that computes other bits, and the golden roots a package that does."""

import os
import platform
import shutil
import subprocess
import sys

import pytest
from same_bits.matrix import PACKAGE, Row

pytestmark = pytest.mark.same_bits

# Where the floating-point environment of glibc holds the bits that switch denormal numbers off: the word, and
# the bits for results (FTZ) and for operands (DAZ); one bit does both on ARM.
SWITCHES = {"x86_64": (7, {"results": 1 << 15, "operands": 1 << 6}), "aarch64": (0, {"both": 1 << 24})}
WORD, BITS = SWITCHES.get(platform.machine(), (0, {}))
FLUSHING = """
import ctypes, ctypes.util, sys, tempfile
import ibdata
from ibdata.generation import record
assert record.known_answer() == record.KNOWN_ANSWER
before = record.digest(record.MOVING)
libm = ctypes.CDLL(ctypes.util.find_library("m"))
environment = (ctypes.c_uint32 * 8)()
libm.fegetenv(environment)
environment[int(sys.argv[1])] |= int(sys.argv[2])
libm.fesetenv(environment)
right = record.known_answer() == record.KNOWN_ANSWER
print(right, record.digest(record.MOVING) == before)
with tempfile.TemporaryDirectory() as folder:
    print(ibdata.generate("random", folder, overrides=["steps=2"], workers=1).manifest["reproducible"])
"""

FORCED = {"spec": {"size": "tiny", "known_answer": "0" * 64}}
COMPILE = 'numba.njit(nogil=True, error_model="numpy", **options)'
FUSED = "numba.njit(fastmath={'contract'}, **options)"
# What another machine might do, as a change of the package: file, old text, new text.
CHANGES = {
    "fused multiply-add": ("_numerics/compiled.py", COMPILE, FUSED),
    "exp of the C library": (
        "_numerics/exact.py",
        "    k = np.rint(x",
        "    return math.exp(x)\n    k = np.rint(x",
    ),
}


@pytest.fixture(scope="module")
def changed(matrix, tmp_path_factory):
    """What children print of copies of the package with one change each."""
    rows = {}
    for name, (file, old, new) in CHANGES.items():
        copy = tmp_path_factory.mktemp("changed")
        shutil.copytree(PACKAGE / "ibdata", copy / "ibdata", ignore=shutil.ignore_patterns("__pycache__"))
        shutil.copytree(PACKAGE / "configs", copy / "configs")
        path = copy / "ibdata" / file
        text = path.read_text()
        assert text.count(old) == 1, (file, old)
        path.write_text(text.replace(old, new))
        rows[name] = Row(f"package with {name}", spec={"size": "small"}, own_code=True, package=copy)
    matrix.start(rows.values())
    return {name: matrix.result(row) for name, row in rows.items()}


def test_a_machine_with_another_answer_says_so(matrix, unmodified, golden):
    assert "other bits" not in unmodified["stderr"]
    result = matrix.result(Row("known answer forced to differ", **FORCED))
    assert {made["reproducible"] for made in result["results"].values()} == {False}
    assert {name: made["root"] for name, made in result["results"].items()} == golden["roots"]["tiny"]
    line = "ibdata: this machine computes other bits than expected; the manifest says reproducible: false\n"
    assert result["stderr"].count(line) == len(result["results"])


@pytest.mark.parametrize("name", CHANGES)
def test_the_golden_roots_and_the_known_answer_would_show(name, changed, golden):
    """Every dataset in float64 shows it; in float32 a difference may be rounded away."""
    results = changed[name]["results"]
    for experiment in ("moving", "printed", "printed-moving"):
        assert results[experiment]["root"] != golden["roots"]["small"][experiment]
    assert {made["reproducible"] for made in results.values()} == {False}


@pytest.mark.parametrize("bits", BITS.values(), ids=BITS)
def test_denormal_numbers_that_are_switched_off_show(bits):
    """They change no bit of the known runs, but might of another."""
    child = subprocess.run(
        [sys.executable, "-c", FLUSHING, str(WORD), str(bits)],
        env={**os.environ, "PYTHONPATH": str(PACKAGE)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert child.stdout.split() == ["False", "True", "False"]
    assert child.stderr.count("computes other bits than expected") == 1
