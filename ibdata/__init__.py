"""Offline reinforcement-learning datasets of the Industrial Benchmark (Hein et al. 2017)."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ibdata.registration import register as _register
from ibdata.version import __version__

if TYPE_CHECKING:
    from ibdata.dataset.difference import difference
    from ibdata.dataset.reader import Dataset
    from ibdata.dataset.reader import Dataset as open
    from ibdata.dataset.validation import validate
    from ibdata.engines.array import finalize, generate_shards
    from ibdata.engines.estimate import estimate
    from ibdata.engines.generate import generate
    from ibdata.engines.merge import merge
    from ibdata.engines.repair import repair
    from ibdata.engines.reproduce import reproduce
    from ibdata.engines.split import split
    from ibdata.engines.suite import generate_all
    from ibdata.errors import IbdataError
    from ibdata.evaluation import evaluate
    from ibdata.experiment import Experiment, load
    from ibdata.exporters import export

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
    "estimate": ("ibdata.engines.estimate", "estimate"),
    "evaluate": ("ibdata.evaluation", "evaluate"),
    "export": ("ibdata.exporters", "export"),
    "finalize": ("ibdata.engines.array", "finalize"),
    "generate": ("ibdata.engines.generate", "generate"),
    "generate_all": ("ibdata.engines.suite", "generate_all"),
    "generate_shards": ("ibdata.engines.array", "generate_shards"),
    "load": ("ibdata.experiment", "load"),
    "merge": ("ibdata.engines.merge", "merge"),
    "open": ("ibdata.dataset.reader", "Dataset"),
    "repair": ("ibdata.engines.repair", "repair"),
    "reproduce": ("ibdata.engines.reproduce", "reproduce"),
    "split": ("ibdata.engines.split", "split"),
    "validate": ("ibdata.dataset.validation", "validate"),
}


_register()  # the environment, with Gymnasium where there is one


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'ibdata' has no attribute {name!r}")
    module, attribute = _HOMES[name]
    return getattr(import_module(module), attribute)
