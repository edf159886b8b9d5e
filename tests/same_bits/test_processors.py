"""Processors with and without AVX-512, AVX2 and FMA, as numpy, OpenBLAS and the C library see them."""

from __future__ import annotations

import numpy
import pytest
from helpers.matrix import HAS_AVX512, HAS_FMA, SIZE, Row
from numpy._core import _multiarray_umath as umath

pytestmark = pytest.mark.same_bits

# numpy's names differ between versions and unknown ones are ignored, so they are read, not written down.
DISPATCHED = [name for name in umath.__cpu_dispatch__ if umath.__cpu_features__.get(name)]
BEYOND_AVX2 = [name for name in DISPATCHED if "AVX512" in name or name == "X86_V4"]
# What OpenBLAS reports for what it was told: some names share a kernel.
CORES = {"PRESCOTT": "Katmai", "NEHALEM": "Nehalem", "SANDYBRIDGE": "Sandybridge", "HASWELL": "Haswell"}
CORES |= {"ZEN": "Haswell"} | ({"SKYLAKEX": "SkylakeX"} if HAS_AVX512 else {})
if SIZE != "full":
    CORES = {name: CORES[name] for name in ("PRESCOTT", "HASWELL")}  # the first and the last without AVX-512


def _without(names):
    return {"env": {"NPY_DISABLE_CPU_FEATURES": " ".join(names)}, "spec": {"expect": {"off": names}}}


NUMPY = {"numpy without AVX-512": _without(BEYOND_AVX2), "numpy at its baseline": _without(DISPATCHED)}
CHANGED = {"numpy without AVX-512": "exp", "numpy at its baseline": "tanh"}  # by what the row turns off
BLAS = {
    f"OpenBLAS for {name}": {"env": {"OPENBLAS_CORETYPE": name}, "spec": {"expect": {"blas": core}}}
    for name, core in CORES.items()
}
LIBC = "C library without FMA"
TUNABLES = "glibc.cpu.hwcaps=-FMA,-AVX2"
ROWS = NUMPY | BLAS | {LIBC: {"env": {"GLIBC_TUNABLES": TUNABLES}, "own_code": True}}


def test_the_processors_features_do_not_change_the_data(row, matrix, check):
    check(matrix.result(row), row)


def test_numpy_has_features_to_turn_off():
    assert DISPATCHED, f"numpy {numpy.__version__} has nothing to turn off here: these rows show nothing"
    assert bool(BEYOND_AVX2) == HAS_AVX512, (
        f"of numpy's dispatched features {DISPATCHED}, {BEYOND_AVX2} are beyond AVX2, but the kernel says "
        f"that the processor has {'AVX-512' if HAS_AVX512 else 'no AVX-512'}"
    )


@pytest.mark.parametrize("name", NUMPY)
def test_features_turned_off_change_what_numpy_computes(name, matrix, unmodified):
    """Without this the rows show nothing. Of AVX-512 there is nothing to turn off where it is missing."""
    facts = matrix.result(Row(name, **NUMPY[name]))["facts"]
    assert facts["numpy on"] == [x for x in DISPATCHED if x not in NUMPY[name]["spec"]["expect"]["off"]]
    function = CHANGED[name]
    differs = facts["numpy"][function] != unmodified["facts"]["numpy"][function]
    assert differs == (HAS_AVX512 or function != "exp")


def test_a_recipe_for_another_numpy_is_found_out(matrix):
    """The names of numpy 1.26 turn nothing off in numpy 2.4."""
    names = ["SSSE3", "AVX512F_OF_ANOTHER_NUMPY"]
    child = matrix.child(Row("numpy recipe", **_without(names)))
    assert child.returncode == 1
    assert "AVX512F_OF_ANOTHER_NUMPY" in child.stderr
    assert child.stdout == ""


def test_a_feature_that_stays_on_is_found_out(matrix):
    row = Row("numpy unchanged", spec={"expect": {"off": DISPATCHED}})
    child = matrix.child(row)
    assert child.returncode == 1
    assert f"{DISPATCHED[0]}: found True, expected False" in child.stderr


def test_the_c_library_without_fma_computes_another_exp(matrix, unmodified):
    """Without this the row shows nothing."""
    found = matrix.result(Row(LIBC, **ROWS[LIBC]))["facts"]["libc exp"]
    differs = found != unmodified["facts"]["libc exp"]
    assert differs == HAS_FMA, (
        f"GLIBC_TUNABLES={TUNABLES}: math.exp {'differs' if differs else 'is the same'}, but the kernel says "
        f"that the processor has {'FMA' if HAS_FMA else 'no FMA'}"
    )
