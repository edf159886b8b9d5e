"""Documents in docs/ in which a script writes the lines between two markers."""

import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"
OPEN, CLOSE = "<!-- measured -->", "<!-- /measured -->"


def replaced(document: str, block: str) -> str:
    """The document with other lines between its markers."""
    before, rest = document.split(OPEN)
    after = rest.split(CLOSE)[1]
    return f"{before}{OPEN}\n{block}\n{CLOSE}{after}"


def measured(document: str) -> str:
    """The lines between the markers of a document."""
    return document.split(OPEN)[1].split(CLOSE)[0][1:-1]


def write_or_compare(path: Path, block: str, check: bool) -> int:
    """Write the lines between the markers, or with `check` compare them; return 1 if they differ."""
    old = path.read_text(encoding="utf-8")
    new = replaced(old, block)
    if not check:
        path.write_text(new, encoding="utf-8")
    elif old != new:
        name = Path(sys.argv[0]).name
        print(
            f"docs/{path.name}: the tables differ from the measurement; run scripts/{name}", file=sys.stderr
        )
        return 1
    return 0
