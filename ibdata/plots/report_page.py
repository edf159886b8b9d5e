"""The page of a report, one HTML file that loads nothing from a network."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import import_module
from typing import Any

from ibdata.dataset.reader import Dataset
from ibdata.experiment import as_yaml
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.writing.card import ABOUT, facts

MOST = 100  # rows of a table, and experiments
SHOWN = ("mean", "std", "min", "max")
CAPTIONS = {
    "rewards": "The reward of a step is -consumption - 3 · fatigue of the next observation.",
    "returns": "The return of an episode is the sum of its rewards.",
    "actions": "Spikes are actions that the policy takes again and again.",
    "coverage": "How often each pair of velocity, gain and shift was visited.",
    "tradeoff": "The two costs of every step; steps at the lower left have the highest reward.",
    "splits": "Which episodes each split holds, and how many two splits share.",
    "traces": "Observed variables and, if the dataset has them, hidden ones.",
}
# The browser loads nothing, whatever the texts of a dataset contain.
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; margin: 0 auto; max-width: 70rem; padding: 1rem; }
h1, h2 { line-height: 1.2; overflow-wrap: anywhere; }
table { border-collapse: collapse; font-size: .875rem; }
th, td { padding: .25rem .75rem .25rem 0; text-align: left; vertical-align: top; }
th { border-bottom: 1px solid; }
td.number { font-variant-numeric: tabular-nums; text-align: right; white-space: nowrap; }
.wide { overflow-x: auto; }
.pictures { align-items: start; display: grid; gap: 1.5rem;
  grid-template-columns: repeat(auto-fill, minmax(min(100%, 22rem), 1fr)); }
figure { margin: 0; }
img { background: #fff; display: block; height: auto; max-width: 100%; }
figcaption { font-size: .875rem; }
pre { font-size: .8125rem; overflow-x: auto; }
code.root { overflow-wrap: anywhere; }
"""
LOAD = """\
import pandas as pd
data = pd.read_parquet("data")  # in the dataset's folder

import ibdata
ds = ibdata.open(".")
ds.episodes, ds.statistics(), ds.arrays(history=30)["observations"]"""


def page(dataset: Dataset, spec: DatasetSpec, pictures: Mapping[str, bytes]) -> bytes:
    """The report on a dataset; `pictures` are PNG by name."""
    name = escape(spec.name)
    parts = [
        f"<h1>{name}</h1>",
        f"<p>{escape(ABOUT)}</p>",
        _table((), [(key, value.replace("`", "")) for key, value in facts(spec)]),
        *_section("Pictures", f'<div class="pictures">{"".join(_pictures(pictures))}</div>'),
        *_section("Splits", *_splits(dataset)),
        *_section("Statistics", *_statistics(dataset)),
        *_section("Columns", *_columns(dataset)),
        *_section("Experiment", *_experiments(spec)),
        *_section("Load it", f"<pre><code>{escape(LOAD)}</code></pre>"),
        *_section("Where it comes from", *_provenance(dataset)),
    ]
    head = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{name}: an Industrial Benchmark dataset</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
    )
    return (head + "\n".join(parts) + "\n</body>\n</html>\n").encode()


def _section(title: str, *parts: str) -> list[str]:
    return [f"<h2>{title}</h2>", *parts]


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table of the first 100 rows. Texts are on the left, numbers on the right; None is a dash."""
    everything = list(rows)
    lines = ['<div class="wide"><table>']
    if head:
        lines.append(f"<thead><tr>{''.join(f'<th>{escape(text)}</th>' for text in head)}</tr></thead>")
    lines += [f"<tr>{''.join(map(_cell, row))}</tr>" for row in everything[:MOST]]
    more = f"<p>and {len(everything) - MOST} more</p>" if len(everything) > MOST else ""
    return "\n".join([*lines, "</table></div>" + more])


def _cell(value: Any) -> str:
    if value is None:
        return '<td class="number">–</td>'
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return f'<td class="number">{value if isinstance(value, int) else f"{value:.6g}"}</td>'
    return f"<td>{escape(str(value))}</td>"


def _pictures(pictures: Mapping[str, bytes]) -> Iterable[str]:
    for name, caption in CAPTIONS.items():
        title = import_module(f"ibdata.plots.dataset.{name}").TITLE
        data = base64.b64encode(pictures[name]).decode()
        yield (
            f'<figure><img alt="{escape(title)}" src="data:image/png;base64,{data}">'
            f"<figcaption><strong>{escape(title)}.</strong> {escape(caption)}</figcaption></figure>"
        )


def _splits(dataset: Dataset) -> Iterable[str]:
    splits = dataset.info_model.splits
    if not splits:
        yield "<p>None.</p>"
        return
    rows = [(name, s.episodes, s.rows, _files(s.files)) for name, s in splits.items()]
    yield _table(("split", "episodes", "rows", "files"), rows)


def _files(files: list[str] | None) -> str:
    if files is None:
        return "labels in meta/episodes.parquet"
    return f"{len(files)} whole file{'s'[: len(files) != 1]}"


def _statistics(dataset: Dataset) -> Iterable[str]:
    columns = dataset.statistics()
    rows = [(n, *(s[k] for k in SHOWN), s["quantiles"].get("0.5")) for n, s in columns.items()]
    yield _table(("column", *SHOWN, "median"), rows)


def _columns(dataset: Dataset) -> Iterable[str]:
    keys = ("name", "role", "dtype", "unit", "low", "high", "description")
    yield _table(keys, [[getattr(column, key) for key in keys] for column in dataset.info_model.columns])


def _experiments(spec: DatasetSpec) -> Iterable[str]:
    for experiment in spec.experiments[:MOST]:
        yield f"<pre><code>{escape(as_yaml(experiment).decode())}</code></pre>"
    if len(spec.experiments) > MOST:
        yield f"<p>and {len(spec.experiments) - MOST} more, see meta/</p>"


def _provenance(dataset: Dataset) -> Iterable[str]:
    listed = dataset.manifest_model
    entries = listed.entries()
    yield f'<p>content root <code class="root">{escape(dataset.content_root)}</code></p>'
    reproducible: dict[bool | str, str] = {
        True: "yes, on any machine",
        False: "no, the machine computed other bits than all others",
    }
    rows: list[tuple[str, Any]] = [
        ("reproducible", reproducible.get(listed.reproducible, "in the same environment only")),
        ("data version", listed.data_version),
        ("actions cut to [-1, 1]", listed.clipped_actions),
        *((f"made with {name}", version) for name, version in sorted(listed.versions.items())),
        *((f"code {c.target}", c.sha256 or c.version) for c in listed.code),
    ]
    yield _table((), rows)
    yield _table(("file", "bytes", "SHA-256"), [entries[shard.path] for shard in listed.shards])
