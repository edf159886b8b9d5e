"""Offline reinforcement-learning datasets of the Industrial Benchmark (Hein et al. 2017)."""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from ibdata.version import __version__ as __version__

if TYPE_CHECKING:  # for type checkers and editors
    from ibdata.dataset.dataset import Dataset as Dataset
    from ibdata.errors import IbdataError as IbdataError
    from ibdata.evaluation import evaluate as evaluate
    from ibdata.evaluation.baselines import baselines as baselines
    from ibdata.evaluation.importance import importance as importance
    from ibdata.evaluation.noise_floor import noise_floor as noise_floor
    from ibdata.evaluation.rollouts import rollouts as rollouts
    from ibdata.evaluation.score_model import score_model as score_model
    from ibdata.evaluation.states import state_at as state_at
    from ibdata.evaluation.true_values import true_values as true_values
    from ibdata.experiment import Experiment as Experiment
    from ibdata.experiment import load as load
    from ibdata.exporters import export as export
    from ibdata.generation.estimate import estimate as estimate
    from ibdata.generation.generate import finalize as finalize
    from ibdata.generation.generate import generate as generate
    from ibdata.maintenance.make import make as make
    from ibdata.maintenance.merge import merge as merge
    from ibdata.maintenance.repair import repair as repair
    from ibdata.maintenance.reproduce import reproduce as reproduce
    from ibdata.maintenance.split import split as split
    from ibdata.measures import quality as quality
    from ibdata.policies.save_network import save_network as save_network
    from ibdata.validation.validate import validate as validate

    open = Dataset

# Public name → module. Modules are imported on first use, so that `ibdata --help` starts quickly.
_MODULES = {
    "Dataset": "dataset.dataset",
    "Experiment": "experiment",
    "IbdataError": "errors",
    "baselines": "evaluation.baselines",
    "estimate": "generation.estimate",
    "evaluate": "evaluation",
    "export": "exporters",
    "finalize": "generation.generate",
    "generate": "generation.generate",
    "importance": "evaluation.importance",
    "load": "experiment",
    "make": "maintenance.make",
    "merge": "maintenance.merge",
    "noise_floor": "evaluation.noise_floor",
    "open": "dataset.dataset",
    "quality": "measures",
    "repair": "maintenance.repair",
    "reproduce": "maintenance.reproduce",
    "rollouts": "evaluation.rollouts",
    "save_network": "policies.save_network",
    "score_model": "evaluation.score_model",
    "split": "maintenance.split",
    "state_at": "evaluation.states",
    "true_values": "evaluation.true_values",
    "validate": "validation.validate",
}

__all__ = sorted([*_MODULES, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(
            f"module 'ibdata' has no attribute {name!r}", name=name, obj=sys.modules[__name__]
        )
    return getattr(import_module(f"ibdata.{_MODULES[name]}"), "Dataset" if name == "open" else name)


def __dir__() -> list[str]:
    return __all__


if "gymnasium" in sys.modules:
    import_module("ibdata.environment")  # registers the environment
