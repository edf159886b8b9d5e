"""Offline reinforcement-learning datasets of the Industrial Benchmark (Hein et al. 2017)."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ibdata.version import __version__

if TYPE_CHECKING:
    from ibdata.dataset.reader import Dataset
    from ibdata.dataset.reader import Dataset as open
    from ibdata.engines.generate import generate
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
    "evaluate",
    "export",
    "generate",
    "generate_all",
    "load",
    "open",
]

# Imported when first used, so that `ibdata --help` answers at once.
_HOMES = {
    "Dataset": ("ibdata.dataset.reader", "Dataset"),
    "Experiment": ("ibdata.experiment", "Experiment"),
    "IbdataError": ("ibdata.errors", "IbdataError"),
    "evaluate": ("ibdata.evaluation", "evaluate"),
    "export": ("ibdata.exporters", "export"),
    "generate": ("ibdata.engines.generate", "generate"),
    "generate_all": ("ibdata.engines.suite", "generate_all"),
    "load": ("ibdata.experiment", "load"),
    "open": ("ibdata.dataset.reader", "Dataset"),
}


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'ibdata' has no attribute {name!r}")
    module, attribute = _HOMES[name]
    return getattr(import_module(module), attribute)
