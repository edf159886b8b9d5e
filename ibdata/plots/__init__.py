"""Pictures of the benchmark and of datasets; needs the extra `plot` (matplotlib)."""

from __future__ import annotations

import base64
import os
import pkgutil
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ibdata.arguments import public
from ibdata.errors import IbdataError, UsageError, meant
from ibdata.system.storage import local

if TYPE_CHECKING:
    from ibdata.dataset.readable import Readable
    from ibdata.dataset.reader import Rows

FOLDER = "figures"
DYNAMICS = ("siemens", "paper")
FORMS = ("png", "svg")


class Pictures(list[Path]):
    """Files of pictures, which a notebook shows."""

    def _repr_html_(self) -> str:
        parts = []
        for path in self:
            kind = {".png": "png", ".svg": "svg+xml"}[path.suffix]
            data = base64.b64encode(path.read_bytes()).decode()
            parts.append(f'<img alt="{path.stem}" width="480" src="data:image/{kind};base64,{data}">')
        return "\n".join(parts)


def names() -> list[str]:
    """The names of the paper's figures, the modules of `ibdata.plots.paper`."""
    return _modules("paper")


def plots() -> list[str]:
    """The names of the pictures of a dataset, the modules of `ibdata.plots.dataset`."""
    return _modules("dataset")


@public
def figure(
    name: str,
    out: str | os.PathLike[str] | None = None,
    dynamics: str = "siemens",
    seed: int | None = None,
    overwrite: bool = False,
) -> Path:
    """Draw a figure of the paper into a PNG or SVG file. Equal arguments give equal bytes.

    Args:
        name: "landscape", "policies", "dynamics" or "setpoints".
        out: the file, which ends in .png or .svg; by default figures/<name>.png.
        dynamics: "siemens" or "paper".
        seed: the seed of the episodes drawn; by default one that shows the same as the paper's figure.
        overwrite: whether to replace the file if it exists.

    Returns:
        The file.

    Raises:
        UsageError: an argument is invalid, or the file exists and is not to be replaced.
        ImportError: matplotlib is not installed.
        IbdataError: the file cannot be written.
    """
    path = Path(FOLDER, f"{name}.png") if out is None else local(out)
    form = path.suffix[1:].lower()
    _one_of("figure", name, names())
    _one_of("dynamics", dynamics, DYNAMICS)
    if form not in FORMS:
        raise UsageError(f"{path}: found the ending {path.suffix!r}, expected .png or .svg")
    if seed is not None and not 0 <= seed < 2**64:
        raise UsageError(f"seed: found {seed}, expected a whole number from 0 to 2⁶⁴ - 1")
    _refuse_existing(path, overwrite)
    from ibdata.plots.style import image  # first, because its error says what to install

    module = import_module(f"ibdata.plots.paper.{name}")
    chosen = module.SEED if seed is None else seed
    _write(path, image(lambda drawing: module.draw(drawing, dynamics, chosen), form))
    return path


@public
def plot(
    dataset: Rows,
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
    from ibdata.dataset.reader import readable

    _one_of("form", form, FORMS)
    shown = readable(dataset)
    name = os.path.basename(os.path.abspath(shown.place.partition("?")[0]))  # of a folder or in a URL
    folder = Path(FOLDER, name) if out is None else local(out)
    paths = {name: folder / f"{name}.{form}" for name in _of(shown)}
    for path in paths.values():
        _refuse_existing(path, overwrite)
    for name, data in drawn(shown, form, progress).items():
        _write(paths[name], data)
    return Pictures(paths.values())


def drawn(dataset: Readable, form: str = "png", progress: bool | None = False) -> dict[str, bytes]:
    """The pictures of a dataset by name. Raises DatasetError and ImportError as `plot` does."""
    from ibdata.plots.style import DATASET_DPI, image
    from ibdata.plots.summary import Summary
    from ibdata.system.progress import bar

    images, names = {}, _of(dataset)
    summary = Summary(dataset, progress)
    with bar(progress, len(names), "pictures", "draw") as advance:
        for name in names:
            module = module_of(name)
            heading = f"{module.TITLE}: {dataset.stored.info.name}"
            images[name] = image(partial(module.draw, summary=summary), form, heading, DATASET_DPI)
            advance(1)
    return images


def _of(dataset: Readable) -> list[str]:
    """The pictures that show something of a dataset."""
    return [name for name in plots() if name != "splits" or dataset.stored.splits]


def module_of(name: str) -> Any:
    """The module of a picture of a dataset."""
    return import_module(f"ibdata.plots.dataset.{name}")


def _modules(folder: str) -> list[str]:
    return sorted(module.name for module in pkgutil.iter_modules([str(Path(__file__).with_name(folder))]))


def _refuse_existing(path: Path, overwrite: bool) -> None:
    from ibdata.dataset.manifest import refuse_inside

    if os.path.lexists(path) and (path.is_dir() or not overwrite):
        todo = "another name" if path.is_dir() else "another name, or --overwrite"
        raise UsageError(f"{path}: exists already; choose {todo}")
    refuse_inside(path)


def _one_of(what: str, value: str, known: list[str] | tuple[str, ...]) -> None:
    if value not in known:
        raise UsageError(f"{what}: found {value!r}{meant(value, known)}")


def _write(path: Path, data: bytes) -> None:
    from ibdata.system.files import write

    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write(path.parent, path.name, data)
    except OSError as error:
        raise IbdataError(f"{path}: cannot be written: {error.strerror}") from None
