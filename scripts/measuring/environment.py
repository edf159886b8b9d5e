"""A step of the environment against the published package's, and of many lanes against one."""

import importlib.util
from importlib import import_module
from typing import Any

import numpy as np

from measuring.timing import Row, paired

LANES, STEPS, ROUNDS = 256, 500, 50


def environments() -> list[Row]:
    """All three in this process, taking turns; nothing without Gymnasium."""
    if not importlib.util.find_spec("gymnasium"):
        return []
    from ibdata.environment import IndustrialBenchmarkEnv, IndustrialBenchmarkVectorEnv

    vars(np)["float"] = float  # which the published package still uses
    theirs = import_module("industrial_benchmark_python.IDS").IDS(p=70, inital_seed=0)
    one, many = IndustrialBenchmarkEnv(setpoint=70), IndustrialBenchmarkVectorEnv(LANES, setpoint=70)
    one.reset(seed=0)
    many.reset(seed=0)
    actions = np.random.default_rng(0).uniform(-1, 1, (STEPS, LANES, 3)).astype(np.float32)
    few = STEPS // 10

    def loop(step: Any, actions: Any) -> None:
        for action in actions:
            step(action)

    seconds, package, lanes = paired(
        lambda: loop(one.step, actions[:, 0]),
        lambda: loop(theirs.step, actions[:few, 0]),
        lambda: loop(many.step, actions[:few]),
        times=ROUNDS,
    )
    mine, its, each = 1e6 * seconds / STEPS, 1e6 * package / few, 1e6 * lanes / few / LANES
    remark = f"{mine:.1f} µs with observation, reward and hidden state; its step {its:.1f}, without them"
    what = "steps a second of the environment, against the published package's"
    against_one = f"{mine / each:.1f} × the single environment"
    return [
        Row(what, f"{its / mine:.1f} ×", "", remark),
        Row(f"steps a second, {LANES} lanes", f"{1 / each:.2f} million", "≥ 4 million", against_one),
    ]
