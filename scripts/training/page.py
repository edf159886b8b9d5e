"""The tables and the picture of docs/baselines.md."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ibdata.dataset.reference_returns import scale
from ibdata.evaluation.baselines import BEHAVIOUR, SETTINGS, Baseline
from ibdata.numerics.confidence import estimate
from measuring.documents import DOCS, replaced

PAGE, PICTURE = DOCS / "baselines.md", DOCS / "figures" / "baselines.png"
REFERENCES = ("random", "optimized", "expert")
SUITES = ("siemens-offline", "d4rl-like", "neorl-like")
LABELS = {
    BEHAVIOUR: "behaviour",
    "bc": "BC",
    "td3+bc": "TD3+BC",
    "iql": "IQL",
    "cql": "CQL",
    "bcq": "BCQ",
    "bear": "BEAR",
}
Key = tuple[str, str]  # a set and an algorithm


def grouped(lines: Sequence[Baseline]) -> dict[Key, list[Baseline]]:
    """The results of all seeds of a set and an algorithm."""
    found: dict[Key, list[Baseline]] = {}
    for line in lines:
        found.setdefault((line.set, line.algorithm), []).append(line)
    return found


def references() -> dict[str, float]:
    """The returns of known policies in 10,000 episodes."""
    known = scale(*(SETTINGS[name] for name in ("dynamics", "start", "steps", "discount")))
    assert known is not None
    return {
        each.policy: each.mean_return
        for each in known.results
        if each.policy in REFERENCES and each.setpoint == SETTINGS["setpoint"]
    }


def cell(lines: Sequence[Baseline], field: str) -> str:
    """The mean over seeds in hundreds, and the lowest and highest seed if there are several."""
    values = [getattr(line, field) / 100 for line in lines if getattr(line, field) is not None]
    failed = len(lines) - len(values)
    parts = [f"{np.mean(values):.1f}"] if values else []
    if len(values) > 1:
        parts.append(f"[{min(values):.1f}, {max(values):.1f}]")
    if failed:
        parts.append(f"{failed} failed")
    return " ".join(parts).replace("-", "−") or "–"


def table(lines: Sequence[Baseline], sets: Sequence[str], algorithms: Sequence[str], field: str) -> str:
    """A Markdown table with a row per set."""
    found = grouped(lines)
    head = f"| set | {' | '.join(LABELS[name] for name in algorithms)} |"
    rows = [
        f"| `{each}` | {' | '.join(cell(found.get((each, name), []), field) for name in algorithms)} |"
        for each in sets
    ]
    return "\n".join([head, "|---" * (1 + len(algorithms)) + "|", *rows])


def verdicts(lines: Sequence[Baseline]) -> str:
    """A Markdown table of how many runs got a higher, an equal or a lower return than the set's behaviour.

    By the 95 % interval of the mean of the paired differences; a policy that failed counts as lower.
    """
    behaviour = {line.set: line.values for line in lines if line.algorithm == BEHAVIOUR}
    counts: dict[str, list[int]] = {}
    for line in lines:
        base, values = behaviour.get(line.set), line.values
        if line.algorithm == BEHAVIOUR or base is None:
            continue
        count = counts.setdefault(line.algorithm, [0, 0, 0])
        low, high = (-1.0, -1.0) if values is None else estimate([values - base]).interval or (-1.0, 1.0)
        count[0 if low > 0 else 2 if high < 0 else 1] += 1
    rows = [f"| {LABELS[name]} | {' | '.join(map(str, counts[name]))} |" for name in LABELS if name in counts]
    return "\n".join(["| algorithm | higher | no difference seen | lower |", "|---|---|---|---|", *rows])


def times(lines: Sequence[Baseline]) -> str:
    """A Markdown table of the seconds of a processor that a run of each algorithm took."""
    rows = []
    for name, label in LABELS.items():
        seconds = [line.cpu_seconds for line in lines if line.algorithm == name and name != BEHAVIOUR]
        if seconds:
            low, middle, high = min(seconds), float(np.median(seconds)), max(seconds)
            rows.append(f"| {label} | {len(seconds)} | {middle:.0f} | {low:.0f} to {high:.0f} |")
    return "\n".join(["| algorithm | runs | median seconds | from, to |", "|---|---|---|---|", *rows])


def block(lines: Sequence[Baseline], plan: Sequence[Any]) -> str:
    """All that the page says of results."""
    wanted = [run for run in plan if run.algorithm != BEHAVIOUR]
    done = [line for line in lines if line.algorithm != BEHAVIOUR]
    errors = [line.standard_error for line in lines if line.standard_error is not None]
    known = ", ".join(f"`{name}` {value / 100:.1f}".replace("-", "−") for name, value in references().items())
    by_suite = {
        suite: list(dict.fromkeys(run.set for run in plan if run.set.startswith(f"{suite}/")))
        for suite in SUITES
    }
    others = [run for run in wanted if run.algorithm in ("bcq", "bear")]
    four = [name for name in LABELS if name not in ("bcq", "bear")]
    parts = [f"{len(done)} of {len(wanted)} runs are done. – stands for what was not run yet."]
    if errors:
        parts[0] += f" The standard errors of the 200 episodes are at most {max(errors) / 100:.2f}."
    parts.append(f"For comparison, the mean returns of 10,000 episodes: {known}.")
    for field, title in (("mean_return", "Mean return"), ("p10", "10th percentile")):
        parts.append(f"### {title}")
        parts += [table(lines, sets, four, field) for sets in by_suite.values()]
        sets = list(dict.fromkeys(run.set for run in others))
        parts.append(table(lines, sets, [BEHAVIOUR, "bcq", "bear"], field))
    parts.append("### Compared with the behaviour of the set")
    parts.append("Numbers of runs, by the 95 % interval of the paired differences in the 200 episodes.")
    parts += [
        verdicts(lines),
        "### Time",
        "Seconds of a processor for the training of one run.",
        times(lines),
    ]
    return "\n\n".join(parts)


def write_page(lines: Sequence[Baseline], plan: Sequence[Any]) -> None:
    """Write the tables, and draw the picture."""
    page = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(replaced(page, f"\n{block(lines, plan)}\n"), encoding="utf-8")
    draw(lines, plan)


def draw(lines: Sequence[Baseline], plan: Sequence[Any]) -> None:
    """Draw the mean return of each seed in a panel per set, against the behaviour's and the expert's."""
    import matplotlib.pyplot as plt

    found, names = grouped(lines), [name for name in LABELS if name != BEHAVIOUR]
    sets = list(dict.fromkeys(run.set for run in plan))
    starts = [[s for s in sets if s.startswith(f"siemens-offline/{kind}")] for kind in ("bad", "med", "opt")]
    starts += [[s for s in sets if s.startswith(("siemens-offline/glob", "neorl"))]]
    starts += [[s for s in sets if s.startswith("d4rl")]]
    figure, axes = plt.subplots(5, 5, figsize=(10, 10.5), sharex=True, sharey="row", layout="constrained")
    for line, row in zip(axes, starts, strict=True):
        for axis, name in zip(line, [*row, *[None] * (5 - len(row))], strict=True):
            if name is None:
                axis.set_visible(False)
                continue
            axis.axhline(references()["expert"] / 100, color="0.6", linestyle=":", label="expert")
            for each in found.get((name, BEHAVIOUR), []):
                axis.axhline((each.mean_return or np.nan) / 100, color="#bc4b51", label="behaviour")
            for i, algorithm in enumerate(names):
                values = [
                    x.mean_return for x in found.get((name, algorithm), []) if x.mean_return is not None
                ]
                axis.plot([i] * len(values), np.divide(values, 100), "o", color="#2a6f97", markersize=4)
            axis.set(title=name.replace("siemens-offline/", ""), xlim=(-0.6, len(names) - 0.4))
            axis.set_xticks(range(len(names)), [LABELS[x] for x in names], rotation=90, fontsize=7)
            axis.tick_params(labelbottom=True)
            axis.title.set_fontsize(9)
    axes[0, 0].legend(fontsize=7)
    done = sum(line.algorithm != BEHAVIOUR for line in lines)
    figure.suptitle(f"{done} of {sum(run.algorithm != BEHAVIOUR for run in plan)} runs", fontsize=9)
    figure.supylabel("mean return / 100 of each seed")
    figure.savefig(PICTURE, dpi=110)
