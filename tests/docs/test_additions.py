"""What is added in one place is known everywhere else: *Add something* in CONTRIBUTING.md."""

from __future__ import annotations

import inspect
import re

import numpy as np
import pytest
from helpers import ROOT
from helpers.policies import BLOCKS
from helpers.views import VIEWS

import ibdata
from ibdata.cli import MODULES
from ibdata.cli.use import VIEW
from ibdata.dataset.models import Info
from ibdata.dataset.transitions import BESIDE
from ibdata.experiment.fields import Output
from ibdata.generation import metadata
from ibdata.generation.workers import ENGINES
from ibdata.plan import rollout
from ibdata.plan.dataset_spec import DatasetSpec
from ibdata.policies import POLICIES
from ibdata.tools.split_schemes import SCHEMES
from ibdata.views.options import PLAIN, view_options

PAGES = {path.name: path.read_text(encoding="utf-8") for path in (ROOT / "docs").glob("*.md")}
CHANGED = {  # an option of a view each, with another value than the default
    "observe": "markov",
    "actions": True,
    "reward": "delta",
    "reward_scale": 0.5,
    "imperfections": {"delay": {"obs_gain": 1}},
    "cost": "runaway",
}
KNOWN = (  # roles of columns that are no array beside the transitions
    *("index", "observation", "action", "reward", "flag", "next_observation", "latent", "next_latent"),
    *("policy", "log_prob"),
)


def info_of(**output: object) -> Info:
    plain = {"name": "x", "setpoints": 70, "policies": ["random"], "output": output}
    return metadata.info(DatasetSpec.of(ibdata.Experiment.model_validate(plain)))


def test_every_command_is_in_the_list():
    files = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "ibdata/cli").glob("*.py"))
    assert set(re.findall(r"^def (\w+)_command\(", files, re.MULTILINE)) == set(MODULES)


def test_every_kind_of_policy_is_among_the_blocks_that_are_tested():
    assert {block["kind"] for block in BLOCKS} == set(POLICIES) - {"live"}


def test_every_scheme_of_splits_is_on_the_python_page():
    assert [x for x in SCHEMES.values() if f"::: {x.__module__}.{x.__name__}\n" not in PAGES["api.md"]] == []
    assert [word for word in SCHEMES if f"\n| `{word}` |" not in PAGES["datasets.md"]] == []


def test_every_engine_is_on_the_page():
    assert [x for x in ENGINES if x != "local" and f"--engine {x}" not in PAGES["scale.md"]] == []


@pytest.mark.parametrize("option", inspect.signature(view_options).parameters)
def test_an_option_of_a_view_is_on_its_page_in_exports_and_on_the_command_line(option):
    assert f"\n| `{option}` |" in PAGES["views.md"]
    assert view_options(**{option: CHANGED[option]}).plain(False) != PLAIN.plain(False)
    assert option in VIEW


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    """A dataset with what every view needs."""
    output = {"latent": "next"}
    plain = {"name": "x", "setpoints": 70, "policies": ["random"], "steps": 20, "output": output}
    return ibdata.generate(plain, tmp_path_factory.mktemp("rows") / "x")


@pytest.mark.parametrize("option", inspect.signature(view_options).parameters)
def test_an_option_of_a_view_has_an_effect_which_the_environment_shows_too(rows, option):
    plain, changed = rows.arrays(), rows.arrays(view={option: CHANGED[option]})
    assert changed.keys() != plain.keys() or any(
        not np.array_equal(changed[name], plain[name]) for name in ("observations", "rewards")
    )
    assert any(option in view for view in VIEWS)  # which are replayed


@pytest.mark.parametrize("latent", [True, "full", "next"])
@pytest.mark.parametrize("setpoints", [70, "drifting"])
def test_every_column_has_values(latent, setpoints, monkeypatch):
    """What nobody writes stays NaN here, and would be anything otherwise."""
    empty = rollout.TableBuffer.table

    def nowhere(self, shape, dtype):
        table = empty(self, shape, dtype)
        table[:] = np.nan
        return table

    monkeypatch.setattr(rollout.TableBuffer, "table", nowhere)
    options = {name: True for name, field in Output.model_fields.items() if field.annotation is bool}
    plain = {"name": "x", "setpoints": setpoints, "policies": ["random"], "steps": 7}
    experiment = ibdata.Experiment.model_validate(plain | {"output": {"latent": latent, **options}})
    made = rollout.rollout(experiment, 0, 1)
    assert [name for name, row in zip(made.names, made.table, strict=True) if np.isnan(row).any()] == []


@pytest.mark.parametrize(
    "option", [x for x, field in Output.model_fields.items() if field.annotation is bool]
)
def test_a_column_that_an_option_adds_is_on_the_page_and_in_arrays(option):
    """Readers, windows, views and exports have what `BESIDE` has."""
    more = info_of(**{option: True})
    added = [column for column in more.columns if column not in info_of().columns]
    assert [column.name for column in added if f"| `{column.name}` |" not in PAGES["dataset-format.md"]] == []
    beside = {name for kind in BESIDE.values() for name in kind.needs(more, PLAIN)}
    assert {column.name for column in added if column.role not in KNOWN} <= beside
    assert added
