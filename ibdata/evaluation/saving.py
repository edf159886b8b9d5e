"""The table of an evaluation as LaTeX and Markdown to read, CSV to compute with, and JSON to do it again."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ibdata._system.configs import canonical_file
from ibdata._system.files import write
from ibdata._system.storage import local
from ibdata.dataset.tabular import cells_of
from ibdata.errors import OVERWRITE, UsageError, meant, printable
from ibdata.evaluation.algorithms import printed
from ibdata.policies.network import Network
from ibdata.version import __version__

if TYPE_CHECKING:
    from ibdata.evaluation.results import Evaluation

TABLE_LAYOUT = "ibdata-table-1"
TEXT = {character: f"\\{character}" for character in "&%_#${}"}
TEXT |= {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"}
NUMBER = {"-": "$-$", "±": r"$\pm$", "–": "--"}  # the hyphen of a label stays


def place_of(path: str | os.PathLike[str], overwrite: bool) -> Path:
    """The place of a file of results. Raises UsageError for another ending, or a place that is taken."""
    place = local(path)
    if place.suffix not in FORMATS:
        raise UsageError(f"{place}: found the ending {place.suffix!r}{meant(place.suffix, FORMATS)}")
    if not place.parent.is_dir():
        raise UsageError(f"{place}: found no folder {place.parent}, expected one")
    if place.exists() and not (overwrite and place.is_file()):
        raise UsageError(f"{place}: exists already; {OVERWRITE} to replace it")
    return place


def save(found: Evaluation, place: Path) -> None:
    """Write an evaluation in the format of the file's ending."""
    write(place.parent, place.name, FORMATS[place.suffix](found).encode())


def _latex(found: Evaluation) -> str:
    table, text, number = printed(found.algorithms, wide=False), str.maketrans(TEXT), str.maketrans(NUMBER)
    count = len(table.names)
    lines = [f"% {printable(note)}" for note in found.said]
    lines += [
        r"\begingroup \setlength{\tabcolsep}{4pt}",
        rf"\begin{{tabular}}{{@{{}}l{'r' * (count - 1)}@{{}}}}",
        r"\toprule",
    ]
    for row in [list(table.names), *cells_of(table)]:
        if isinstance(row, str):
            lines.append(rf"\midrule \multicolumn{{{count}}}{{@{{}}l}}{{\emph{{{row.translate(text)}}}}} \\")
        else:
            label, *numbers = row
            lines.append(
                " & ".join([label.translate(text), *(x.translate(number) for x in numbers)]) + r" \\"
            )
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular} \endgroup", ""])


def _markdown(found: Evaluation) -> str:
    table = printed(found.algorithms, wide=True)
    lines = [[name.replace("-", "−") for name in table.names], ["---", *["---:"] * (len(table.names) - 1)]]
    for row in cells_of(table):
        label, *numbers = [f"*{row}*", *[""] * (len(table.names) - 1)] if isinstance(row, str) else row
        lines.append([label.replace("|", r"\|"), *(x.replace("-", "−") for x in numbers)])
    rows = [f"| {' | '.join(line)} |" for line in lines]
    return "\n".join([*rows, *(f"\n{printable(note)}" for note in found.said), ""])


def _csv(found: Evaluation) -> str:
    import pandas as pd

    return pd.DataFrame(found.algorithms).to_csv(index=False, lineterminator="\n")


def _json(found: Evaluation) -> str:
    returns = iter(found.returns)
    groups = {
        label: [
            {
                "policy": policy.plain() | {"name": None},
                "networks": {part.sha256: part.weights.file for part in policy.everywhere(Network)},
                "returns_sha256": sha256_of(next(returns)),
            }
            for policy in members.values()
        ]
        for label, members in found.groups.items()
    }
    record = {
        "layout": TABLE_LAYOUT,
        "version": __version__,
        "set_content_root": set_root(found),
        "groups": groups,
    }
    return json.dumps({**record, "settings": found.settings, **found.plain()}, indent=1, allow_nan=False)


def set_root(found: Evaluation) -> str | None:
    """The content root of the shipped set with whose results an evaluation is compared."""
    name = found.settings["against"]
    roots: dict[str, dict[str, str]] = json.loads(canonical_file().read_text(encoding="utf-8"))
    return None if name is None else roots[name]["content_root"]


def sha256_of(returns: Any) -> str:
    """The SHA-256 of the returns of a policy, (setpoints, episodes), as little-endian float64."""
    return hashlib.sha256(np.ascontiguousarray(returns, "<f8").tobytes()).hexdigest()


FORMATS = {".tex": _latex, ".md": _markdown, ".csv": _csv, ".json": _json}
