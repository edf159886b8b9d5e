"""Offline reinforcement-learning datasets of the Industrial Benchmark (Hein et al. 2017)."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ibdata.environment.registration import register as _register
from ibdata.version import __version__

if TYPE_CHECKING:
    from ibdata.dataset.difference import difference
    from ibdata.dataset.reader import Dataset
    from ibdata.dataset.reader import Dataset as open
    from ibdata.errors import IbdataError
    from ibdata.evaluation import evaluate
    from ibdata.experiment import Experiment, load
    from ibdata.exporters import export
    from ibdata.generation.array_job import finalize, generate_shards
    from ibdata.generation.estimate import estimate
    from ibdata.generation.generate import generate
    from ibdata.generation.suite import generate_all
    from ibdata.maintenance.merge import merge
    from ibdata.maintenance.repair import repair
    from ibdata.maintenance.reproduce import reproduce
    from ibdata.maintenance.split import split
    from ibdata.validation.validate import validate

__all__ = [
    "Dataset",
    "Experiment",
    "IbdataError",
    "__version__",
    "difference",
    "estimate",
    "evaluate",
    "export",
    "finalize",
    "generate",
    "generate_all",
    "generate_shards",
    "load",
    "merge",
    "open",
    "repair",
    "reproduce",
    "split",
    "validate",
]

# Imported when first used, so that `ibdata --help` answers at once.
_HOMES = {
    "Dataset": ("ibdata.dataset.reader", "Dataset"),
    "Experiment": ("ibdata.experiment", "Experiment"),
    "IbdataError": ("ibdata.errors", "IbdataError"),
    "difference": ("ibdata.dataset.difference", "difference"),
    "estimate": ("ibdata.generation.estimate", "estimate"),
    "evaluate": ("ibdata.evaluation", "evaluate"),
    "export": ("ibdata.exporters", "export"),
    "finalize": ("ibdata.generation.array_job", "finalize"),
    "generate": ("ibdata.generation.generate", "generate"),
    "generate_all": ("ibdata.generation.suite", "generate_all"),
    "generate_shards": ("ibdata.generation.array_job", "generate_shards"),
    "load": ("ibdata.experiment", "load"),
    "merge": ("ibdata.maintenance.merge", "merge"),
    "open": ("ibdata.dataset.reader", "Dataset"),
    "repair": ("ibdata.maintenance.repair", "repair"),
    "reproduce": ("ibdata.maintenance.reproduce", "reproduce"),
    "split": ("ibdata.maintenance.split", "split"),
    "validate": ("ibdata.validation.validate", "validate"),
}


_register()  # the environment, with Gymnasium where there is one


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'ibdata' has no attribute {name!r}")
    module, attribute = _HOMES[name]
    return getattr(import_module(module), attribute)
