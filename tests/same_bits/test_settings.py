"""Content roots on other processors, as numpy, OpenBLAS, numba and the C library see them, and uncompiled."""

import pytest
from numpy._core import _multiarray_umath as umath
from same_bits.matrix import HAS_AVX512, HAS_FMA, SIZE, Row

pytestmark = pytest.mark.same_bits

# numpy's names differ between versions and unknown ones are ignored, so they are read, not written down.
DISPATCHED = [name for name in umath.__cpu_dispatch__ if umath.__cpu_features__.get(name)]
BEYOND_AVX2 = [name for name in DISPATCHED if "AVX512" in name or name == "X86_V4"]


def _row(name, env, own_code=False, size=None, **expect):
    return Row(name, env=env, own_code=own_code, spec={"expect": expect} | ({"size": size} if size else {}))


def _numpy(name, off):
    return _row(f"numpy {name}", {"NPY_DISABLE_CPU_FEATURES": " ".join(off)}, off=off)


def _blas(name, core):
    return _row(f"OpenBLAS for {name}", {"OPENBLAS_CORETYPE": name}, blas=core)


def _numba(name, cpu=None, features=None, fuses=False):
    env = {"NUMBA_CPU_NAME": cpu, "NUMBA_CPU_FEATURES": features}
    given = {key: value for key, value in env.items() if value is not None}
    return _row(f"numba {name}", given, own_code=True, CPU_NAME=cpu, CPU_FEATURES=features, fuses=fuses)


WITHOUT_AVX512, BASELINE = _numpy("without AVX-512", BEYOND_AVX2), _numpy("at its baseline", DISPATCHED)
LIBC = _row("C library without FMA", {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-FMA,-AVX2"}, own_code=True)
INTERPRETED = _row("numba off", {"NUMBA_DISABLE_JIT": "1"}, own_code=True, size="tiny", DISABLE_JIT=1)
COMPILED = _row("numba on, tiny", {}, size="tiny", DISABLE_JIT=0)
ROWS = [
    WITHOUT_AVX512,
    BASELINE,
    LIBC,
    INTERPRETED,
    COMPILED,
    _blas("PRESCOTT", "Katmai"),  # what OpenBLAS reports: some names share a kernel
    _blas("HASWELL", "Haswell"),
    _numba("for a generic processor", "generic", ""),
]
if SIZE == "full":
    ROWS += [
        _blas("SANDYBRIDGE", "Sandybridge"),
        _numba("without AVX-512", features="-avx512f", fuses=HAS_FMA),
        _numba("without FMA", features="-fma"),
        _numba("without AVX2 and FMA", features="-avx2,-fma"),
    ]
    ROWS += [_blas("SKYLAKEX", "SkylakeX")] if HAS_AVX512 else []


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.name)
def test_a_setting_does_not_change_the_data(row, matrix, check):
    check(matrix.result(row), row)


def test_the_interpreted_run_writes_the_same_files(matrix):
    assert matrix.result(INTERPRETED)["results"] == matrix.result(COMPILED)["results"]


# Without the following, the rows might show nothing.


@pytest.mark.parametrize(
    ("row", "function"), [(WITHOUT_AVX512, "exp"), (BASELINE, "tanh")], ids=["exp", "tanh"]
)
def test_features_turned_off_change_what_numpy_computes(row, function, matrix, unmodified):
    """Of AVX-512 there is nothing to turn off where it is missing."""
    facts = matrix.result(row)["facts"]
    assert facts["numpy on"] == [x for x in DISPATCHED if x not in row.spec["expect"]["off"]]
    differs = facts["numpy"][function] != unmodified["facts"]["numpy"][function]
    assert differs == (HAS_AVX512 or function != "exp")


def test_the_c_library_without_fma_computes_another_exp(matrix, unmodified):
    found = matrix.result(LIBC)["facts"]["libc exp"]
    assert (found != unmodified["facts"]["libc exp"]) == HAS_FMA


def test_a_setting_that_is_not_in_force_is_found_out(matrix):
    child = matrix.child(_row("numpy unchanged", {}, off=DISPATCHED))
    assert child.returncode == 1
    assert f"{DISPATCHED[0]}: found True, expected False" in child.stderr
