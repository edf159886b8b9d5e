"""Content roots under other options of numba, and without compiling."""

from __future__ import annotations

import pytest
from helpers.matrix import HAS_FMA, SIZE, Row

pytestmark = pytest.mark.same_bits

INTERPRETED = "numba off"


def _target(cpu=None, features=None):
    env = ({"NUMBA_CPU_NAME": cpu} if cpu else {}) | ({"NUMBA_CPU_FEATURES": features} if features else {})
    expect = {"CPU_NAME": cpu, "CPU_FEATURES": features, "fuses": HAS_FMA and features == "-avx512f"}
    return {"env": env, "spec": {"expect": expect}, "own_code": True}


ROWS = {
    "numba for a generic processor": _target("generic", ""),
    INTERPRETED: {
        "env": {"NUMBA_DISABLE_JIT": "1"},
        "spec": {"size": "tiny", "expect": {"DISABLE_JIT": 1}},
        "own_code": True,
    },
    "numba on, tiny": {"spec": {"size": "tiny", "expect": {"DISABLE_JIT": 0}}},
}
if SIZE == "full":  # a generic processor has none of these features
    ROWS["numba without AVX-512"] = _target(features="-avx512f")
    ROWS["numba without FMA"] = _target(features="-fma")
    ROWS["numba without AVX2 and FMA"] = _target(features="-avx2,-fma")
    ROWS["numba without optimization"] = {
        "env": {"NUMBA_OPT": "0"},
        "spec": {"expect": {"OPT": 0}},
        "own_code": True,
    }
    ROWS["numba with SLP vectorization"] = {
        "env": {"NUMBA_SLP_VECTORIZE": "1"},
        "spec": {"expect": {"SLP_VECTORIZE": 1}},
        "own_code": True,
    }


def test_the_compilers_settings_do_not_change_the_data(row, matrix, check):
    check(matrix.result(row), row)


def test_the_interpreted_run_writes_the_same_files(matrix):
    results = [matrix.result(Row(name, **ROWS[name]))["results"] for name in (INTERPRETED, "numba on, tiny")]
    assert results[0] == results[1]


def test_the_compiler_fuses_multiply_and_add_where_it_may(unmodified):
    """Without this the rows without FMA show nothing."""
    assert unmodified["facts"]["fuses"] == HAS_FMA


def test_machine_code_for_one_processor_is_not_run_on_another(matrix, tmp_path):
    """They share a folder; numba names what it keeps there by processor and features."""

    def kept():
        return {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.nbc")}

    def run(name, **env):
        child = matrix.child(Row(name, env=env, spec={"size": "tiny"}), code=tmp_path)
        assert child.returncode == 0, child.stderr
        return kept()

    host = run("cache host")
    generic = run("cache generic", NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="")
    assert len(generic) == 2 * len(host) > 0
    assert {path: generic[path] for path in host} == host
    assert run("cache host again") == generic
