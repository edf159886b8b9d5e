"""Datasets at URLs, such as s3://bucket/name. They are read through a temporary folder on this machine.

pyarrow's file systems are tried first, then fsspec's. An object store cannot rename, and a write that fails
may leave part of an object. So files are uploaded whole, and the manifest last.
"""

from __future__ import annotations

import atexit
import os
import re
import secrets
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import quote

from ibdata.errors import DatasetError, MissingError, UsageError, hidden, printable

URL = re.compile(r"[a-z][a-z0-9+.-]+://", re.IGNORECASE)
BLOCK = 2**23


def is_url(place: str | os.PathLike[str] | None) -> bool:
    """Whether a place is a URL, or a dataset at one, and not a path."""
    return url_of(place) is not None


def url_of(place: str | os.PathLike[str] | None) -> str | None:
    """The URL that a place is, or that it is the temporary copy of; None for other paths."""
    if _is_address(place):
        return str(place)
    copied = _mirrors.get(Path(place)) if isinstance(place, str | os.PathLike) else None
    return copied.url if copied else None


def _is_address(place: str | os.PathLike[str] | None) -> bool:
    """Whether a place is written as a URL."""
    return isinstance(place, str) and URL.match(place) is not None


def refuse_url(*places: str | os.PathLike[str] | None) -> None:
    """Raise UsageError if one of the places is a URL."""
    for place in places:
        if (url := url_of(place)) is not None:
            raise UsageError(f"{printable(hidden(url))}: found a URL, expected a path on this machine")


class Remote:
    """The files of a dataset at a URL. Methods raise OSError if the storage refuses.

    `name` is the URL without credentials, for messages; `url` may contain credentials.
    """

    def __init__(self, url: str) -> None:
        scheme, _, rest = url.partition("://")
        self.url = f"{scheme.lower()}://{rest}".rstrip("/")
        self.name = hidden(self.url)
        self._files, base = _file_system(self.url)
        self._base = base.rstrip("/")
        if not self._base:
            raise UsageError(
                f"{printable(url)}: found no name in the URL, expected one such as s3://bucket/name"
            )

    @property
    def folder(self) -> Path | None:
        """The folder of this machine that the URL names, as file:///data/name does; None for other URLs."""
        from pyarrow.fs import LocalFileSystem

        files = getattr(getattr(self._files, "handler", None), "fs", self._files)  # fsspec's, or pyarrow's
        local = isinstance(files, LocalFileSystem) or "file" in getattr(files, "protocol", ())
        return Path(self._base) if local else None

    def size(self, path: str) -> int | None:
        """The size of a file in bytes; None if there is none."""
        info = self._files.get_file_info(f"{self._base}/{path}")
        return info.size if info.is_file else None

    def sizes(self, folder: str = "") -> dict[str, int]:
        """The bytes of every file by its path: at the URL, or in a folder there."""
        from pyarrow.fs import FileSelector

        top = f"{self._base}/{folder}".rstrip("/")
        found = self._files.get_file_info(FileSelector(top, allow_not_found=True, recursive=True))
        base = self._base.strip("/")
        return {info.path.strip("/")[len(base) + 1 :]: info.size for info in found if info.is_file}

    def read(self, path: str) -> bytes | None:
        """Read a file; None if there is none."""
        if self.size(path) is None:
            return None
        with self._files.open_input_stream(f"{self._base}/{path}") as source:
            data: bytes = source.read()
        return data

    def fetch(self, path: str, target: Path) -> None:
        """Download a file, if there is one."""
        if self.size(path) is None:
            return
        target.parent.mkdir(parents=True, exist_ok=True)
        part = target.with_name(f".tmp-{secrets.token_hex(6)}-{target.name}")  # each thread has its own
        with self._files.open_input_stream(f"{self._base}/{path}") as source, part.open("xb") as file:
            shutil.copyfileobj(source, file, BLOCK)
        part.replace(target)

    def put(self, source: Path, path: str) -> None:
        """Upload a file. If that fails, part of it may be there."""
        target = f"{self._base}/{path}"
        try:
            stream = self._files.open_output_stream(target)
        except FileNotFoundError:  # a file system with folders
            self._files.create_dir(target.rpartition("/")[0], recursive=True)
            stream = self._files.open_output_stream(target)
        with source.open("rb") as file, stream:
            shutil.copyfileobj(file, stream, BLOCK)

    def remove(self, path: str) -> None:
        """Remove a file."""
        self._files.delete_file(f"{self._base}/{path}")


def _file_system(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it: pyarrow's, or fsspec's if pyarrow has none."""
    from pyarrow import ArrowException, ArrowNotImplementedError
    from pyarrow.fs import FileSystem, FSSpecHandler, PyFileSystem

    scheme = f"{url.partition('://')[0]}://"
    try:
        found: tuple[Any, str] = FileSystem.from_uri(url)
    except ImportError:  # for some schemes, such as hf://, pyarrow itself imports fsspec
        pass
    except (ArrowException, OSError) as error:
        if not isinstance(error, ArrowNotImplementedError) and "Unrecognized filesystem" not in str(error):
            raise UsageError(f"{printable(url)}: {first_line(error)}") from None
    else:
        _refuse_ignored(url)
        return found
    try:
        import fsspec
    except ImportError:
        raise MissingError(scheme, "fsspec", "remote") from None
    try:
        files, path = fsspec.core.url_to_fs(url)
    except ImportError as error:
        raise UsageError(f"{scheme} needs a plug-in of fsspec: {first_line(error)}") from None
    except (ValueError, TypeError, OSError) as error:
        raise UsageError(f"{printable(url)}: {first_line(error)}") from None
    return PyFileSystem(FSSpecHandler(files)), path


def _refuse_ignored(url: str) -> None:
    """Raise UsageError for a part of a URL that pyarrow passes over, and so would take for another place."""
    for mark in "#?" if url.startswith("file:") else "#":
        if mark in url:
            raise UsageError(
                f"{printable(hidden(url))}: found {mark}, which begins no part of such a URL; expected "
                f"{quote(mark)} where it belongs to a name"
            )


def first_line(error: BaseException) -> str:
    """The first line of an error's message, without credentials."""
    line = hidden((str(error).splitlines() or [""])[0])  # hides credentials before the line is cut
    return (printable(line) or type(error).__name__)[:300]


_mirrors: dict[Path, Remote] = {}
_copies: dict[Path, Path] = {}  # temporary folders of other processes, and those of this one in their place


def local_copy(place: str | os.PathLike[str]) -> Path:
    """The folder itself, or for a URL a temporary folder to which files are downloaded when first needed."""
    if not _is_address(place):
        return Path(place)
    remote = Remote(str(place))
    top = tempfile.mkdtemp(prefix="ibdata-")
    atexit.register(shutil.rmtree, top, ignore_errors=True)
    folder = Path(top, "dataset")
    _mirrors[folder] = remote
    return folder


def own_copy(folder: Path, url: str) -> Path:
    """The temporary folder of this process for a URL, for which another process may have this one.

    So each process removes what it downloads, and nothing is downloaded twice.
    """
    if folder in _mirrors:
        return folder
    if folder not in _copies:
        _copies[folder] = local_copy(url)
    return _copies[folder]


def name_of(path: Path) -> str:
    """The URL that a path in a temporary folder stands for, without credentials, or the path itself."""
    for folder in (path, *path.parents):
        if folder in _mirrors:
            return "/".join([_mirrors[folder].name, *path.relative_to(folder).parts])
    return str(path)


def damaged(path: Path, problem: str) -> DatasetError:
    """The error that says where a file of a dataset is, at its URL if it has one, and its problem."""
    return DatasetError(f"{name_of(path)}: {problem}")


def fetch_if_missing(folder: Path, path: str) -> None:
    """Download a file of a dataset at a URL, unless it is here. Raises DatasetError if it cannot be read."""
    if folder in _mirrors and not os.path.lexists(folder / path):
        with readable(_mirrors[folder], path):
            _mirrors[folder].fetch(path, folder / path)


def files_in_data(folder: Path) -> list[str]:
    """The paths of what is in `data`, in order; of a dataset at a URL, of all files below it."""
    if folder not in _mirrors:
        return sorted(f"data/{path.name}" for path in (folder / "data").glob("*"))
    with readable(_mirrors[folder], "data"):
        return sorted(_mirrors[folder].sizes("data"))


def is_remote(folder: Path) -> bool:
    """Whether a folder stands for a URL."""
    return folder in _mirrors


@contextmanager
def readable(remote: Remote, path: str) -> Iterator[None]:
    """Turn errors of the storage into a DatasetError of one line."""
    try:
        yield
    except OSError as error:
        raise DatasetError(f"{remote.name}/{path}: cannot be read: {first_line(error)}") from None
