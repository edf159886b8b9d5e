"""Offline reinforcement-learning datasets of the Industrial Benchmark (Hein et al. 2017).

A room without an underscore is what people speak of; one with an underscore is how it is done.

- dynamics: the equations, a file for each part of the paper
- views: the variables, and what of them is seen and rewarded
- policies: behaviours and their densities
- experiment: from YAML or Python to what is simulated
- plan: the columns, shards and rows of an experiment's dataset; consent to its code, and its record
- generation: how a dataset comes to be: shards, their files and metadata, the build in a hidden part
- dataset: a finished dataset, and what is read of it
- evaluation: what policies are worth, by simulation, from data, or at single states
- environment: the benchmark for Gymnasium
- exporters, plots: the formats of other libraries, a file each; pictures and the report
- tools: what is done to finished datasets: validate, repair, reproduce, split, merge, make, list, card
- cli: the commands
- _simulation: episodes side by side, unrolled step by step
- _numerics, _system: the same bits on every machine; files, locks, signals and processes
"""

import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from ibdata._system.signals import whole_imports as _whole_imports
from ibdata.version import __version__ as __version__

if TYPE_CHECKING:  # for type checkers and editors
    from ibdata.dataset.dataset import Dataset as Dataset
    from ibdata.dataset.quality import quality as quality
    from ibdata.errors import IbdataError as IbdataError
    from ibdata.evaluation import evaluate as evaluate
    from ibdata.evaluation.baselines import baselines as baselines
    from ibdata.evaluation.importance import importance as importance
    from ibdata.evaluation.rollouts import rollouts as rollouts
    from ibdata.evaluation.states import state_at as state_at
    from ibdata.evaluation.true_values import true_values as true_values
    from ibdata.evaluation.world_models import noise_floor as noise_floor
    from ibdata.evaluation.world_models import score_model as score_model
    from ibdata.experiment import Experiment as Experiment
    from ibdata.experiment import load as load
    from ibdata.exporters import export as export
    from ibdata.generation.estimate import estimate as estimate
    from ibdata.generation.generate import finalize as finalize
    from ibdata.generation.generate import generate as generate
    from ibdata.policies.save_network import save_network as save_network
    from ibdata.tools.card import card as card
    from ibdata.tools.make import make as make
    from ibdata.tools.merge import merge as merge
    from ibdata.tools.repair import repair as repair
    from ibdata.tools.reproduce import reproduce as reproduce
    from ibdata.tools.split import split as split
    from ibdata.tools.validate import validate as validate

    open = Dataset

# Public name → module. Modules are imported on first use, so that `ibdata --help` starts quickly.
_MODULES = {
    "Dataset": "dataset.dataset",
    "Experiment": "experiment",
    "IbdataError": "errors",
    "baselines": "evaluation.baselines",
    "card": "tools.card",
    "estimate": "generation.estimate",
    "evaluate": "evaluation",
    "export": "exporters",
    "finalize": "generation.generate",
    "generate": "generation.generate",
    "importance": "evaluation.importance",
    "load": "experiment",
    "make": "tools.make",
    "merge": "tools.merge",
    "noise_floor": "evaluation.world_models",
    "open": "dataset.dataset",
    "quality": "dataset.quality",
    "repair": "tools.repair",
    "reproduce": "tools.reproduce",
    "rollouts": "evaluation.rollouts",
    "save_network": "policies.save_network",
    "score_model": "evaluation.world_models",
    "split": "tools.split",
    "state_at": "evaluation.states",
    "true_values": "evaluation.true_values",
    "validate": "tools.validate",
}

__all__ = sorted([*_MODULES, "__version__"])


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(
            f"module 'ibdata' has no attribute {name!r}", name=name, obj=sys.modules[__name__]
        )
    with _whole_imports():
        module = import_module(f"ibdata.{_MODULES[name]}")
    return getattr(module, "Dataset" if name == "open" else name)


def __dir__() -> list[str]:
    return __all__


if "gymnasium" in sys.modules:
    import_module("ibdata.environment")  # registers the environment
