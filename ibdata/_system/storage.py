"""The files of a dataset, in a folder or at a URL such as s3://bucket/name.

At a URL, pyarrow's file systems are tried first, then fsspec's. pyarrow completes an upload that fails, so a
part of an object may be left; therefore a writer looks at the size of what it has put.
"""

from __future__ import annotations

import errno
import hashlib
import os
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from copy import copy
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from ibdata._system.files import FileEntry, is_litter, open_regular, paths_in
from ibdata._system.signals import held
from ibdata.errors import DatasetError, IbdataError, UsageError, missing, printable, public_url, reason

if TYPE_CHECKING:
    import pyarrow as pa

URL = re.compile(r"[a-z][a-z0-9+.-]+://", re.IGNORECASE)
BLOCK, UPLOADED = 2**23, 2**20  # bytes that are read at once
_uploading = threading.Lock()


class Storage:
    """The files in a folder of this machine, by their paths in it. `Remote` is the same at a URL.

    Methods raise OSError if a file cannot be read. `name` is the place as it was given, for messages; the
    files stay those of the folder that it names now, wherever the process goes. `url` is None.
    """

    url: str | None = None

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = local(path).absolute()
        self.name = str(Path(path))

    @property
    def path(self) -> Path:
        """The folder. Raises UsageError for a URL."""
        return self._path

    def where(self, path: str) -> str:
        """The name of a file, for messages."""
        return os.path.join(self.name, *path.split("/"))

    def error(self, path: str, problem: str) -> DatasetError:
        """The error that names a file and its problem."""
        return DatasetError(f"{self.where(path)}: {problem}")

    def open(self, path: str) -> pa.NativeFile:
        """Open a regular file for reading anywhere in it."""
        import pyarrow as pa

        place = self._path / path
        open_regular(place).close()  # its errors are plainer than Arrow's
        return pa.OSFile(os.fsencode(place))

    def stamp(self, path: str) -> Any:
        """What changes with a file that is replaced; None where that is not known, as at a URL."""
        try:
            status = os.stat(self._path / path)
        except OSError:
            return None
        return status.st_ino, status.st_size, status.st_mtime_ns

    def read(self, path: str) -> bytes:
        """Read a whole file."""
        with plain_errors(), self.open(path) as file:
            data: bytes = file.read()
            return data

    def entry(self, path: str) -> FileEntry | None:
        """The size and the hash of a file; None if it cannot be read."""
        hasher, size = hashlib.sha256(), 0
        try:
            with plain_errors(), self.open(path) as file:
                while block := file.read(BLOCK):
                    hasher.update(block)
                    size += len(block)
        except OSError:
            return None
        return FileEntry(path, size, hasher.hexdigest())

    def names(self, folder: str) -> list[str]:
        """The names of what is in a folder, in order. The name of a folder ends in a slash."""
        try:
            return [path.name + "/" * os.path.isdir(path) for path in paths_in(self._path / folder)]
        except (FileNotFoundError, NotADirectoryError):
            return []


class Remote(Storage):
    """The files at a URL. `url` may contain credentials, `name` does not.

    Raises UsageError if no file system has such URLs, and ImportError if that needs another library.
    """

    url: str

    def __init__(self, url: str) -> None:
        scheme, _, rest = url.partition("://")
        self.url = f"{scheme.lower()}://{rest}".rstrip("/")
        self.name = public_url(self.url)
        self._given = self.url
        self._files, base = _file_system(self.url)
        self._base = base.rstrip("/")
        if not self._base:
            raise UsageError(
                f"{printable(url)}: found no name in the URL, expected one such as s3://bucket/name"
            )
        if {".", ".."} & {*self.parts} or "#" in url:
            raise UsageError(f"{printable(url)}: found #, . or .. in the URL, expected the path without them")

    def __reduce__(self) -> tuple[type[Remote], tuple[str], dict[str, str]]:
        # Not from its own URL, whose path could be read in another way.
        return type(self), (self._given,), {"url": self.url, "name": self.name, "_base": self._base}

    @property
    def path(self) -> Path:
        raise _url_refused(self.url)

    @property
    def folder(self) -> Path | None:
        """The folder of this machine that the URL names, as file:///data/name does; None for other URLs."""
        from pyarrow.fs import LocalFileSystem

        files = getattr(getattr(self._files, "handler", None), "fs", self._files)  # fsspec's, or pyarrow's
        local = isinstance(files, LocalFileSystem) or "file" in getattr(files, "protocol", ())
        return Path(self._base) if local else None

    def where(self, path: str) -> str:
        return f"{self.name}/{path}"

    @property
    def parts(self) -> tuple[str, ...]:
        """The names of the folders in which the files are, and of their own."""
        return tuple(self._base.split("/"))

    def open(self, path: str) -> pa.NativeFile:
        with plain_errors():
            return self._files.open_input_file(f"{self._base}/{path}")

    def stamp(self, path: str) -> Any:
        return None

    def names(self, folder: str) -> list[str]:
        try:
            infos = self._infos(f"{self._base}/{folder}", recursive=False)
        except OSError as error:
            raise self.error(folder, f"cannot be listed: {reason(error)}") from None
        return sorted(info.base_name + "/" * (not info.is_file) for info in infos)

    @property
    def exists(self) -> bool:
        """Whether something is at the URL, or it is that of a bucket."""
        from pyarrow.fs import FileType

        with plain_errors():
            return bool(self._files.get_file_info(self._base).type != FileType.NotFound)

    def sizes(self) -> dict[str, int]:
        """The bytes of every file at the URL, by its path."""
        base, infos = self._base.strip("/"), self._infos(self._base, recursive=True)
        return {info.path.strip("/")[len(base) + 1 :]: info.size for info in infos if info.is_file}

    def _infos(self, folder: str, recursive: bool) -> list[Any]:
        """What is known of each file and folder in a folder; nothing of the files that macOS leaves."""
        from pyarrow.fs import FileSelector

        selector = FileSelector(folder, allow_not_found=True, recursive=recursive)
        with plain_errors():
            try:
                infos = self._files.get_file_info(selector)
            except FileNotFoundError:  # of file://, if another process removes the folder meanwhile
                infos = self._files.get_file_info(selector)
        return [info for info in infos if not (info.is_file and is_litter(info.base_name))]

    @property
    def part(self) -> Remote:
        """The hidden folder beside this one, in which a dataset for this place is made."""
        return self._at(lambda path: "{0}/.{2}.part".format(*path.rpartition("/")))

    def below(self, name: str) -> Remote:
        """The files in a folder of this one."""
        return self._at(lambda path: f"{path}/{name}")

    def _at(self, other: Callable[[str], str]) -> Remote:
        """The files at another path of the same file system."""
        found, (head, mark, query) = copy(self), self.url.partition("?")
        found.url, found._base = other(head.rstrip("/")) + mark + query, other(self._base)
        found.name = public_url(found.url)
        return found

    def around(self, path: str) -> str | None:
        """The first of the folders around this one that has a file of this path; None if none has."""
        folders = ["/".join(self.parts[:i]) for i in range(1, len(self.parts)) if self.parts[i - 1]]
        with plain_errors():
            found = self._files.get_file_info([f"{folder}/{path}" for folder in folders])
        return next((folder for folder, info in zip(folders, found, strict=True) if info.is_file), None)

    def size(self, path: str) -> int | None:
        """The bytes of a file; None if there is none."""
        with plain_errors():
            info = self._files.get_file_info(f"{self._base}/{path}")
            return info.size if info.is_file else None

    def put(self, source: IO[bytes], path: str, size: int) -> None:
        """Upload a file of a size. If that fails, part of it may be there."""
        with plain_errors(), _uploading:  # several at once would not be faster, and need more memory
            with self._in_folder(self._files.open_output_stream, f"{self._base}/{path}") as stream:
                while block := source.read(UPLOADED):
                    stream.write(block)
                    stream.flush()  # else all that a slow network has not taken yet is in memory
            if (found := self.size(path)) != size:
                raise OSError(errno.EIO, f"{path}: found {found} bytes after {size} were written")

    def put_bytes(self, data: bytes, path: str) -> None:
        """Upload a small file, without a signal between its beginning and its end."""
        with held():
            self.put(BytesIO(data), path, len(data))

    def copy_from(self, other: Remote, path: str) -> None:
        """Copy a file of another place in this store, which does not come to this machine."""
        with plain_errors():
            self._in_folder(partial(self._files.copy_file, f"{other._base}/{path}"), f"{self._base}/{path}")

    def _in_folder(self, action: Callable[[str], Any], target: str) -> Any:
        try:
            return action(target)
        except FileNotFoundError:  # a file system with folders
            self._files.create_dir(target.rpartition("/")[0], recursive=True)
            return action(target)

    def remove(self, path: str = "") -> None:
        """Remove a file; without one, all files. What is not there, another host may have removed."""
        with plain_errors(), suppress(FileNotFoundError):
            if path:
                self._files.delete_file(f"{self._base}/{path}")
            else:
                self._files.delete_dir(self._base)


@contextmanager
def plain_errors() -> Iterator[None]:
    """Turn what a plug-in for URLs raises, which may be anything, into an OSError."""
    try:
        yield
    except (OSError, IbdataError, MemoryError):
        raise
    except Exception as error:
        raise OSError(errno.EIO, reason(error)) from error


def storage(place: Any) -> Storage:
    """The files at a place: a folder, a URL, or a dataset, which has a `storage` of its own."""
    files = getattr(place, "storage", place)
    if isinstance(files, Storage):
        return files
    url = url_of(place)
    return Storage(place) if url is None else Remote(url)


def url_of(place: Any) -> str | None:
    """The URL that a place is, or at which a dataset is; None for paths."""
    if isinstance(place, str):
        return place if URL.match(place) else None
    files = getattr(place, "storage", place)
    return files.url if isinstance(files, Storage) else None


def is_url(place: Any) -> bool:
    """Whether a place is a URL, or a dataset at one, and not a path."""
    return url_of(place) is not None


def local(place: Any) -> Path:
    """The path of a place on this machine, whose ~ is the user's folder. Raises UsageError for a URL."""
    refuse_url(place)
    return Path(os.path.expanduser(place))


def existing(place: Any) -> Any:
    """A place to read, or the folder below data/ that a plain name may mean where only that exists."""
    if not isinstance(place, str | Path) or is_url(place) or os.path.lexists(local(place)):
        return place
    below = in_data(place)
    return below if below is not None and os.path.lexists(below) else place


def in_data(name: str | Path) -> Path | None:
    """The folder below data/ of a plain name; None for a path from the root, or one that leads upwards."""
    return None if os.path.isabs(name) or ".." in Path(name).parts else Path("data", name)


def refuse_url(*places: Any) -> None:
    """Raise UsageError if one of the places is a URL."""
    for place in places:
        if (url := url_of(place)) is not None:
            raise _url_refused(url)


def _url_refused(url: str) -> UsageError:
    return UsageError(f"{printable(public_url(url))}: found a URL, expected a path on this machine")


def _file_system(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it: pyarrow's, or fsspec's if pyarrow has none."""
    from pyarrow import ArrowException, ArrowNotImplementedError
    from pyarrow.fs import FileSystem, FSSpecHandler, PyFileSystem

    scheme = f"{url.partition('://')[0]}://"
    try:
        file_system: tuple[Any, str] = FileSystem.from_uri(url)
    except ImportError:  # for some schemes, such as hf://, pyarrow itself imports fsspec
        pass
    except (ArrowException, OSError) as error:
        if not isinstance(error, ArrowNotImplementedError) and "Unrecognized filesystem" not in str(error):
            raise UsageError(f"{printable(url)}: {reason(error)}") from None
    else:
        return file_system
    try:
        import fsspec
    except ImportError:
        raise missing(scheme, "fsspec", "remote") from None
    try:
        files, path = fsspec.core.url_to_fs(url)
    except ImportError as error:
        raise UsageError(f"{scheme} needs a plug-in of fsspec: {reason(error)}") from None
    except Exception as error:  # whatever a plug-in raises
        raise UsageError(f"{printable(url)}: {reason(error)}") from None
    return PyFileSystem(FSSpecHandler(files)), path
