"""Pictures of datasets; needs the extra `plot` (matplotlib)."""

from __future__ import annotations

import base64
import os
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from ibdata._numerics.arguments import public
from ibdata._system.storage import local
from ibdata.errors import OUT, OVERWRITE, IbdataError, UsageError, meant

if TYPE_CHECKING:
    from ibdata.dataset.dataset import Dataset, Place

FOLDER = "figures"
FORMS = ("png", "svg")
PICTURES = {  # the title and the caption of each, which a function in `ibdata.plots.pictures` draws
    "actions": (
        "Actions",
        "The actions of each policy. Spikes are actions that the policy takes again and again.",
    ),
    "coverage": (
        "Coverage",
        "How often each pair of velocity, gain and shift was visited under each policy.",
    ),
    "returns": (
        "Returns",
        "The returns of episodes at each setpoint, by policy. A return is the sum of an episode's rewards.",
    ),
    "rewards": (
        "Rewards",
        "The rewards at each setpoint, by policy: minus the cost, consumption + 3 · fatigue of the next "
        "step.",
    ),
    "splits": (
        "Splits",
        "How many episodes of each setpoint and policy a split holds, and how many two splits share.",
    ),
    "traces": (
        "One episode",
        "The episode with the median return: observed variables and, if the dataset has them, hidden ones.",
    ),
    "tradeoff": (
        "Fatigue against consumption",
        "The two costs of every step, fatigue and consumption. Steps at the lower left have the highest "
        "reward.",
    ),
}


class Pictures(list[Path]):
    """Files of pictures, which a notebook shows."""

    def _repr_html_(self) -> str:
        parts = []
        for path in self:
            kind = {".png": "png", ".svg": "svg+xml"}[path.suffix]
            data = base64.b64encode(path.read_bytes()).decode()
            parts.append(f'<img alt="{path.stem}" width="480" src="data:image/{kind};base64,{data}">')
        return "\n".join(parts)


@public
def plot(
    dataset: Place,
    out: str | os.PathLike[str] | None = None,
    form: str = "png",
    overwrite: bool = False,
    progress: bool | None = False,
) -> Pictures:
    """Draw all pictures of a dataset into a folder. Equal datasets give equal bytes.

    The pictures are actions, coverage, returns, rewards, splits (where there are some), traces (of the
    episode with the median return) and tradeoff, each in a file of that name. They count all rows, in
    constant memory.

    Args:
        dataset: a dataset, its folder or URL, or a selection of its episodes.
        out: the folder for the pictures; by default figures/<name of the dataset's folder>.
        form: "png" or "svg".
        overwrite: whether to replace existing files.
        progress: whether to show bars on stderr; None shows them if stderr is a terminal.

    Returns:
        The files, a list that shows its pictures in a notebook.

    Raises:
        UsageError: the form is invalid, or a file exists and is not to be replaced.
        DatasetError: there is no dataset, or it is damaged.
        ImportError: matplotlib is not installed.
        IbdataError: a file cannot be written.
    """
    from ibdata._system.files import write
    from ibdata.dataset.dataset import opened
    from ibdata.dataset.manifest import refuse_inside

    if form not in FORMS:
        raise UsageError(f"form: found {form!r}{meant(form, FORMS)}")
    shown = opened(dataset)
    name = os.path.basename(os.path.abspath(shown.place.partition("?")[0]))  # of a folder or in a URL
    folder = Path(FOLDER, name) if out is None else local(out)
    paths = {name: folder / f"{name}.{form}" for name in _of(shown)}
    for path in paths.values():
        if os.path.lexists(path) and (path.is_dir() or not overwrite):
            todo = OUT if path.is_dir() else f"{OUT}, or {OVERWRITE} to replace it"
            raise UsageError(f"{path}: exists already; choose another {todo}")
        refuse_inside(path)
    for name, data in drawn(shown, form, progress).items():
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write(folder, paths[name].name, data)
        except OSError as error:
            raise IbdataError(f"{paths[name]}: cannot be written: {error.strerror}") from None
    return Pictures(paths.values())


def drawn(dataset: Dataset, form: str = "png", progress: bool | None = False) -> dict[str, bytes]:
    """The pictures of a dataset by name. Raises DatasetError and ImportError as `plot` does."""
    from ibdata._system.progress import bar
    from ibdata.plots.style import DATASET_DPI, image
    from ibdata.plots.summary import Summary

    pictures = import_module("ibdata.plots.pictures")  # after the style, which says what to install
    images, names = {}, _of(dataset)
    summary = Summary(dataset, progress)
    with bar(progress, len(names), "pictures", "draw") as advance:
        for name in names:
            draw = partial(getattr(pictures, f"draw_{name}"), summary=summary)
            heading = f"{PICTURES[name][0]}: {dataset.stored.info.name}"
            images[name] = image(draw, form, heading, DATASET_DPI)
            advance(1)
    return images


def _of(dataset: Dataset) -> list[str]:
    """The pictures that show something of a dataset."""
    return [name for name in PICTURES if name != "splits" or dataset.stored.splits]
