"""The code of the guides runs, in order, and prints what they show."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", flags=re.MULTILINE | re.DOTALL)
# A page that the tests of a bridge name needs the bridge's library; it is run there.
BRIDGES = [*(ROOT / "tests/bridges").rglob("*.py"), ROOT / "tests/helpers/use_with.py"]
BRIDGED = "".join(path.read_text(encoding="utf-8") for path in BRIDGES)
GUIDES = [
    path.name
    for path in sorted(DOCS.glob("*.md"))
    if {"python", "sh"} & {language for language, _ in BLOCK.findall(path.read_text(encoding="utf-8"))}
    and path.name not in BRIDGED
]


@pytest.mark.parametrize("guide", GUIDES)
def test_the_code_of_a_guide_prints_what_it_says(guide, tmp_path):
    done = subprocess.run(
        [sys.executable, str(ROOT / "scripts/guide"), str(DOCS / guide)],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    blocks = BLOCK.findall((DOCS / guide).read_text(encoding="utf-8"))
    assert done.stdout == "".join(text for language, text in blocks if language == "text")


def test_policies_of_ones_own_work_as_the_page_says(tmp_path):
    """The rest of custom-policies.md needs torch and SB3; a bridge runs all of it."""
    text = (DOCS / "custom-policies.md").read_text(encoding="utf-8").partition("## A torch module")[0]
    (tmp_path / "page.md").write_text(text, encoding="utf-8")
    command = [sys.executable, str(ROOT / "scripts/guide"), "page.md"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "".join(shown for language, shown in BLOCK.findall(text) if language == "text")


def test_several_hosts_make_a_dataset_as_the_page_says(tmp_path):
    """The rest of scale.md needs Ray or an object store; bridges run it."""
    text = (DOCS / "scale.md").read_text(encoding="utf-8")
    (tmp_path / "page.md").write_text(text[text.index("## Several hosts") : text.index("## Ray")])
    command = [sys.executable, str(ROOT / "scripts/guide"), "page.md"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert list((tmp_path / "data/array").glob("data/*.parquet"))


def test_the_guides_are_found():
    assert {"index.md", "experiments.md", "off-policy-evaluation.md", "splits.md"} <= set(GUIDES)
    assert "use-with.md" not in GUIDES


@pytest.mark.parametrize("page", sorted(DOCS.glob("*.md")), ids=lambda path: path.name)
def test_links_and_pictures_lead_somewhere(page):
    prose = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    for target in re.findall(r"\]\(([^)#\s]+)", prose):
        if "://" not in target:
            assert (DOCS / target).exists(), target


def test_a_failing_command_or_snippet_ends_a_guide(tmp_path):
    for language, code in (("sh", "false\ntrue"), ("python", "raise SystemExit(3)")):
        (tmp_path / "page.md").write_text(f"```{language}\n{code}\n```\n\n```python\nprint('later')\n```\n")
        done = subprocess.run(
            [sys.executable, str(ROOT / "scripts/guide"), "page.md"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
        )
        assert done.returncode != 0
        assert done.stdout == ""
