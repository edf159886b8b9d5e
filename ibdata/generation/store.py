"""A store of objects at a URL as the place at which a dataset comes to be: in the hidden part beside it.

A store has no lock and no rename, but shards have names that say what is in them: whoever makes a shard makes
the same object, and what is copied twice is there once. The manifest is put at the place last.
"""

from __future__ import annotations

import hashlib
import json
import re
import secrets
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cached_property

from ibdata._system.part import refusing_system_errors
from ibdata._system.runs import Run, StoreRun, note_of, runs_at
from ibdata._system.signals import ignore, stoppable
from ibdata._system.storage import Remote, Storage
from ibdata.dataset import manifest
from ibdata.dataset.models import Manifest
from ibdata.errors import OUT, OVERWRITE, BusyError, DatasetError, IbdataError, UsageError, notice, reason
from ibdata.generation.folder import Documents
from ibdata.generation.metadata import as_json
from ibdata.generation.record import Record
from ibdata.generation.shard import AT_ONCE, WrittenShard

SHARD = re.compile(r"data/part-[0-9]{5,}-[0-9a-f]+[.]parquet")


class Store:
    """A `BuildPlace` at a URL, without locks and renames.

    Each run has a name in the part, which is only an address: equal commands begin the same run.
    """

    replaces = False

    def __init__(self, url: str) -> None:
        self.files = Remote(url)
        self.name = self.files.name
        if len(self.files.parts) < 2:
            raise UsageError(f"{self.name}: is a whole bucket, expected a name in it, as {self.name}/name")
        self._sizes: dict[str, int] = {}
        self._documents: dict[str, bytes] = {}

    def refuse(self, overwrite: bool) -> None:
        if overwrite:
            remedy = f"remove what is there, or choose another {OUT}"
            raise UsageError(f"{self.name}: {OVERWRITE} is for folders; {remedy}")
        manifest.refuse_name(self.files.parts, self.name)
        if self.files.folder is not None:
            manifest.refuse_inside(self.files.folder)
        if self._around is not None:
            raise UsageError(
                f"{self.name}: lies within the dataset {self._around}; choose a place outside of it"
            )

    @cached_property
    def _around(self) -> str | None:
        return self.files.around(manifest.PATH)

    def found(self) -> Storage | None:
        try:
            self._sizes = self.files.sizes()
            if manifest.PATH not in self._sizes:
                if self._publishing():
                    return None
                self._sizes = self.files.sizes()  # a run may have ended since the first look
        except OSError as error:
            raise DatasetError(f"{self.name}: cannot be read: {reason(error)}") from None
        return self.files if self._sizes else None

    def size_of(self, path: str) -> int | None:
        return self._sizes.get(path)

    def refuse_replacing(self, listed: Manifest) -> None:
        """Nothing is replaced here."""

    def _publishing(self) -> list[StoreRun]:
        """The runs whose files are being copied to the place, or were until a kill."""
        return [run for run in self._runs() if note_of(run).get("manifest")]

    def _runs(self) -> list[StoreRun]:
        return [run for run in runs_at(self.files) if isinstance(run, StoreRun)]

    def new_run(self, record: Record) -> Run:
        content = secrets.token_bytes(8) if record.live else as_json(record)
        return StoreRun(self.files.part.below(hashlib.sha256(content).hexdigest()[:16]))

    @contextmanager
    def hold(self, shared: bool) -> Iterator[None]:
        with refusing_system_errors(self.name, "; the same command goes on"), stoppable():
            yield

    def begin(self, run: Run, record: Record) -> bool:
        if note_of(run):
            return False
        record.write(run)
        return True

    def gather(self, run: Run, record: Record, written: list[WrittenShard], documents: Documents) -> None:
        """Note the checksum of the manifest, and copy all but the manifest to the place.

        Two runs that do so at once both note it before they look for others, so at least one sees the other.
        """
        made, self._documents = run.dataset(), dict(documents)
        assert isinstance(made, Remote)
        noted, checksum = note_of(run).get("manifest"), json.loads(self._documents[manifest.PATH])["checksum"]
        if noted != checksum:
            record.model_copy(update={"manifest": checksum}).write(run)
        others = [other for other in self._publishing() if other.name != run.name]
        is_taken = self.files.size(manifest.PATH) is not None  # then others may be removed already
        if (others or is_taken) and noted is None:
            record.write(run)
        if is_taken:
            return
        if others:
            raise BusyError(
                f"{self.name}: another run is being published here, or was until a kill; the same command as "
                f"then goes on with it, else remove {self.shown(others[0])}"
            )
        shards, found = {shard.entry.path: shard.entry.bytes for shard in written}, self.files.sizes()
        for path in sorted(found.keys() - shards.keys() - self._documents.keys()):
            if not SHARD.fullmatch(path):
                strange = f"{self.files.where(path)}: found a file that is not the dataset's"
                raise UsageError(f"{strange}; move it away")
            self.files.remove(path)  # which a run that nobody goes on with has left
        missing = [path for path, size in shards.items() if found.get(path) != size]
        with ThreadPoolExecutor(AT_ONCE) as threads:
            list(threads.map(lambda path: self.files.copy_from(made, path), missing))
        for path, data in self._documents.items():
            if path != manifest.PATH:
                self.files.put_bytes(data, path)

    def appear(self, run: Run, record: Record, replace: bool) -> None:
        self.files.put_bytes(self._documents[manifest.PATH], manifest.PATH)

    def clear(self, run: Run) -> None:
        assert isinstance(run, StoreRun)
        ignore()  # the dataset is there
        try:
            self._remove(run)
        except OSError as error:
            notice(f"{run.name}: cannot be removed: {reason(error)}; it is needed no more, remove it")

    def tidy(self) -> None:
        with suppress(OSError, IbdataError):
            checksum = manifest.checksum_in(self.files)
            published = [run for run in self._runs() if note_of(run).get("manifest") == checksum]
            for run in published if checksum else ():
                self._remove(run)

    def _remove(self, run: StoreRun) -> None:
        run.remove()
        if not self.files.part.names(""):
            self.files.part.remove()  # an empty folder, or the mark that pyarrow leaves for one

    def shown(self, files: Run | Storage) -> str:
        return files.name
