"""The Industrial Benchmark: `step` draws nothing, so any noise can be fed to it."""

from ibdata.dynamics.state import Noise, State, initial_state
from ibdata.dynamics.step import step
from ibdata.dynamics.variants import PAPER, SIEMENS, VARIANTS, Variant

__all__ = ["PAPER", "SIEMENS", "VARIANTS", "Noise", "State", "Variant", "initial_state", "step"]
