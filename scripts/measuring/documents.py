"""Pages of docs/ in which scripts write the lines between two markers; all else is written by hand."""

import json
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

DOCS = Path(__file__).resolve().parents[2] / "docs"


def replaced(document: str, block: str, kind: str = "measured") -> str:
    """The document with other lines between its markers, such as `measured` or `generated`."""
    before, opened, rest = document.partition(f"<!-- {kind} -->\n")
    _, closed, after = rest.partition(f"\n<!-- /{kind} -->")
    if not closed:
        raise ValueError(f"found no lines between the markers {kind} and /{kind}")
    return before + opened + block + closed + after


def measured(document: str, kind: str = "measured") -> str:
    """The lines between the markers of a document."""
    match = re.search(rf"<!-- {kind} -->\n(.*)\n<!-- /{kind} -->", document, re.DOTALL)
    assert match is not None
    return match[1]


def filled(document: str, numbers: Mapping[str, float]) -> str:
    """The document with the values of its numbers that have names, such as `−56.0<!--best-->`.

    A number keeps its digits, its plus sign and its commas.
    """
    names = set()

    def value(match: re.Match[str]) -> str:
        sign, old, name = match.groups()
        names.add(name)
        digits = len(old.partition(".")[2])
        number = f"{numbers[name]:{'+' * (sign == '+')}{',' * (',' in old)}.{digits}f}"
        return f"{number.replace('-', '−')}<!--{name}-->"

    text = re.sub(r"([+−]?)([\d,]+(?:\.\d+)?)<!--([\w.+-]+)-->", value, document)
    if unused := numbers.keys() - names:
        raise ValueError(f"found no place for the numbers {', '.join(sorted(unused))}")
    return text


def write_measured(path: Path, block: str, kind: str = "measured") -> None:
    """Write the lines between the markers of a page."""
    path.write_text(replaced(path.read_text(encoding="utf-8"), block, kind), encoding="utf-8")


def write_sets(
    study: str,
    page: str,
    names: Iterable[str],
    measure: Callable[[str, Path], Any],
    table_of: Callable[[dict[str, Any]], str],
) -> None:
    """Measure shipped sets, each in a temporary folder; write docs/STUDY.json and its table in the page."""
    sets = {}
    for name in names:
        with TemporaryDirectory() as folder:
            sets[name] = measure(name, Path(folder, "made"))
        print(name, sets[name], file=sys.stderr, flush=True)
    (DOCS / f"{study}.json").write_text(json.dumps(sets, indent=1) + "\n", encoding="utf-8")
    write_measured(DOCS / f"{page}.md", f"\n{table_of(sets)}\n", f"measured, {study}")


def table(head: Sequence[str], rows: Iterable[Sequence[object]]) -> str:
    """A Markdown table."""
    lines = [f"| {' | '.join(map(str, row))} |" for row in (head, *rows)]
    return "\n".join([lines[0], "|---" * len(head) + "|", *lines[1:]])
