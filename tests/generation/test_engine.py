"""Engines by name, and the arguments that are refused before a run."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import ibdata
from ibdata.errors import MissingError, UsageError
from ibdata.generation.engine import ENGINES, select_engine


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({"engine": "dask"}, "engine: found 'dask', expected one of local, ray"),
        ({"address": "auto"}, "address: found 'auto', which is only for the engine ray"),
        ({"workers": "2"}, "workers: found '2', expected a whole number in [1, 1024]"),
        ({"engine": "ray", "workers": 0}, "workers: found 0, expected a whole number in [1, 1024]"),
    ],
)
@pytest.mark.parametrize("call", [ibdata.generate, lambda c, **o: ibdata.generate_shards(c, "1/2", **o)])
def test_what_cannot_be_meant_is_refused_before_anything_is_made(tmp_path, monkeypatch, call, options, line):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UsageError) as error:
        call("random", **options)
    assert str(error.value) == line
    assert list(Path().iterdir()) == []


def test_without_ray_its_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(
        MissingError, match=r"^the engine ray needs the package ray: pip install ray, or 'ibdata\[ray\]'"
    ):
        select_engine("ray", None, None)


def test_the_command_offers_the_engines_that_there_are():
    from ibdata.cli.generate import command

    (option,) = (parameter for parameter in command.params if parameter.name == "engine")
    assert list(option.type.choices) == list(ENGINES)
