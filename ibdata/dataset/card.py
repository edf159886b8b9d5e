"""The dataset card: README.md with Hugging Face front matter."""

from __future__ import annotations

from ibdata.dataset.metadata import splits
from ibdata.dataset.shard import Written
from ibdata.dynamics.variants import VARIANTS
from ibdata.experiment import Experiment

SIZES = ((10**3, "n<1K"), (10**4, "1K<n<10K"), (10**5, "10K<n<100K"), (10**6, "100K<n<1M"))
LARGER = ((10**7, "1M<n<10M"), (10**8, "10M<n<100M"), (10**9, "100M<n<1B"))


def card(experiment: Experiment, written: list[Written], root: str) -> bytes:
    """The card of a dataset."""
    return f"{_front_matter(experiment, written)}\n{_text(experiment, written, root)}".encode()


def _front_matter(experiment: Experiment, written: list[Written]) -> str:
    size = next((name for limit, name in (*SIZES, *LARGER) if experiment.rows < limit), "n>1B")
    lines = [
        "---",
        f"pretty_name: Industrial Benchmark, {experiment.name}",
        "tags: [reinforcement-learning, offline-rl, industrial-benchmark]",
        f"size_categories: [{size}]",
        "configs:",
        "  - config_name: default",
        "    default: true",
        "    data_files: data/*.parquet",
    ]
    for name, split in splits(experiment, written).items():
        lines += [f"  - config_name: {name}", "    data_files:"]
        lines += [f"      - {file}" for file in split["files"]]
    return "\n".join([*lines, "---", ""])


def _text(experiment: Experiment, written: list[Written], root: str) -> str:
    dynamics = experiment.dynamics if isinstance(experiment.dynamics, str) else "custom"
    source = {
        "siemens": "the authors' published Python code",
        "paper": "the equations as the paper prints them",
        "custom": "a published variant with fields replaced, see meta/experiment.yaml",
    }[dynamics if dynamics in VARIANTS else "custom"]
    setpoints = sorted({cell.setpoint for cell in experiment.cells})
    shown = ", ".join(f"{p:g}" for p in setpoints[:20]) + (", …" if len(setpoints) > 20 else "")
    made = [
        f"# {experiment.name}",
        "",
        "Transitions of the Industrial Benchmark (Hein et al. 2017, arXiv 1709.09480), made by ibdata.",
        "",
        "| | |",
        "|---|---|",
        f"| dynamics | `{dynamics}`: {source} |",
        f"| setpoints | {shown}{', moving from there' if experiment.drifting else ''} |",
        f"| policies | {', '.join(experiment.labels)} |",
        f"| episodes | {len(experiment.cells) * experiment.episodes} of {experiment.steps} steps |",
        f"| rows | {experiment.rows} |",
        f"| content root | `{root}` |",
        "",
        "A row is (o, a, o′, r) with the latent state; `meta/info.json` describes every column. Rewards are",
        "-consumption - 3·fatigue of the next observation, unscaled. `truncated` marks the last row of an",
        "episode, a time limit; `terminated` is always false.",
        "",
        "```python",
        "import pandas as pd",
        'data = pd.read_parquet("data")',
        "```",
        "",
        "`meta/experiment.yaml` is all it takes to make the dataset again, bit for bit:",
        "`ibdata generate --config meta/experiment.yaml --out again`.",
        "",
    ]
    per_split = splits(experiment, written)
    if per_split:
        made += ["| split | episodes | rows |", "|---|---|---|"]
        made += [f"| {name} | {s['episodes']} | {s['rows']} |" for name, s in per_split.items()] + [""]
    return "\n".join(made)
