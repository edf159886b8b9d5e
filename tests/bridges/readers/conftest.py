"""The snippets of docs/use-with.md."""

from __future__ import annotations

from pathlib import Path
from runpy import run_path

_page = run_path(str(Path(__file__).parents[2] / "use_with.py"))
generated, use_with = _page["generated"], _page["use_with"]
