"""The guides are true: their code runs, in order, and prints what they say."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[1] / "docs"
BRIDGED = "use-with.md"  # each of its snippets runs where its library is, see tests/test_use_with.py
GUIDES = [
    path.name
    for path in sorted(DOCS.glob("*.md"))
    if "```python" in path.read_text(encoding="utf-8") and path.name != BRIDGED
]


@pytest.mark.parametrize("guide", GUIDES)
def test_the_code_of_a_guide_prints_what_it_says(guide, tmp_path):
    blocks = re.findall(
        r"^```(\w+)\n(.*?)^```$", (DOCS / guide).read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL
    )
    (tmp_path / "guide.py").write_text("".join(text for language, text in blocks if language == "python"))
    done = subprocess.run([sys.executable, "guide.py"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "".join(text for language, text in blocks if language == "text")


def test_the_guides_are_found():
    assert "off-policy-evaluation.md" in GUIDES
