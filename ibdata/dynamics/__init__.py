"""The equations of the Industrial Benchmark. `step` draws no random numbers: the caller passes them."""

from ibdata.dynamics.noise import Noise
from ibdata.dynamics.state import State, initial_state
from ibdata.dynamics.step import step
from ibdata.dynamics.variants import PAPER, SIEMENS, VARIANTS, Variant

__all__ = ["PAPER", "SIEMENS", "VARIANTS", "Noise", "State", "Variant", "initial_state", "step"]
