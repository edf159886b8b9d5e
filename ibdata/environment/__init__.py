"""The Industrial Benchmark as a Gymnasium environment, and many of them at once as a vector environment.

`gymnasium.make("ibdata.environment:ibdata/IndustrialBenchmark-v0", setpoint=70)`. The part before the colon
may be left out once this package has been imported. Needs the extra `gymnasium`.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ibdata.environment.single import IndustrialBenchmarkEnv
    from ibdata.environment.vector import IndustrialBenchmarkVectorEnv

__all__ = ["IndustrialBenchmarkEnv", "IndustrialBenchmarkVectorEnv"]

ID = "ibdata/IndustrialBenchmark-v0"
STEPS = 1000  # of an episode, unless `gymnasium.make(…, max_episode_steps=n)` says otherwise

# Imported when first used: their settings and their simulation need no Gymnasium.
_MODULES = {"IndustrialBenchmarkEnv": "single", "IndustrialBenchmarkVectorEnv": "vector"}


def _register() -> None:
    """Make the environment known to Gymnasium where that is installed."""
    try:
        import gymnasium
    except ModuleNotFoundError:
        return  # the two classes say what to install
    if ID not in gymnasium.registry:
        gymnasium.register(
            id=ID,
            entry_point=f"{__name__}:IndustrialBenchmarkEnv",
            vector_entry_point=f"{__name__}:IndustrialBenchmarkVectorEnv",
            max_episode_steps=STEPS,
        )


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'ibdata.environment' has no attribute {name!r}")
    return getattr(import_module(f"ibdata.environment.{_MODULES[name]}"), name)


_register()
