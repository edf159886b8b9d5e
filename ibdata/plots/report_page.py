"""The page of a report, one HTML file that loads nothing from a network."""

from __future__ import annotations

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

from ibdata._numerics.naming import counted
from ibdata.dataset.dataset import Dataset
from ibdata.dataset.quality import Quality
from ibdata.dataset.returns import results_table
from ibdata.dataset.tabular import Tabular, column_texts
from ibdata.experiment import as_yaml
from ibdata.generation.card import ABOUT, facts
from ibdata.plan.dataset_spec import DatasetSpec
from ibdata.plots import PICTURES

MOST = 100  # rows of a table, and experiments
# The browser loads nothing, whatever the texts of a dataset contain.
POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"
LOAD = """\
import pandas as pd
data = pd.read_parquet("data")  # in the dataset's folder

import ibdata
ds = ibdata.open(".")
ds.episodes, ds.statistics(), ds.arrays(history=30)["observations"]"""


def page(dataset: Dataset, spec: DatasetSpec, pictures: Mapping[str, bytes], measured: Quality) -> bytes:
    """The report on a dataset; `pictures` are PNG by name."""
    name = escape(spec.name)
    sections = {
        "Returns and scores": _returns(dataset),
        "Pictures": _pictures(pictures),
        "Quality": _shown(measured),
        "Splits": _shown(dataset.splits) if dataset.splits else [],
        "Statistics": _shown(dataset.statistics()),
        "Columns": _columns(dataset),
        "Experiment": _experiments(spec),
        "Load it": [f"<pre><code>{escape(LOAD)}</code></pre>"],
        "Where it comes from": _provenance(dataset),
    }
    filled = {title: section for title, parts in sections.items() if (section := list(parts))}
    contents = [f'<li><a href="#{_id(title)}">{title}</a></li>' for title in filled]
    lines = [
        f"<h1>{name}</h1>",
        f"<p>{escape(ABOUT)}</p>",
        _table((), [(key, value.replace("`", "")) for key, value in facts(spec)]),
        f'<nav aria-label="Contents"><ul>{"".join(contents)}</ul></nav>',
        *(
            line
            for title, parts_of_section in filled.items()
            for line in (f'<h2 id="{_id(title)}">{title}</h2>', *parts_of_section)
        ),
    ]
    head = (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{name}: an Industrial Benchmark dataset</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
    )
    return (head + "\n".join(lines) + "\n</body>\n</html>\n").encode()


def _id(title: str) -> str:
    return title.lower().replace(" ", "-")


def _table(head: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    """A table of the first 100 rows. Texts are on the left, numbers on the right; None is a dash."""
    everything = list(rows)
    lines = ['<div class="wide" tabindex="0"><table>']
    if head:
        first = everything[0] if everything else head
        names = (f"<th{_kind(value)}>{escape(text)}</th>" for text, value in zip(head, first, strict=True))
        lines.append(f"<thead><tr>{''.join(names)}</tr></thead>")
    columns = [
        [f"<td{_kind(value)}>{escape(text)}</td>" for value, text in zip(row, column_texts(row), strict=True)]
        for row in zip(*everything[:MOST], strict=True)
    ]
    lines += [f"<tr>{''.join(cells)}</tr>" for cells in zip(*columns, strict=True)]
    rest = len(everything) - MOST
    more = f"<p>and {counted(rest, 'more row')}</p>" if rest > 0 else ""
    return "\n".join([*lines, "</table></div>" + more])


def _kind(value: Any) -> str:
    number = value is None or (isinstance(value, int | float) and not isinstance(value, bool))
    return ' class="number"' if number else ""


def _pictures(pictures: Mapping[str, bytes]) -> Iterable[str]:
    yield '<div class="pictures">'
    yield from (_picture(name, data) for name, data in pictures.items())
    yield "</div>"


def _picture(name: str, data: bytes) -> str:
    """A picture that a click enlarges to its own size."""
    title, caption = map(escape, PICTURES[name])
    width, height = (int.from_bytes(data[i : i + 4], "big") for i in (16, 20))  # in the header of a PNG
    source = f"data:image/png;base64,{base64.b64encode(data).decode()}"
    return (
        f'<figure id="picture-{name}"><div class="picture" id="large-{name}">'
        f'<a class="close" href="#picture-{name}">close</a><a href="#large-{name}" title="enlarge">'
        f'<img alt="{title}" width="{width}" height="{height}" src="{source}"></a></div>'
        f"<figcaption><strong>{title}.</strong> {caption}</figcaption></figure>"
    )


def _returns(dataset: Dataset) -> Iterable[str]:
    returns = dataset.returns()
    names, rows, *_ = results_table(returns)
    yield _table(names, rows)
    if returns["scale"]:
        yield f"<p>score: {escape(returns['scale'])}</p>"


def _shown(result: Tabular) -> Iterable[str]:
    table, *_ = result.tables()
    yield _table(table.names, table.rows)


def _columns(dataset: Dataset) -> Iterable[str]:
    keys = ("name", "role", "dtype", "unit", "low", "high", "description")
    yield _table(keys, [[getattr(column, key) for key in keys] for column in dataset.stored.info.columns])


def _experiments(spec: DatasetSpec) -> Iterable[str]:
    for experiment in spec.experiments[:MOST]:
        yield f"<pre><code>{escape(as_yaml(experiment).decode())}</code></pre>"
    if len(spec.experiments) > MOST:
        yield f"<p>and {counted(len(spec.experiments) - MOST, 'more experiment')}, see meta/</p>"


def _provenance(dataset: Dataset) -> Iterable[str]:
    manifest = dataset.stored.manifest
    entries = manifest.entries()
    yield f'<p>content root <code class="root">{escape(dataset.content_root)}</code></p>'
    reproducible: dict[bool | str, str] = {
        True: "yes, on any machine",
        False: "no, the machine computed other bits than all others",
    }
    rows: list[tuple[str, Any]] = [
        ("reproducible", reproducible.get(manifest.reproducible, "in the same environment only")),
        ("data version", manifest.data_version),
        ("actions cut to [-1, 1]", manifest.clipped_actions),
        *((f"made with {name}", version) for name, version in sorted(manifest.versions.items())),
        *((f"code {c.target}", c.sha256 or c.version) for c in manifest.code),
    ]
    yield _table((), rows)
    yield _table(("file", "bytes", "SHA-256"), [entries[shard.path] for shard in manifest.shards])


# For wide and for narrow screens.
STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; margin: 0 auto; max-width: 76rem; padding: 1rem; }
h1, h2 { line-height: 1.2; overflow-wrap: anywhere; }
nav ul { column-gap: 1.25rem; display: flex; flex-wrap: wrap; list-style: none; padding: 0; }
table { border-collapse: collapse; font-size: .875rem; }
th, td { padding: .25rem .75rem .25rem 0; text-align: left; vertical-align: top; }
th { border-bottom: 1px solid; }
.number { font-variant-numeric: tabular-nums; text-align: right; white-space: nowrap; }
td.number + td:last-child:not(.number) { min-width: 12rem; }
/* A shadow at each side on which there is more to scroll to, and a scroll bar that is always there. */
.wide, pre { overflow-x: auto; background:
  linear-gradient(to right, Canvas 1.5rem, transparent 3rem) 0 0 / 3rem 100% no-repeat local,
  linear-gradient(to left, Canvas 1.5rem, transparent 3rem) 100% 0 / 3rem 100% no-repeat local,
  linear-gradient(to right, #8889, transparent) 0 0 / .9rem 100% no-repeat scroll,
  linear-gradient(to left, #8889, transparent) 100% 0 / .9rem 100% no-repeat scroll; }
.wide::-webkit-scrollbar, pre::-webkit-scrollbar { height: .5rem; }
.wide::-webkit-scrollbar-thumb, pre::-webkit-scrollbar-thumb { background: #888; border-radius: .25rem; }
.pictures { align-items: start; display: grid; gap: 1.5rem;
  grid-template-columns: repeat(auto-fit, minmax(min(30rem, 100%), 1fr)); }
figure { margin: 0; }
img { background: #fff; display: block; height: auto; max-width: 100%; }
figcaption { font-size: .875rem; }
.close { display: none; }
.picture:target { background: Canvas; inset: 0; overflow: auto; padding: 1rem; position: fixed; z-index: 1; }
.picture:target img { margin: auto; max-width: none; }
.picture:target .close { background: Canvas; display: inline-block; inset: 0 auto auto 0; padding: .5rem;
  position: sticky; }
pre { font-size: .8125rem; }
code.root { overflow-wrap: anywhere; }
"""
