"""The snippets of docs/environment.md run."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).parents[3] / "docs/environment.md"


def test_every_snippet_with_gymnasium_runs(tmp_path):
    blocks = re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)
    found = [block for block in blocks if re.search(r"^import gymnasium$", block, flags=re.MULTILINE)]
    assert found
    for block in found:
        subprocess.run([sys.executable, "-W", "error", "-c", block], cwd=tmp_path, check=True)
