"""All of docs/custom-policies.md prints what it shows, with torch and a recurrent policy of SB3."""

from __future__ import annotations

import re
import subprocess
import sys

from helpers import ROOT

PAGE = ROOT / "docs/custom-policies.md"


def test_the_page_prints_what_it_says(tmp_path):
    command = [sys.executable, str(ROOT / "scripts/guide"), str(PAGE)]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    shown = re.findall(r"^```text\n(.*?)^```$", PAGE.read_text(), flags=re.MULTILINE | re.DOTALL)
    assert done.stdout == "".join(shown)
