"""The numbers in the sentences of pages, from the stored results; `scripts/reference` fills them in."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np

import ibdata
from ibdata.dataset.reference_returns import scale
from ibdata.dynamics import PAPER, SIEMENS
from ibdata.dynamics.consumption import PENALTY_WEIGHT, operational_cost
from ibdata.dynamics.miscalibration import ALPHA, BETA, SAFE_ZONE, penalty
from ibdata.evaluation.baselines import BEHAVIOUR, FILE, NOTHING, PROTOTYPES, shipped_baselines
from measuring.documents import DOCS
from training import baselines_page, selection
from training.plan import (
    BLIND,
    BLIND_FEW,
    FEW,
    FOUR,
    MODEL_BASED,
    OF_TRANSFER,
    TARGET,
    WAYS,
    episodes_each,
    part,
)
from training.protocol import EVALUATIONS
from training.prototypes_page import COLUMNS
from training.results import Results, difference, means

Numbers = dict[str, float]
START, _, LONG = COLUMNS.values()
[AT_TARGET] = EVALUATIONS["transfer"]


def numbers() -> dict[str, Numbers]:
    """By page, the numbers by the names that stand behind them in its text."""
    results = Results(shipped_baselines([PROTOTYPES]))
    prototypes = {**exploration(results), **safe(results), **transfer(results)}
    iql = results.returns("safe", episodes_each(10), "iql", START[0])
    return {
        "README.md": {
            "random-cql": prototypes["random-cql"],
            "safe-iql": float(np.mean(means(iql))),
            "optimized": prototypes["optimized"],
        },
        "docs/prototypes.md": prototypes,
        "docs/write-a-paper.md": seeds_of_iql(results),
        "docs/baselines.md": baselines(),
        "docs/quality.md": {**quality(), **world_models()},
        "docs/errata.md": errata(),
        "docs/views.md": views(),
        "studies/selection.md": {"lowest-rank": lowest_rank()},
    }


def exploration(results: Results) -> Numbers:
    """What is learned from random exploration at ten setpoints."""
    few, middle = (episodes_each(count) for count in (1, 10))

    def mean(data: str, algorithm: str, column: Any = START) -> float:
        return float(np.mean(means(results.returns("random", data, algorithm, column[0]), column[1])))

    gains = [mean(middle, name, LONG) - mean(few, name, LONG) for name in FOUR]
    blind = [mean(middle, "iql", x) - mean(middle, f"iql{BLIND}", x) for x in COLUMNS.values()]
    return {
        "optimized": results.known("random", "optimized", START[0]).mean() / START[1],
        "random-cql": mean(middle, "cql"),
        "gain-low": min(gains),
        "gain-high": max(gains),
        **dict(zip(("blind-start", "blind-burn-in", "blind-long"), blind, strict=True)),
    }


def safe(results: Results) -> Numbers:
    """How much better than safe behaviour is what was learned from it."""
    base = results.known("safe", BEHAVIOUR, START[0])
    found: Numbers = {}
    for name in ("iql", "bc"):
        better = difference(results.returns("safe", episodes_each(10), name, START[0]), base)
        found |= {f"safe-{name}-gain": better.mean, f"safe-{name}-error": better.standard_error or math.nan}
    return found


def transfer(results: Results) -> Numbers:
    """What is learned from setpoint 50 and a few episodes at 75."""
    parts = [part(way, count) for way in WAYS for count in (FEW if way != "source" else (0,))]
    seeds = {
        (data, name): means(results.returns("transfer", data, name, AT_TARGET))
        for data in parts
        for name in OF_TRANSFER
    }
    blind = {
        count: means(results.returns("transfer", part("pooled", count), f"iql{BLIND}", AT_TARGET))
        for count in BLIND_FEW
    }
    mean = {key: float(np.mean(values)) for key, values in seeds.items()}
    of_models = {data: mean[data, MODEL_BASED] for data in parts}
    pooled = [of_models[part("pooled", count)] for count in FEW]
    known = {
        name: float(results.known("transfer", name, AT_TARGET).mean() / 100)
        for name in ("constant", "optimized")
    }

    def consumption(data: str) -> float:
        errors = results.errors(data, MODEL_BASED, float(TARGET), 10)
        return float(np.mean([each.consumption for each in errors]))

    return {
        "at-75-optimized": known["optimized"],
        "at-75-constant": known["constant"],
        "at-75-best": max(mean.values()),
        "entries": len(seeds) + len(blind),
        "below": sum(max(x) < known["constant"] for x in [*seeds.values(), *blind.values()]),
        "above": sum(min(x) > known["constant"] for x in [*seeds.values(), *blind.values()]),
        "both-1": of_models[part("pooled", 1)],
        **{f"alone-{count}": of_models[part("target", count)] for count in (1, 5, 10)},
        "alone-rise": of_models[part("target", 10)] - of_models[part("target", 1)],
        "after-rise": of_models[part("fine-tuned", 10)] - of_models[part("fine-tuned", 1)],
        "both-spread": max(pooled) - min(pooled),
        "iql-source": mean[part("source"), "iql"],
        "iql-both-1": mean[part("pooled", 1), "iql"],
        "iql-blind-1": float(np.mean(blind[1])),
        "error-source": consumption(part("source")),
        "error-after-1": consumption(part("fine-tuned", 1)),
    }


def seeds_of_iql(results: Results) -> Numbers:
    """How far the seeds of IQL are apart in the transfer, beside the errors over the episodes."""
    found = means(results.returns("transfer", part("pooled", 2), "iql", AT_TARGET))
    error = max(results.standard_errors("transfer", AT_TARGET)) / 100
    return {"error": error, "lowest": min(found), "highest": max(found)}


def baselines() -> Numbers:
    """The returns of offline algorithms on shipped sets."""
    lines = shipped_baselines([FILE])
    runs = ibdata.baselines().assign(mean=lambda x: x["mean_return"] / 100)
    runs = runs[runs["set"].isin({line.set for line in lines}) & runs["trained_on"].ne(NOTHING)]
    mean = runs.groupby(["set", "algorithm"])["mean"].mean()
    references = {name: value / 100 for name, value in baselines_page.references().items()}

    def of(name: str, algorithm: str) -> float:
        return float(mean[f"siemens-offline/{name}", algorithm])

    four = mean.unstack()[baselines_page.FOUR].dropna()
    compared = (BEHAVIOUR, *baselines_page.FOUR, MODEL_BASED)
    groups = baselines_page.grouped(lines)
    by_set = {name: {x: groups.get((name, x), []) for x in compared} for name in four.index}
    best = four.idxmax(axis=1).value_counts()
    bcq = runs[runs["set"].eq("siemens-offline/bad-40") & runs["algorithm"].eq("bcq")]["mean"]
    of_optimized = runs["set"].str.startswith("siemens-offline/optimized-")
    on_optimized = runs[of_optimized & runs["algorithm"].ne(BEHAVIOUR)]["mean"]
    published = ibdata.baselines(published=True)
    published["set"] = published["set"].str.partition("/")[2]
    distance = published.pivot(index="set", columns="algorithm", values="difference") / 100
    theirs = published.pivot(index="set", columns="algorithm", values="published_p10")
    models = theirs[["moose", "wsbc", "mopo", "morel"]]
    td3_bc = distance.loc[["bad-20", "bad-40", "bad-60"], "td3+bc"]
    cql = distance.loc[["bad-20", "bad-40", "bad-60", "bad-80"], "cql"]
    return {
        "constant": references["constant"],
        "expert": references["expert"],
        "sets": len(four),
        "clear": sum(baselines_page.clearly_best(of_set) is not None for of_set in by_set.values()),
        "best-iql": best["iql"],
        "best-cql": best["cql"],
        "bad-0-cql": of("bad-0", "cql"),
        "bad-0-model": of("bad-0", MODEL_BASED),
        "bad-20-iql": of("bad-20", "iql"),
        "bad-20-behaviour": of("bad-20", BEHAVIOUR),
        "bcq-low": bcq.min(),
        "bcq-high": bcq.max(),
        "on-optimized": len(on_optimized),
        "above-optimized": (on_optimized > references["optimized"]).sum(),
        "td3+bc-distance": distance["td3+bc"].abs().median(),
        "td3+bc-low": td3_bc.min(),
        "td3+bc-high": td3_bc.max(),
        "cql-low": cql.min(),
        "cql-high": cql.max(),
        "cql-bad-0": -distance["cql"]["bad-0"],
        "models-best": (models.max(axis=1) == theirs.max(axis=1)).sum(),
        "models-worst": (models.min(axis=1) == theirs.min(axis=1)).sum(),
    }


def quality() -> Numbers:
    """Measures of shipped sets."""
    measures, sets = (json.loads((DOCS / f"{name}.json").read_text()) for name in ("quality", "canonical"))
    known = scale("siemens", "default", 1000, 1.0, drifting=True)
    assert known is not None
    ends = known.ends([10, 30, 50, 70, 90], "expert")
    assert ends is not None
    return {
        "bad-0-pairs": measures["siemens-offline/bad-0"]["pairs"],
        "mediocre-0-pairs": measures["siemens-offline/mediocre-0"]["pairs"],
        "optimized-0-stochasticity": measures["siemens-offline/optimized-0"]["action_stochasticity"],
        "drifting": measures["drifting"]["trajectory_quality"],
        "drifting-error": sets["drifting"]["standard_error"] / (ends[1] - ends[0]),
    }


def world_models() -> Numbers:
    """Errors of models of the dynamics, divided by those of the noise floor."""
    models = json.loads((DOCS / "world-models.json").read_text())

    def over(name: str, steps: int, model: str, quantity: int) -> float:
        found = models[f"siemens-offline/{name}"][str(steps)]
        errors = (found[key]["root_mean_square"][quantity] for key in (model, "noise floor"))
        return float(np.divide(*errors))

    fatigue, consumption = 0, 1
    return {
        "optimized-40-fatigue": 100 * (over("optimized-40", 1, "network", fatigue) - 1),
        "global-100-fatigue-1": 100 * (over("global-100", 1, "network", fatigue) - 1),
        "global-100-fatigue-10": 100 * (over("global-100", 10, "network", fatigue) - 1),
        "global-100-1": over("global-100", 1, "network", consumption),
        "optimized-40-1": over("optimized-40", 1, "network", consumption),
        "global-100-ridge-10": over("global-100", 10, "ridge regression", consumption),
        "global-100-network-10": over("global-100", 10, "network", consumption),
    }


def views() -> Numbers:
    """The returns of IQL with other views of the same data."""
    returns = json.loads((DOCS / "figures/views.json").read_text())["returns"]
    mean = {view: np.mean([seed["return"] for seed in seeds.values()]) for view, seeds in returns.items()}
    whole = mean.pop("markov, 1 frame")
    return {"whole": whole, "lowest": min(mean.values()), "highest": max(mean.values())}


def lowest_rank() -> float:
    """The lowest rank correlation of the learned model with the true values, over the sets."""
    text = (DOCS.parent / "studies/policy-selection.jsonl").read_text()
    lines = [selection.Line.model_validate_json(line) for line in text.splitlines()]
    ranks = []
    for name in {line.set for line in lines}:
        of_set = selection.of(lines, name)
        estimates = selection.estimates_of(of_set, "model")
        assert estimates is not None
        ranks.append(selection.rank_correlation(selection.values_of(of_set), estimates))
    return min(ranks)


def errata() -> Numbers:
    """What the equations of both variants give."""
    eta = np.tanh(-0.05 * np.log((np.arange(100_000) + 0.5) / 100_000))

    def rho(he: float) -> float:
        """The consumption at φ = 0 minus that with the printed ϱ, by which ω is hᵉ."""
        return PENALTY_WEIGHT * (penalty(0, he) - (BETA * he**4 - ALPHA * he**2))

    return {
        "eta-mean": eta.mean(),
        "mu-12": 5 / 3 * (1 - 0.9**12),
        "mu-13": 5 / 3 * (1 - 0.9**13),
        "growth": math.log(5 / 1.2) / math.log(1.1),
        "z": SAFE_ZONE,
        "z-printed": math.radians(15) / 2,
        "theta": operational_cost(100.0, 100.0, 100.0),
        "weights": sum(SIEMENS.convolution_weights),
        "noise-code": 1 + SIEMENS.consumption_noise * 250,
        "noise-paper": 1 + PAPER.consumption_noise * 250,
        "noise-offset": 25 * SIEMENS.consumption_noise,
        "rho-z": rho(SAFE_ZONE),
        "2z": 2 * SAFE_ZONE,
        "rho-2z": rho(2 * SAFE_ZONE),
        "rho-1.5": rho(1.5),
    }
