"""The code of the documentation, run as a reader would."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from helpers import ROOT


def blocks(text: str, language: str) -> list[str]:
    """The code of a page in one language, a text each."""
    return re.findall(rf"^```{language}\n(.*?)^```$", text, flags=re.MULTILINE | re.DOTALL)


def check_guide(text: str, folder: Path) -> None:
    """Run the code of a page in a folder; it must print what the page shows."""
    (folder / "page.md").write_text(text, encoding="utf-8")
    command = [sys.executable, str(ROOT / "scripts/guide"), "page.md"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == "".join(blocks(text, "text"))
