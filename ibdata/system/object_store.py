"""Old names of `ibdata.system.storage`, for `generation` and `maintenance` until they are rewritten."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ibdata.errors import DatasetError
from ibdata.system.storage import MAX_BYTES, is_url, reason, refuse_url, storage, url_of
from ibdata.system.storage import Remote as NewRemote

__all__ = ["Remote", "first_line", "is_url", "readable", "refuse_url", "storage", "url_of"]
first_line = reason


class Remote(NewRemote):
    """As before: `read` gives None for a missing file."""

    def read(self, path: str, most: int = MAX_BYTES) -> bytes | None:  # type: ignore[override]
        try:
            return super().read(path, most)
        except FileNotFoundError:
            return None


@contextmanager
def readable(remote: NewRemote, path: str) -> Iterator[None]:
    """Turn errors of the storage into a DatasetError of one line."""
    try:
        yield
    except OSError as error:
        raise DatasetError(f"{remote.name}/{path}: cannot be read: {first_line(error)}") from None
