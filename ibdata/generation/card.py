"""The dataset card: README.md with Hugging Face front matter."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence

import pyarrow as pa

from ibdata._numerics.naming import exact, yaml_name
from ibdata._system.files import FileEntry
from ibdata.dataset.models import Info, Manifest
from ibdata.dataset.quality import MEANING, Quality, ReturnMeasures, return_measures
from ibdata.dataset.returns import averages, behaviour_returns
from ibdata.dataset.stored import Stored
from ibdata.dataset.tabular import column_texts
from ibdata.errors import printable
from ibdata.generation.metadata import info, splits
from ibdata.plan.dataset_spec import DatasetSpec
from ibdata.version import __version__

DYNAMICS = {
    "siemens": "the authors' published Python code",
    "paper": "the equations as the paper prints them",
    "custom": "a published variant with fields replaced, see meta/",
}
ABOUT = "Transitions of the Industrial Benchmark (Hein et al. 2017, arXiv 1709.09480), made by ibdata."
KEYWORDS = ["reinforcement-learning", "offline-rl", "industrial-benchmark"]
CITE = """\
Please cite the benchmark's paper for the benchmark, and ibdata with its version and the content root of the
dataset."""
BODY = "## Behaviour\n"  # the line that follows the head
# The words of the Hub for fewer than 10³ rows, from 10³ rows on, from 10⁴ rows on …
SIZES = ["n<1K", "1K<n<10K", "10K<n<100K", "100K<n<1M", "1M<n<10M", "10M<n<100M", "100M<n<1B", "n>1B"]

PAPER = """\
@inproceedings{hein2017benchmark,
  title     = {A Benchmark Environment Motivated by Industrial Control Problems},
  author    = {Hein, Daniel and Depeweg, Stefan and Tokic, Michel and Udluft, Steffen and Hentschel, Alexander
               and Runkler, Thomas A. and Sterzing, Volkmar},
  booktitle = {IEEE Symposium Series on Computational Intelligence},
  year      = {2017},
  eprint    = {1709.09480},
  archiveprefix = {arXiv}
}"""
IBDATA = """\
@software{{ibdata,
  title   = {{ibdata: offline reinforcement-learning datasets of the Industrial Benchmark}},
  author  = {{{{The ibdata developers}}}},
  version = {{{version}}},
  note    = {{Dataset {name}, content root {root}}}
}}"""
OTHER = "other"
# Licences for data and code that the Hub knows by their SPDX names in lower case.
SAME = """
apache-2.0 bsd-2-clause bsd-3-clause cc0-1.0 cc-by-2.0 cc-by-2.5 cc-by-3.0 cc-by-4.0 cc-by-sa-3.0 cc-by-sa-4.0
cc-by-nc-2.0 cc-by-nc-3.0 cc-by-nc-4.0 cc-by-nd-4.0 cc-by-nc-nd-3.0 cc-by-nc-nd-4.0 cc-by-nc-sa-2.0
cc-by-nc-sa-3.0 cc-by-nc-sa-4.0 cdla-permissive-1.0 cdla-permissive-2.0 cdla-sharing-1.0 etalab-2.0 isc mit
mpl-2.0 unlicense zlib
"""
FAMILIES = {"odbl-1.0": "odbl", "odc-by-1.0": "odc-by", "pddl-1.0": "pddl"}  # which it knows without a number


def card_text(
    spec: DatasetSpec,
    files: Sequence[FileEntry],
    root: str,
    episodes: pa.Table,
    version: str = __version__,
    measured: Quality | None = None,
) -> bytes:
    """The bytes of the card.

    Args:
        spec: The experiments and splits of the dataset.
        files: The files of its shards.
        root: Its content root.
        episodes: Its table of episodes.
        version: The version of ibdata that made it.
        measured: Its measures of quality; by default those that need only the returns.
    """
    described = info(spec)
    sections = (
        _head(spec, files, root),
        *_behaviour(episodes, described),
        *_quality(measured or return_measures(episodes, described)),
        *_columns(described),
        f"## How to cite\n\n{CITE}\n\n```bibtex\n{bibtex(spec.name, root, version)}\n```\n",
    )
    return "\n".join(sections).encode()


def card_of(stored: Stored, spec: DatasetSpec, measured: Quality | None = None) -> bytes:
    """The bytes of the card of a dataset that is there."""
    listed = stored.manifest
    version = printable(listed.versions.get("ibdata", __version__))
    return card_text(spec, _files(listed), listed.content_root, stored.episodes, version, measured)


def with_splits_of(spec: DatasetSpec, before: DatasetSpec, text: bytes, listed: Manifest) -> bytes | None:
    """A card with the splits of `spec` in place of those of `before`; None if somebody edited its head."""
    old, new = (_head(each, _files(listed), listed.content_root).encode() for each in (before, spec))
    head, *body = text.partition(f"\n{BODY}".encode())
    return b"".join([new, *body]) if head in (old, new) else None


def _files(listed: Manifest) -> list[FileEntry]:
    """The files of the shards."""
    entries = listed.entries()
    return [entries[shard.path] for shard in listed.shards]


def facts(spec: DatasetSpec) -> list[tuple[str, str]]:
    """The lines of the card's table: names and values, with code in backticks."""
    experiments = spec.experiments
    named = experiments[0].dynamics if isinstance(experiments[0].dynamics, str) else "custom"
    setpoints = sorted(spec.setpoints)
    shown = ", ".join(exact(p) for p in setpoints[:20]) + (", …" if len(setpoints) > 20 else "")
    steps = " or ".join(f"{n:,}" for n in dict.fromkeys(experiment.steps for experiment in experiments))
    return [
        ("dynamics", f"`{named}`: {DYNAMICS[named]}"),
        ("setpoints", f"{shown}{', moving from there' if experiments[0].drifting else ''}"),
        ("policies", ", ".join(spec.labels)),
        ("episodes", f"{spec.episodes:,} of {steps} steps"),
        ("rows", f"{spec.rows:,}, in `data/*.parquet`"),
        ("licence", ", ".join(f"`{licence}`" for licence in spec.licences)),
    ]


def _head(spec: DatasetSpec, files: Sequence[FileEntry], root: str) -> str:
    """The front matter, and what was simulated: all that depends on the splits."""
    lines = [
        *_front_matter(spec, files),
        f"# {spec.name}",
        "",
        ABOUT,
        "",
        "| | |",
        "|---|---|",
        *(f"| {name} | {value} |" for name, value in facts(spec)),
        f"| content root | `{root}` |",
        "",
        "A row is (o, a, o′, r) with the latent state; every column is described below. Rewards are",
        "-consumption - 3·fatigue of the next observation, unscaled. `truncated` marks the last row of",
        "an episode, a time limit; `terminated` is always false.",
        "",
        "```python",
        "import pandas as pd",
        'data = pd.read_parquet("data")',
        "```",
        "",
        *how_to_make_again(spec),
        "",
    ]
    if per_split := splits(spec):
        lines += ["| split | episodes | rows |", "|---|---|---|"]
        lines += [f"| {name} | {s.episodes:,} | {s.rows:,} |" for name, s in per_split.items()] + [""]
    return "\n".join(lines)


def _front_matter(spec: DatasetSpec, files: Sequence[FileEntry]) -> list[str]:
    hashes = hashlib.sha256("".join(file.sha256 for file in files).encode()).hexdigest()
    # Hugging Face keeps a copy of the rows by the text of the configurations, and looks at no file again.
    description = f"    description: files {hashes[:16]}"
    lines = [
        "---",
        f"pretty_name: Industrial Benchmark, {spec.name}",
        *front_matter(spec.licences),
        "task_categories: [reinforcement-learning]",
        f"tags: [{', '.join(KEYWORDS)}]",
        f"size_categories: [{SIZES[sum(spec.rows >= 10**power for power in range(3, 10))]}]",
        "configs:",
        "  - config_name: default",
        "    default: true",
        description,
        "    data_files:",
    ]
    shards = list(zip(spec.shards, files, strict=True))
    paths = {name: [file.path for shard, file in shards if name in shard.splits] for name in spec.declared}
    disjoint = all(len(shard.splits) == 1 for shard in spec.shards)  # and all that there is
    disjoint = disjoint and len({_hub_name(name) for name in paths}) == len(paths)
    if not disjoint:
        lines += _data_files("everything" if paths or spec.later else "train", ["data/part-*.parquet"])
    for name, own in paths.items():
        if not disjoint:
            lines += [f"  - config_name: {yaml_name(name)}", description, "    data_files:"]
        lines += _data_files(name, own)
    return [*lines, "---", ""]


def _hub_name(split: str) -> str:
    """The name of a split that Hugging Face admits."""
    return "all_" if split == "all" else split.replace("-", "_")


def _data_files(split: str, paths: Sequence[str]) -> list[str]:
    """The lines of a split that is whole files."""
    return [
        f"      - split: {yaml_name(_hub_name(split))}",
        "        path:",
        *(f"          - {path}" for path in paths),
    ]


def _behaviour(episodes: pa.Table, described: Info) -> Iterator[str]:
    """The returns of the behaviour, by policy."""
    returns = behaviour_returns(episodes, described)
    yield BODY
    yield "| policy | episodes | steps | return | ± s.e. | reward/step | score | ± s.e. |"
    yield "|---|---|---|---|---|---|---|---|"
    for a in averages(returns["results"]):
        error = "-" if a.standard_error is None else f"{a.standard_error:,.0f}"
        score, off = ("-" if x is None else f"{x:.1f}" for x in (a.score, a.score_error))
        policy = "all policies" if a.policy is None else a.policy
        yield (
            f"| {policy} | {a.episodes:,} | {a.steps:,} | {a.mean_return:,.0f} | {error} "
            f"| {a.mean_reward:.2f} | {score} | {off} |"
        )
    yield "\nA return is the sum of the rewards of an episode, not discounted. Setpoints have equal weights."
    if returns["scale"]:
        yield f"Score: {returns['scale']}. One episode does not tell its error, so it has none."
    yield ""


def _quality(measures: Quality | ReturnMeasures) -> Iterator[str]:
    """The measures of quality that are known."""
    measured = {name: x for name in MEANING if (x := getattr(measures, name, None)) is not None}
    if measured:
        yield "## Quality\n"
        yield "| measure | value | meaning |"
        yield "|---|---|---|"
        for name, value in zip(measured, column_texts(list(measured.values())), strict=True):
            yield f"| {name.replace('_', ' ')} | {value} | {MEANING[name]} |"
        yield ""


def _columns(described: Info) -> Iterator[str]:
    """Every column with its type, unit, range and meaning."""
    yield "## Columns\n"
    yield "| column | type | unit | range | meaning |"
    yield "|---|---|---|---|---|"
    for c in described.columns:
        low, high = ("" if bound is None else exact(bound) for bound in (c.low, c.high))
        yield f"| `{c.name}` | {c.dtype} | {c.unit} | {low} … {high} | {c.description} |"
    yield ""


def how_to_make_again(spec: DatasetSpec) -> list[str]:
    """The lines that say how to make a dataset again, if that can be done."""
    live = [live_object.code_target for live_object in spec.live]
    if live:
        names = ", ".join(f"`{target}`" for target in dict.fromkeys(live))
        return [f"Nobody can make it again: a policy was an object of a Python session, {names}."]
    if len(spec.experiments) > 1:
        return [
            f"It was merged from {len(spec.experiments)} experiments, `meta/experiment-*.yaml`;",
            "`ibdata reproduce` makes every episode again and compares.",
        ]
    return [
        "`meta/experiment.yaml` is all it takes to make the dataset again, bit for bit:",
        "`ibdata generate --config meta/experiment.yaml --out ../again`. So nobody needs to download it;",
        "of a copy, `ibdata validate .` compares every row with the content root.",
    ]


def bibtex(name: str, root: str, version: str) -> str:
    """The entries of BibTeX for a dataset with this name and content root, made by a version of ibdata."""
    return f"{PAPER}\n\n{IBDATA.format(name=name, root=root, version=version)}"


def front_matter(licences: Sequence[str]) -> list[str]:
    """The lines of the front matter for these SPDX expressions, of which there is at least one.

    https://huggingface.co/docs/hub/repositories-licenses lists the words; any other licence is `other`.

    >>> front_matter(["CC-BY-4.0"])
    ['license: cc-by-4.0']
    >>> front_matter(["ODbL-1.0", "MIT OR Apache-2.0"])
    ['license: [odbl, other]', 'license_name: "MIT OR Apache-2.0"']
    """
    words = {}
    for licence in licences:
        lower = licence.lower()
        words[licence] = lower if lower in SAME.split() else FAMILIES.get(lower, OTHER)
    distinct = list(dict.fromkeys(words.values()))
    others = ", ".join(licence for licence, word in words.items() if word == OTHER)
    lines = [f"license: {distinct[0] if len(distinct) == 1 else '[' + ', '.join(distinct) + ']'}"]
    return [*lines, f'license_name: "{others}"'] if others else lines
