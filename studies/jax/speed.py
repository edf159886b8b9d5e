"""Print the speeds that README.md tells, in processor time of one processor. Needs the bridge jax.

studies/jax/speed.py [64]     64: float64, else float32
"""

import os
import platform
import sys
from functools import partial
from statistics import median
from time import process_time

import industrial_benchmark as ib
import jax
import numpy as np

from ibdata.dynamics import SIEMENS
from ibdata.environment import IndustrialBenchmarkVectorEnv

LANES, STEPS, ROUNDS = 10_000, 100, 9

os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # before JAX starts threads
jax.config.update("jax_enable_x64", sys.argv[1:] == ["64"])
k = SIEMENS.parameters
actions = np.random.default_rng(0).uniform(-1.0, 1.0, (STEPS, LANES, 3)).astype(np.float32)
envs = IndustrialBenchmarkVectorEnv(LANES, setpoint=70)
envs.reset(seed=0)
begun = jax.vmap(partial(ib.reset, k=k, setpoint=70.0))(jax.random.split(jax.random.key(0), LANES))


def move(state, inputs):
    key, action = inputs
    state = jax.vmap(partial(ib.step, k=k))(jax.random.split(key, LANES), state, action)
    return state, (jax.vmap(ib.observation)(state), state.reward)


@jax.jit
def episodes(key):
    return jax.lax.scan(move, begun, (jax.random.split(key, STEPS), actions))


def in_jax():
    jax.block_until_ready(episodes(jax.random.key(1)))


def in_the_environment():
    for action in actions:
        envs.step(action)


def seconds(run):
    before = process_time()
    run()
    return process_time() - before


runs = in_jax, in_the_environment
rounds = [[seconds(run) for run in runs] for _ in range(ROUNDS + 1)][1:]  # the first one compiles
speeds = [LANES * STEPS / median(times) / 1e6 for times in zip(*rounds, strict=True)]
print(
    f"{platform.machine()}, JAX {jax.__version__}, {begun.reward.dtype}, {LANES} lanes: "
    f"million steps a second {speeds[0]:.1f}, the vector environment {speeds[1]:.1f}, "
    f"ratio {speeds[0] / speeds[1]:.2f}"
)
