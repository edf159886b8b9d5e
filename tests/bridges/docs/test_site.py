"""The site builds and loads no other site; its tour prints what it shows."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers import ROOT, script

import ibdata

DOCS = ROOT / "docs"
LOADS = re.compile(r"""<(?:script|link|img|iframe|source)\b[^>]*?\b(?:src|href)=["']?([^"'\s>]+)""")


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(out)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out


def test_every_page_is_there_and_reached_from_the_first(site):
    first = (site / "index.html").read_text(encoding="utf-8")
    for page in [*DOCS.glob("*.md"), *DOCS.glob("*.ipynb")]:
        assert (site / f"{page.stem}.html").is_file()
        assert f'href="{page.stem}.html"' in first


def test_every_public_name_is_described_with_its_arguments(site):
    text = (site / "api.html").read_text(encoding="utf-8")
    for name in ibdata.__all__:
        if name not in ("__version__", "open"):
            found = getattr(ibdata, name)
            assert f'<h3 id="{found.__module__}.{found.__qualname__}"' in text, name
    assert "overrides" in text
    for path in re.findall(r"^::: (\S+)$", (DOCS / "api.md").read_text(encoding="utf-8"), re.MULTILINE):
        assert f'id="{path}"' in text, path


def shown(notebook) -> list[list[str]]:
    """The text of each output of a cell; of a picture only that it is one."""
    return [
        [
            "a picture"
            if "image/png" in output.get("data", {})
            else output.get("text") or output["data"]["text/plain"]
            for output in cell.outputs
        ]
        for cell in notebook.cells
        if cell.cell_type == "code"
    ]


def test_the_tour_prints_what_it_shows():
    tour = script("tour")
    stored = tour.nbformat.read(tour.TOUR, as_version=4)
    assert sum("a picture" in cell for cell in shown(stored)) == 2
    assert shown(tour.executed(stored)) == shown(stored)


def test_pages_load_nothing_from_elsewhere_and_link_to_no_source(site):
    """Nor does the search need a server: browsers start no worker in a folder, so a script stands in."""
    assert (site / "search/search_index.js").read_text(encoding="utf-8").startswith("var __index = {")
    for page in site.glob("*.html"):
        text = page.read_text(encoding="utf-8")
        loads = LOADS.findall(text)
        assert 'src="iframe-worker.js"' in text or page.name == "404.html"
        assert not re.search(r'href="[^":]+\.(md|ipynb)[#"]', text), page.name
        assert not [target for target in loads if re.match(r"(\w+:)?//", target)], page.name
    for sheet in site.rglob("*.css"):
        assert not re.search(r"(@import|url\()\s*[\"']?(https?:)?//", sheet.read_text(encoding="utf-8"))
