"""The package has exactly these public names."""

from __future__ import annotations

import subprocess
import sys

import pytest

import ibdata
from ibdata import dynamics


def test_the_names_of_ibdata():
    assert ibdata.__all__ == [
        "Dataset",
        "Experiment",
        "IbdataError",
        "__version__",
        "baselines",
        "compile_all",
        "difference",
        "estimate",
        "evaluate",
        "export",
        "finalize",
        "generate",
        "importance",
        "load",
        "merge",
        "noise_floor",
        "open",
        "quality",
        "repair",
        "reproduce",
        "save_network",
        "split",
        "state_at",
        "true_values",
        "validate",
    ]
    assert all(hasattr(ibdata, name) for name in ibdata.__all__)
    assert ibdata.open is ibdata.Dataset


def test_the_names_of_the_dynamics():
    assert dynamics.__all__ == [
        "PAPER",
        "SIEMENS",
        "VARIANTS",
        "Noise",
        "State",
        "Variant",
        "initial_state",
        "step",
    ]


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="module 'ibdata' has no attribute 'nonsense'"):
        ibdata.nonsense  # noqa: B018 - the access is the test


def test_importing_ibdata_imports_nothing_heavy():
    code = (
        "import sys, ibdata; print([m for m in ('numpy', 'numba', 'pandas', 'pyarrow') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
