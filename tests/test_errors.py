"""Errors come back from worker processes unchanged."""

from __future__ import annotations

import pickle

import pytest

from ibdata.errors import ConfigError, Interrupted, MissingError


@pytest.mark.parametrize(
    "error", [ConfigError(["a: b", "c: d"]), Interrupted(15), MissingError("this", "that", "extra")], ids=repr
)
def test_an_error_survives_the_way_between_processes(error):
    again = pickle.loads(pickle.dumps(error))
    assert (type(again), str(again), again.exit_code) == (type(error), str(error), error.exit_code)


def test_a_missing_library_is_an_import_error_too():
    assert issubclass(MissingError, ImportError)
