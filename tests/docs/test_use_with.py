"""A bridge runs each snippet of docs/use-with.md, and the extras that the page names exist."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from ibdata.exporters import FORMATS
from ibdata.exporters.rllib import SCHEMA

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "use-with.md").read_text()
SECTIONS = re.split(r"^## (.+)\n", PAGE, flags=re.MULTILINE)[1:]
PROJECT = (ROOT / "pyproject.toml").read_text()
EXTRAS = dict(
    re.findall(
        r"^([\w-]+) = (\[.*\])",
        PROJECT.split("[project.optional-dependencies]")[1].split("\n[")[0],
        flags=re.MULTILINE,
    )
)


@pytest.mark.parametrize(
    "heading", [name for name, text in zip(SECTIONS[::2], SECTIONS[1::2], strict=True) if "```python" in text]
)
def test_a_bridge_runs_the_snippets_under(heading):
    tests = "".join(path.read_text() for path in (ROOT / "tests" / "bridges").rglob("test_*.py"))
    assert f'"{heading}"' in tests


def test_the_page_has_the_schema_that_rllib_needs():
    for key, column in SCHEMA.items():
        assert f'    "{key}": "{column}",\n' in PAGE


def test_every_format_and_extra_on_the_page_exists():
    assert set(re.findall(r"--to (\w+)", PAGE)) == set(FORMATS)
    named = set(re.findall(r"\| `([\w-]+)` \|", PAGE.split("\n## ")[0]))
    assert named
    assert named <= set(EXTRAS)


def test_no_extra_holds_what_cannot_be_installed_together():
    """d3rlpy and RLlib want Gymnasium in two versions."""
    assert "all" not in EXTRAS
    for requirements in EXTRAS.values():
        assert not ("d3rlpy" in requirements and "rllib" in requirements)
        assert "gymnasium==" not in requirements
    assert "pillow" in EXTRAS["minari"]
