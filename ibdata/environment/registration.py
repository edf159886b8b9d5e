"""Make the environment known to Gymnasium, without importing it: not everybody who uses ibdata has it."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec
from types import ModuleType

ID = "ibdata/IndustrialBenchmark-v0"
STEPS = 1000  # of an episode, unless `gymnasium.make(…, max_episode_steps=n)` says otherwise


class _AfterGymnasium:
    """An entry of `sys.meta_path` that registers the environment once Gymnasium has been imported."""

    def __init__(self) -> None:
        self._asking = False

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if name != "gymnasium" or self._asking:
            return None
        self._asking = True  # a second one of these, of a reloaded ibdata, would ask this one in turn
        try:
            found = (finder.find_spec(name, path, target) for finder in sys.meta_path)
            spec = next((spec for spec in found if spec is not None), None)
        finally:
            self._asking = False
        if spec is None or spec.loader is None:
            return spec
        execute = spec.loader.exec_module

        def execute_and_register(module: ModuleType) -> None:
            execute(module)
            _register(module)

        spec.loader.exec_module = execute_and_register  # type: ignore[method-assign]
        return spec


def _register(gymnasium: ModuleType) -> None:
    if ID not in gymnasium.registry:
        gymnasium.register(
            id=ID,
            entry_point="ibdata.environment:IndustrialBenchmarkEnv",
            vector_entry_point="ibdata.environment:IndustrialBenchmarkVectorEnv",
            max_episode_steps=STEPS,
        )


def register() -> None:
    """Register the environment now if Gymnasium is imported, else as soon as it is."""
    gymnasium = sys.modules.get("gymnasium")
    if gymnasium is not None:
        _register(gymnasium)
    else:
        sys.meta_path.insert(0, _AfterGymnasium())
