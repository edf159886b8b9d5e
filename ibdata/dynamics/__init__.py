"""The Industrial Benchmark: `step` draws nothing, so any noise can be fed to it."""

from ibdata.dynamics.step import Noise, State, initial_state, step
from ibdata.dynamics.variants import PAPER, SIEMENS, VARIANTS, Variant

__all__ = ["PAPER", "SIEMENS", "VARIANTS", "Noise", "State", "Variant", "initial_state", "step"]
