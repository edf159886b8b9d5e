"""The snippets of docs/environment.md run."""

from __future__ import annotations

import subprocess
import sys

import pytest
from helpers import ROOT
from helpers.pages import blocks

PAGE = (ROOT / "docs/environment.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("block", [x for x in blocks(PAGE, "python") if "\nimport gymnasium\n" in f"\n{x}"])
def test_a_snippet_with_gymnasium_runs(tmp_path, block):
    subprocess.run([sys.executable, "-W", "error", "-c", block], cwd=tmp_path, check=True)
