"""The tables of docs/baselines.md."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

import ibdata
from ibdata._numerics.confidence import mean_estimate
from ibdata.dataset.reference_returns import scale
from ibdata.evaluation.algorithms import LineReturns, estimated
from ibdata.evaluation.baselines import BEHAVIOUR, WHOLE, Baseline, Evaluated
from measuring.documents import DOCS, table, write_measured
from training.protocol import LITERATURE
from training.selection import rank_correlation

REFERENCES = {"random": "`random`", "constant": "no change at any step"}
REFERENCES |= {"optimized": "`optimized`", "expert": "`expert`"}
FORMULAS = ("bad", "mediocre", "optimized")
SUITES = ("siemens-offline", "d4rl-like", "neorl-like")
FOUR, TWO, MODEL = ["bc", "td3+bc", "iql", "cql"], ["bcq", "bear"], "model-based"
LABELS = {BEHAVIOUR: "behaviour", **{name: name.upper() for name in FOUR + TWO}}
LABELS |= {"cql-50": "CQL of weight 50", MODEL: MODEL}
Key = tuple[str, str]  # a set and an algorithm
Floats = npt.NDArray[np.float64]
BOTH = {"td3+bc": "TD3+BC", "cql": "CQL", "bcq": "BCQ", "bear": "BEAR"}
FEWEST = 5  # sets for a rank correlation


def grouped(lines: Sequence[Baseline]) -> dict[Key, list[Baseline]]:
    """The results of all seeds of a set and an algorithm."""
    groups: dict[Key, list[Baseline]] = {}
    for line in lines:
        groups.setdefault((line.set, line.algorithm), []).append(line)
    return groups


def evaluation(line: Baseline) -> Evaluated:
    """The only evaluation of a run."""
    [only] = line.evaluations
    return only


def returns_of(line: Baseline) -> Floats | None:
    """The returns (episodes,) of a run."""
    values = evaluation(line).values
    return None if values is None else values[0]


def mean_of(line: Baseline) -> float | None:
    """The mean return of a run."""
    return evaluation(line).mean_return


def references() -> dict[str, float]:
    """The returns of known policies in 10,000 episodes."""
    known = scale(*(LITERATURE[name] for name in ("dynamics", "start", "steps", "discount")))
    assert known is not None
    return {
        row.policy: row.mean_return
        for row in known.results
        if row.policy in REFERENCES and row.setpoint == LITERATURE["setpoint"]
    }


def cell(lines: Sequence[Baseline]) -> str:
    """The mean over seeds, in hundreds."""
    values = [mean / 100 for mean in map(mean_of, lines) if mean is not None]
    failed = len(lines) - len(values)
    parts = [f"{np.mean(values):.1f}".replace("-", "−")] if values else []
    parts += [f"{failed} failed"] if failed else []
    return " ".join(parts) or "–"


def clearly_best(of_row: Mapping[str, Sequence[Baseline]]) -> str | None:
    """The algorithm or the behaviour that is better than each other one by the interval of the difference.

    The interval is for new trainings and new episodes. What has one seed has none, and is left out.
    """
    groups = []
    for algorithm, lines in of_row.items():
        returns = [values for line in lines for values in [evaluation(line).values] if values is not None]
        if algorithm == BEHAVIOUR or len(returns) > 1:
            groups.append(LineReturns(algorithm, WHOLE, algorithm != BEHAVIOUR, np.array(returns)))
    best, *others = sorted(groups, key=lambda group: -group.returns.mean())
    intervals = [estimated(best, other).interval for other in others]
    is_clear = all(interval is not None and interval[0] > 0.0 for interval in intervals)
    return best.label if is_clear else None


def results(lines: Sequence[Baseline], sets: Sequence[str], algorithms: Sequence[str]) -> str:
    """A Markdown table with a row per set."""
    groups = grouped(lines)
    rows = []
    for name in sets:
        of_row = {algorithm: groups.get((name, algorithm), []) for algorithm in algorithms}
        cells = {algorithm: cell(of_cell) for algorithm, of_cell in of_row.items()}
        if (best := clearly_best(of_row)) is not None:
            cells[best] = f"**{cells[best]}**"
        rows.append((f"`{name}`", *cells.values()))
    return table(("set", *(LABELS[algorithm] for algorithm in algorithms)), rows)


def behaviours(lines: Sequence[Baseline]) -> dict[str, Floats]:
    """The returns of the behaviour of each set."""
    returns = {line.set: returns_of(line) for line in lines if line.algorithm == BEHAVIOUR}
    return {name: values for name, values in returns.items() if values is not None}


def formulas(lines: Sequence[Baseline]) -> dict[str, Floats]:
    """The returns of the formula of each set that has one, without the set's random actions."""
    known = behaviours(lines)
    pure = {kind: known.get(f"siemens-offline/{kind}-0") for kind in FORMULAS}
    sets = {name: pure.get(name.removeprefix("siemens-offline/").partition("-")[0]) for name in known}
    return {name: values for name, values in sets.items() if values is not None}


def verdict(line: Baseline, base: Floats) -> int:
    """0 if a run's return is higher than another policy's, 1 if no difference is seen, 2 if it is lower.

    By the 95 % interval of the mean of the paired differences; a policy that failed counts as lower.
    """
    values = returns_of(line)
    if values is None:
        return 2
    low, high = mean_estimate([values - base]).interval or (-1.0, 1.0)
    return 0 if low > 0 else 2 if high < 0 else 1


def algorithms(lines: Sequence[Baseline]) -> str:
    """A Markdown table of the time of the algorithms, and of their runs beside behaviours and formulas."""
    base, pure = behaviours(lines), formulas(lines)
    rows = []
    for name, label in LABELS.items():
        runs = [line for line in lines if line.algorithm == name and name != BEHAVIOUR]
        groups = [[verdict(line, base[line.set]) for line in runs if line.set in base]]
        for kind in FORMULAS:
            sets = [line for line in runs if line.set.startswith(f"siemens-offline/{kind}-")]
            groups.append([verdict(line, pure[line.set]) for line in sets if line.set in pure])
        if runs:
            seconds = float(np.median([line.cpu_seconds for line in runs]))
            cells = (" / ".join(str(group.count(k)) for k in range(3)) if group else "–" for group in groups)
            rows.append((label, len(runs), f"{seconds:.0f}", *cells))
    return table(("algorithm", "runs", "CPU seconds", "behaviour", *(f"`{kind}`" for kind in FORMULAS)), rows)


def worst_error(lines: Iterable[Baseline]) -> str:
    """The greatest standard error, in hundreds."""
    return f"{max((evaluation(line).standard_error or 0.0 for line in lines), default=0.0) / 100:.2f}"


def shown(value: float) -> str:
    """A return in hundreds."""
    return f"{value / 100:.1f}".replace("-", "−")


def comparison() -> str:
    """A Markdown table of the algorithms that the literature has, too, and of CQL-50 beside CQL."""
    known = ibdata.baselines(published=True)
    ours = ibdata.baselines()
    fixed = ours[ours["algorithm"] == "cql-50"].set_index("set")["p10"]
    rows = []
    for name, label in BOTH.items():
        runs = known[known["algorithm"] == name].set_index("set")
        rows.append(_compared(label, runs["p10"], runs["published_p10"]))
        if name == "cql":
            rows.append(_compared("CQL of weight 50", fixed, runs["published_p10"]))
    head = ["algorithm", "sets", "rank correlation", "median distance"]
    return table([*head, "lowest", "highest"], rows)


def _compared(label: str, ours: pd.Series, published: pd.Series) -> list[Any]:
    """A row of the table, of the sets that both have."""
    both = pd.DataFrame({"ours": ours, "published": published}).dropna()
    differences = both["ours"] - both["published"]
    rank = "–"
    if len(both) >= FEWEST:
        correlation = rank_correlation(both["published"].to_numpy(), both["ours"].to_numpy())
        rank = f"{correlation:.2f}".replace("-", "−")
    values = (differences.abs().median(), differences.min(), differences.max())
    return [label, len(both), rank, *(shown(x) for x in values)]


def block(lines: Sequence[Baseline], plan: Sequence[Any]) -> str:
    """All that the page says of results."""
    runs = [run for run in plan if run.algorithm != BEHAVIOUR]
    done = [line for line in lines if line.algorithm != BEHAVIOUR]
    ordered = sorted(references().items(), key=lambda pair: pair[1])
    known = ", ".join(f"{REFERENCES[name]} {value / 100:.1f}".replace("-", "−") for name, value in ordered)
    by_suite = {
        suite: list(dict.fromkeys(run.set for run in plan if run.set.startswith(f"{suite}/")))
        for suite in SUITES
    }
    others = list(dict.fromkeys(run.set for run in runs if run.algorithm in TWO))
    errors = (worst_error(done), worst_error(line for line in lines if line.algorithm == BEHAVIOUR))
    parts = [
        f"{len(done)} of {len(runs)} runs are done; – stands for what was not run. Standard errors over "
        f"the 200 episodes are at most {errors[0]} for what was trained, {errors[1]} for behaviours. "
        f"Reference returns are means of 10,000 episodes: {known}. "
        "The best of a row is in bold if the 95 % intervals of its differences, for new trainings and new "
        "episodes, show that it is better than every other algorithm of the row and than the behaviour. "
        "Algorithms with one seed have no interval and are left out.",
        results(lines, [name for sets in by_suite.values() for name in sets], [BEHAVIOUR, *FOUR, MODEL]),
        results(lines, others, [BEHAVIOUR, *TWO]),
        "### Compared with the behaviour",
        "The last four columns count runs: those that are higher / not seen to differ / lower, by the 95 % "
        "interval of the paired differences. The column *behaviour* compares with the policy that made the "
        "data, the others with its formula without random actions. CPU seconds are the median of a training.",
        algorithms(lines),
        "### Compared with the literature",
        "The table compares 10th percentiles. Distances are ours minus the published ones. The rank "
        "correlation is that of the sets, ranked by our percentiles and by theirs.",
        comparison(),
    ]
    return "\n\n".join(parts)


def write_page(lines: Sequence[Baseline], plan: Sequence[Any]) -> None:
    """Write the tables."""
    write_measured(DOCS / "baselines.md", f"\n{block(lines, plan)}\n")
