"""The runs of studies/prototypes.

`trained_on` names a part of a set: "10 episodes each" are 10 at each setpoint, "2 at 75" are 2 at
setpoint 75. "100 at 50 + 2 at 75" is learned together, "100 at 50, then 2 at 75" one after the other.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ibdata.evaluation.baselines import BEHAVIOUR, NOTHING

EACH, THEN = " each", ", then "
MODEL_BASED, MODEL, BLIND = "model-based", "model", " without setpoint"
SEEDS = (0, 1, 2)
SIZES = {"random": (1, 10, 100), "safe": (1, 10)}
FOUR = ["bc", "td3+bc", "iql", MODEL_BASED]
AGENTS = [*FOUR, "cql"]  # whose networks are shipped, of ten episodes each of the set random
SOURCE, TARGET, FEW = 50, 75, (1, 2, 5, 10)
SOURCES, TARGETS = tuple(range(10, 100, 10)), tuple(range(55, 105, 5))
WAYS = ("target", "source", "pooled", "fine-tuned")
OF_TRANSFER = [MODEL_BASED, "bc", "iql"]
BLIND_FEW = FEW[:2]
BEHAVIOURS = dict.fromkeys(["random", "transfer", "drifting", "random-paper", "setpoints/random"], "random")
BEHAVIOURS |= {"safe": "safe", "setpoints/expert": "expert"}  # the kinds of policies that made the sets
KNOWN: dict[str, Any] = {
    kind: {"kind": kind} for kind in ("random", "constant", "safe", "mediocre", "optimized", "expert")
}


class Run(NamedTuple):
    """A result to make: a known policy, or what an algorithm learns from data with a seed."""

    set: str
    trained_on: str
    algorithm: str
    seed: int | None

    @property
    def agent(self) -> str | None:
        """The name of its network, if that is shipped."""
        is_agent = self[:2] == ("random", episodes_each(10)) and self.algorithm in AGENTS
        return f"{self.set}-{self.algorithm.replace('+', '')}-{self.seed}" if is_agent else None

    def targets(self) -> list[float]:
        """The setpoints at which a run of the transfer is tried: all targets for what saw a source only."""
        last = float(self.trained_on.split(" at ")[-1])
        alone = self.trained_on in {f"100 at {source}" for source in SOURCES}
        return [float(p) for p in TARGETS if p != last] if alone else [last]


def stages(trained_on: str) -> list[str]:
    """The parts that are learned one after the other."""
    return trained_on.split(THEN)


def episodes_each(count: int) -> str:
    """The part with so many episodes at each setpoint."""
    return f"{count} episode{'s'[: count > 1]}{EACH}"


def part(way: str, count: int = 0) -> str:
    """What the transfer learns from, in one of the ways, with so many episodes of the target."""
    source, target = f"100 at {SOURCE}", f"{count} at {TARGET}"
    both = {"pooled": f"{source} + {target}", "fine-tuned": f"{source}{THEN}{target}"}
    return {"target": target, "source": source, **both}[way]


def plan() -> list[Run]:
    """All runs in their order, which makes a part of them useful."""
    runs = known_policies()
    for seed in SEEDS:
        runs += exploration(seed) + transfer(seed)
        runs += [Run(name, episodes_each(10), "cql", seed) for name in ("random", "safe")[: 1 + (seed == 0)]]
    runs += across()
    return list(dict.fromkeys(runs))


def known_policies() -> list[Run]:
    """The behaviour of each set, and the other known policies in its episodes."""
    return [
        Run(name, NOTHING, BEHAVIOUR if algorithm == behaviour else algorithm, None)
        for name, behaviour in BEHAVIOURS.items()
        for algorithm in KNOWN
    ]


def exploration(seed: int) -> list[Run]:
    """What is learned from random exploration and from safe behaviour."""
    runs = [
        Run(name, episodes_each(count), algorithm, seed)
        for name, counts in SIZES.items()
        for count in counts
        for algorithm in FOUR
    ]
    blind = [f"{algorithm}{BLIND}" for algorithm in ("iql", MODEL_BASED)]
    return runs + [Run("random", episodes_each(10), algorithm, seed) for algorithm in blind]


def transfer(seed: int) -> list[Run]:
    """From setpoint 50 to 75: learned from the target, the source, both together, and one after the other."""
    parts = [part(way, count) for way in WAYS for count in FEW]
    runs = [
        Run("transfer", data, algorithm, seed) for algorithm in OF_TRANSFER for data in dict.fromkeys(parts)
    ]
    return runs + [Run("transfer", part("pooled", count), f"iql{BLIND}", seed) for count in BLIND_FEW]


def across() -> list[Run]:
    """The map: between all sources and all targets, with two episodes of the target and one seed."""
    sources = [Run("transfer", f"100 at {source}", MODEL_BASED, 0) for source in SOURCES]
    targets = [Run("transfer", f"2 at {target}", MODEL, 0) for target in TARGETS]
    both = [
        Run("transfer", f"100 at {source}{THEN}2 at {target}", MODEL, 0)
        for source in SOURCES
        for target in TARGETS
        if source != target
    ]
    return sources + targets + both
