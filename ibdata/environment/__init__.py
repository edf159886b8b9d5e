"""The Industrial Benchmark as a Gymnasium environment, and many of them at once as a vector environment.

`gymnasium.make("ibdata/IndustrialBenchmark-v0", setpoint=70)` after `import ibdata`, or
`gymnasium.make("ibdata:ibdata/IndustrialBenchmark-v0", setpoint=70)`. Needs the extra `gymnasium`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ibdata.environment.single import IndustrialBenchmarkEnv
    from ibdata.environment.vector import IndustrialBenchmarkVectorEnv

__all__ = ["IndustrialBenchmarkEnv", "IndustrialBenchmarkVectorEnv"]

# Imported when first used: what these two are made of needs no Gymnasium.
_HOMES = {"IndustrialBenchmarkEnv": "single", "IndustrialBenchmarkVectorEnv": "vector"}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'ibdata.environment' has no attribute {name!r}")
    return getattr(import_module(f"ibdata.environment.{_HOMES[name]}"), name)
