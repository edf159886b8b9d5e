"""The tables of docs/prototypes.md and docs/prototypes.json, from the runs of studies/prototypes."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ibdata.evaluation.baselines import BEHAVIOUR, Baseline
from measuring.documents import DOCS, replaced, table
from training import formulas, setpoint_map
from training.plan import (
    BLIND,
    BLIND_FEW,
    FEW,
    FOUR,
    KNOWN,
    MODEL_BASED,
    OF_TRANSFER,
    SIZES,
    TARGET,
    WAYS,
    episodes_each,
    part,
)
from training.protocol import AFTER_BURN_IN, AT_TEN, EVALUATIONS, LONG_AT_TEN, TEN
from training.results import Results, Settings, difference, means, number, over_seeds, shown, with_error

PAGE = DOCS / "prototypes.md"
MEASURED = DOCS / "prototypes.json"  # what the page says besides the runs
LABELS = {"bc": "BC", "td3+bc": "TD3+BC", "iql": "IQL", "cql": "CQL", MODEL_BASED: MODEL_BASED}
LABELS |= {f"{name}{BLIND}": f"{LABELS[name]}{BLIND}" for name in ("iql", MODEL_BASED)}
LABELS |= {name: f"`{name}`" for name in KNOWN}
LEARNED = [*FOUR, "cql", *(name for name in LABELS if name.endswith(BLIND))]
# The evaluations of a policy at ten setpoints, and by what their returns are divided.
COLUMNS: dict[str, tuple[Settings, float]] = {
    "from the default start": (AT_TEN, 100.0),
    "after a random burn-in": (AFTER_BURN_IN, 100.0),
    "a step, over 1,000": (LONG_AT_TEN, 1000.0),
}
# Rewards of a step at setpoint 70 over 1,000 steps, as others report them.
PUBLISHED = [
    ("selected in a study of 2026", "NeoRL's medium set", "−220.1 ± 1.7"),
    ("best of that study", "NeoRL's medium set", "−216.3 ± 2.8"),
    ("an offline method", "–", "−188.7"),
    ("PPO", "the benchmark itself", "−185.2"),
    ("tabular Q-learning", "the benchmark itself", "−181.5"),
]
# What the tables show that are beside the page, in its data.
ABOUT = {
    "random by setpoint": (
        "Mean returns / 100 from the default start, with ten random episodes at each of ten setpoints, "
        "over the seeds. The last row has the largest difference between two seeds at a setpoint."
    ),
    "formulas": (
        "Formulas for all ten setpoints that were published; complexity is the size of a formula, and that "
        "of 21 is `optimized`. Ours are means / 100 of 2,000 paired episodes a setpoint. The longer "
        "formulas are not better. All five published returns are lower than ours; if they are of one "
        "episode a setpoint, which is not said, it is by 0.2 to 2.5 of their errors, and their order shows "
        "nothing."
    ),
    "safe above behaviour": (
        "The difference / 100 from the safe behaviour, paired by episodes, with the standard error over the "
        "episodes. `setpoints below` counts those of the ten at which the mean over the seeds is below it "
        "from the default start, by more than two errors; `worst` is the lowest difference."
    ),
    "transfer models": "Root mean square errors of models over 20 other episodes at setpoint 75.",
    "map": (
        "With one seed, models were learned from 100 episodes at each source and tried at each target. "
        "First the rank correlations of their errors after ten steps, and of the reference scores of the "
        "model-based policies, with the distance of the setpoints and with the dissimilarity after ten "
        "steps. Which one predicts better is not shown: with the nine sources drawn again, that of "
        "consumption has between 0.02 less and 0.08 more than the distance (95 %). The rank correlation of "
        "the scores with the source alone is 0.88, but one seed cannot tell a source from luck. Then the "
        "consumption error of a model that saw two episodes of the target after the source, divided by that "
        "of a model that saw these two alone: below 1, the source helps. In 84 of 86 pairs it does; each "
        "column hangs on one model of the target alone."
    ),
    "at 70": (
        "Rewards of a step at setpoint 70 over 1,000 steps, as others publish them, and ours of 20 "
        "episodes. The first two are of github.com/LuciferTGQ/PAI, with standard deviations over ten and "
        "five seeds; of the others we know no source, and little of their data, discounts and episodes. The "
        "best of several seeds, sizes and sets is shown, which flatters an algorithm. One of three seeds of "
        "IQL is above `optimized`."
    ),
}
HORIZONS, QUANTITIES = (1, 10), ("fatigue", "consumption")
MIDDLE = episodes_each(10)
CLEARLY = 2.0  # standard errors by which a difference is counted


def learned_parts(results: Results, name: str) -> list[tuple[str, str]]:
    """The parts of a set and the algorithms that learned from them."""
    parts = [(episodes_each(count), algorithm) for count in SIZES[name] for algorithm in LEARNED]
    return [pair for pair in parts if results.runs(name, *pair)]


def returns_table(results: Results, name: str) -> str:
    """A Markdown table of the returns over ten setpoints, with known policies in that of the first set."""
    rows = []
    for policy in KNOWN if name == "random" else [name]:
        cells = [with_error(results.known(name, policy, settings), by) for settings, by in COLUMNS.values()]
        rows.append(["–", LABELS[policy], "–", *cells])
    for data, algorithm in learned_parts(results, name):
        cells = [
            over_seeds(means(results.returns(name, data, algorithm, settings), by))
            for settings, by in COLUMNS.values()
        ]
        rows.append([data, LABELS[algorithm], str(len(results.runs(name, data, algorithm))), *cells])
    worst = [
        max(results.standard_errors(name, settings), default=0.0) / by for settings, by in COLUMNS.values()
    ]
    errors = " / ".join(number(error, 2) for error in worst)
    return f"""{table(["trained on", "policy", "seeds", *COLUMNS], rows)}

Standard errors over the episodes of what was learned are at most {errors}."""


def by_setpoint(results: Results, name: str, policies: Sequence[str]) -> str:
    """A Markdown table with a row a setpoint, of what was learned from ten episodes at each.

    Its last row has the largest difference between two seeds at a setpoint.
    """
    algorithms = [algorithm for data, algorithm in learned_parts(results, name) if data == MIDDLE]
    known = {policy: results.known(name, policy, AT_TEN) for policy in policies}
    learned = {x: results.returns(name, MIDDLE, x, AT_TEN) for x in algorithms}
    rows = []
    for i, setpoint in enumerate(TEN):
        cells = [number(values[i].mean() / 100.0) for values in known.values()]
        cells += [number(float(np.mean(seeds, axis=0)[i].mean()) / 100.0) for seeds in learned.values()]
        rows.append([f"{setpoint:g}", *cells])
    apart = [np.ptp(np.mean(seeds, axis=2), axis=0).max() / 100.0 for seeds in learned.values()]
    cells = [number(x) if x else "–" for x in apart]
    rows.append(["seeds", *("–" for _ in known), *cells])
    return table(["p", *(LABELS[x] for x in (*known, *learned))], rows)


def above_behaviour(results: Results) -> str:
    """A Markdown table of the paired differences from the safe policy, at each setpoint and over all."""
    runs = [(episodes_each(count), algorithm) for count in SIZES["safe"] for algorithm in (*FOUR, "cql")]
    runs = [pair for pair in runs if results.runs("safe", *pair)]
    rows = []
    for data, algorithm in runs:
        cells = []
        for settings in (AT_TEN, AFTER_BURN_IN):
            base = results.known("safe", BEHAVIOUR, settings)
            cells.append(shown(difference(results.returns("safe", data, algorithm, settings), base)))
        base = results.known("safe", BEHAVIOUR, AT_TEN)
        seeds = results.returns("safe", data, algorithm, AT_TEN)
        gains = [difference([x[i : i + 1] for x in seeds], base[i : i + 1]) for i in range(len(TEN))]
        below = sum(gain.mean < -CLEARLY * (gain.standard_error or 0.0) for gain in gains)
        worst = min(range(len(TEN)), key=lambda i: gains[i].mean)
        rows.append([data, LABELS[algorithm], *cells, below, f"{shown(gains[worst])} at {TEN[worst]:g}"])
    starts = list(COLUMNS)[:2]
    head = ["trained on", "policy", *starts, "setpoints below", "worst"]
    return table(head, rows)


def model_table(results: Results) -> str:
    """A Markdown table of the errors of models at the target, by what they were trained on."""
    rows = []
    for way in WAYS:
        for count in FEW if way != "source" else (0,):
            data = part(way, count)
            cells = []
            for quantity in QUANTITIES:
                for steps in HORIZONS:
                    errors = results.errors(data, MODEL_BASED, float(TARGET), steps)
                    cells.append(over_seeds([getattr(e, quantity) for e in errors]))
            rows.append([data, len(results.runs("transfer", data, MODEL_BASED)), *cells])
    floors = [
        getattr(
            results.errors(part("target", FEW[0]), MODEL_BASED, float(TARGET), steps)[0], f"floor_{quantity}"
        )
        for quantity in QUANTITIES
        for steps in HORIZONS
    ]
    rows.append(["noise floor", "–", *map(number, floors)])
    names = [f"{q}, {h} step{'s'[: h > 1]}" for q in QUANTITIES for h in HORIZONS]
    return table(["trained on", "seeds", *names], rows)


def transfer_table(results: Results) -> str:
    """A Markdown table of the returns at the target, by what the policies were trained on."""
    [settings] = EVALUATIONS["transfer"]
    rows = [["–", "–", with_error(results.known("transfer", x, settings)), LABELS[x]] for x in KNOWN]
    known = table(["policy", "return"], [[label, value] for _, _, value, label in rows])
    learned = []
    for way in WAYS:
        for count in FEW if way != "source" else (0,):
            data = part(way, count)
            cells = [over_seeds(means(results.returns("transfer", data, x, settings))) for x in OF_TRANSFER]
            learned.append([data, len(results.runs("transfer", data, MODEL_BASED)), *cells])
    for count in BLIND_FEW:
        data = part("pooled", count)
        blind = means(results.returns("transfer", data, f"iql{BLIND}", settings))
        learned.append([f"{data}{BLIND}", len(blind), "–", "–", over_seeds(blind)])
    head = ["trained on", "seeds", *(LABELS[x] for x in OF_TRANSFER)]
    worst = number(max(results.standard_errors("transfer", settings), default=0.0) / 100.0, 2)
    return f"""{known}

{table(head, learned)}

Standard errors over the episodes of what was learned are at most {worst}."""


def best_at_70(results: Results) -> str:
    """A Markdown table of the rewards of a step at setpoint 70 over 1,000 steps: ours, best runs."""
    at = TEN.index(70.0)
    rows = [[f"published: {name}", data, reward] for name, data, reward in PUBLISHED]
    parts = [(name, episodes_each(count)) for name, counts in SIZES.items() for count in counts]
    for policy in KNOWN:
        returns = results.known("random", policy, LONG_AT_TEN)[at : at + 1]
        rows.append([LABELS[policy], "–", with_error(returns, 1000.0)])
    for algorithm in LEARNED[: len(FOUR) + 1]:
        seeds = [
            (f"`{name}`, {data}", values[at : at + 1])
            for name, data in parts
            for values in results.returns(name, data, algorithm, LONG_AT_TEN)
        ]
        if not seeds:
            continue
        data, values = max(seeds, key=lambda pair: float(pair[1].mean()))
        rows.append([f"{LABELS[algorithm]}, best of {len(seeds)} runs", data, with_error(values, 1000.0)])
    return table(["policy", "trained on", "reward of a step"], rows)


def blocks(lines: Iterable[Baseline]) -> dict[str, str]:
    """What the page shows between each pair of its markers."""
    results = Results(lines)
    return {
        "random": returns_table(results, "random"),
        "safe": returns_table(results, "safe"),
        "transfer returns": transfer_table(results),
    }


def beside(lines: Iterable[Baseline], measured: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The tables that only few need, as lines of Markdown, each with what it shows."""
    results = Results(lines)
    tables = {
        "random by setpoint": by_setpoint(results, "random", ("random", "constant", "optimized", "expert")),
        "formulas": formulas.table_of(measured["formulas"]),
        "safe above behaviour": above_behaviour(results),
        "transfer models": model_table(results),
        "map": setpoint_map.table_of(results, measured["distances"]),
        "at 70": best_at_70(results),
    }
    return {name: {"about": ABOUT[name], "table": text.splitlines()} for name, text in tables.items()}


def write_page(lines: Sequence[Baseline]) -> dict[str, Any]:
    """Measure what is no run, write the tables, and return what was measured."""
    measured = {"formulas": formulas.measure(), "distances": setpoint_map.distances()}
    measured["tables"] = beside(lines, measured)
    MEASURED.write_text(json.dumps(measured, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    text = PAGE.read_text(encoding="utf-8")
    for kind, block in blocks(lines).items():
        text = replaced(text, f"\n{block}\n", kind)
    PAGE.write_text(text, encoding="utf-8")
    return measured
