"""Fixtures that load experiments from text and list their problems, and the schema."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from ibdata.errors import ConfigError
from ibdata.experiment import Experiment, load

LEAST = ("name: x", "setpoints: 70", "policies: [{kind: random}]")


@pytest.fixture(scope="session")
def with_lines() -> Callable[..., str]:
    """A file that begins with these lines and holds whatever else it must."""

    def of(*lines: str) -> str:
        given = {line.split(":")[0] for line in lines}
        return "\n".join([*lines, *(line for line in LEAST if line.split(":")[0] not in given), ""])

    return of


@pytest.fixture(scope="session")
def schema() -> Any:
    """The JSON Schema of experiments, as a validator."""
    schema = Experiment.model_json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.fixture
def loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Experiment]:
    """The experiment of a text, loaded as the file x.yaml of the current folder."""

    def of(text: str | bytes, overrides: Sequence[str] = (), seed: int | None = None) -> Experiment:
        monkeypatch.chdir(tmp_path)
        Path("x.yaml").write_bytes(text if isinstance(text, bytes) else text.encode())
        return load("x.yaml", overrides, seed)

    return of


@pytest.fixture
def problems(loaded: Callable[..., Experiment]) -> Callable[..., list[str]]:
    """The lines of the ConfigError of a text."""

    def of(text: str | bytes, overrides: Sequence[str] = (), seed: int | None = None) -> list[str]:
        with pytest.raises(ConfigError) as caught:
            loaded(text, overrides, seed)
        assert str(caught.value).splitlines() == list(caught.value.problems)
        return list(caught.value.problems)

    return of
