"""Pydantic models of a dataset's JSON files, against which these files are checked when they are read."""

from __future__ import annotations

from typing import Annotated, Any, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, RootModel, ValidationError

from ibdata._numerics.naming import NAME_PATTERN
from ibdata._system.files import FileEntry
from ibdata.errors import printable

SAFE_PATH = r"^(data|meta)/[a-z0-9][a-z0-9._-]{0,100}$"
SHA256 = "^[0-9a-f]{64}$"
MEANT = {SAFE_PATH: "a path in data/ or meta/", SHA256: "64 hex digits"}

Count = Annotated[int, Field(ge=0, lt=2**63)]
Sha256 = Annotated[str, Field(pattern=SHA256)]
Path = Annotated[str, Field(pattern=SAFE_PATH)]
Name = Annotated[str, Field(pattern=NAME_PATTERN)]
ColumnName = Annotated[str, Field(pattern="^[a-z][a-z0-9_]{0,63}$")]
Unchecked = dict[str, Any]  # a JSON object of an experiment, which `ibdata.experiment` checks
Quantile = Literal["0.01", "0.05", "0.25", "0.5", "0.75", "0.95", "0.99"]


class JsonObject(BaseModel):
    """A JSON object with the keys of its model and no others."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, defer_build=True)

    def plain(self) -> dict[str, Any]:
        """The object as JSON data, without the keys that were not set."""
        return self.model_dump(exclude_unset=True)


class File(JsonObject):
    """A file of a dataset, in the manifest."""

    path: Path
    bytes: Count
    sha256: Sha256


class ShardEntry(JsonObject):
    """A shard in the manifest. `episodes` is [first, stop]; `content` is the SHA-256 of their digests."""

    path: Path
    rows: Annotated[int, Field(ge=1, lt=2**63)]
    experiment: Count
    episodes: Annotated[list[Count], Field(min_length=2, max_length=2)]
    splits: list[Name]
    content: Sha256


class Code(JsonObject):
    """The code of a custom policy: its module, other files, and the versions of installed packages."""

    target: str
    version: str | None
    sha256: Sha256 | None
    files: dict[str, Sha256 | None] = {}
    distributions: dict[str, str] = {}


class Manifest(JsonObject):
    """meta/manifest.json."""

    format: Literal["ibdata-manifest"]
    version: Literal[2]
    data_version: Count
    content_root: Sha256
    name: Name
    experiments: Annotated[list[Unchecked], Field(min_length=1)]
    rows: Count
    clipped_actions: Count
    shards: Annotated[list[ShardEntry], Field(min_length=1)]
    files: Annotated[list[File], Field(min_length=1)]
    versions: dict[str, str]
    reproducible: bool | Literal["same-environment"]
    code: list[Code]
    checksum: Sha256

    def entries(self) -> dict[str, FileEntry]:
        """The listed files by their paths."""
        return {file.path: FileEntry(file.path, file.bytes, file.sha256) for file in self.files}

    @property
    def data_bytes(self) -> int:
        """The bytes of all shards."""
        return sum(file.bytes for file in self.files if file.path.startswith("data/"))


class Counts(JsonObject):
    """The sizes of a dataset; `steps` is null if its episodes differ in length."""

    rows: Count
    episodes: Count
    steps: Count | None
    cells: Count
    shards: Count


class SplitEntry(JsonObject):
    """A split in meta/splits.json. A declared one consists of whole files, see `ShardEntry.splits`.

    A later one has its definition, and its episodes as runs [first, stop].
    """

    episodes: Count
    rows: Count
    declared: bool
    split: Unchecked = {}
    runs: list[Annotated[list[Count], Field(min_length=2, max_length=2)]] = []


class SplitsFile(RootModel[dict[Name, SplitEntry]]):
    """meta/splits.json: the splits by name."""

    model_config = ConfigDict(strict=True, frozen=True)


class ColumnEntry(JsonObject):
    """A column of the rows; a bound is null if there is none."""

    name: ColumnName
    role: Annotated[str, Field(pattern="^[a-z_]{1,63}$")]
    dtype: Literal["int64", "int32", "float32", "float64", "bool", "string"]
    unit: str
    low: float | None
    high: float | None
    description: str


class Info(JsonObject):
    """meta/dataset.json."""

    format: Literal["ibdata-dataset"]
    version: Literal[1]
    name: Name
    dynamics: str | Unchecked
    drifting: bool
    start: str | Unchecked
    counts: Counts
    columns: Annotated[list[ColumnEntry], Field(min_length=1)]

    def names(self, role: str) -> list[str]:
        """The names of the columns of a role."""
        return [column.name for column in self.columns if column.role == role]


class Statistic(JsonObject):
    """Statistics of the rows of a column that have a number, which `count` counts; null if there are none."""

    count: Count
    mean: float | None
    std: float | None
    min: float | None
    max: float | None
    quantiles: Annotated[dict[Quantile, float | None], Field(min_length=7)]


class Statistics(JsonObject):
    """meta/statistics.json. `splits` are the declared ones."""

    format: Literal["ibdata-statistics"]
    version: Literal[1]
    all: dict[ColumnName, Statistic]
    splits: dict[Name, dict[ColumnName, Statistic]]


Parsed = TypeVar("Parsed", bound=BaseModel)


def parse(model: type[Parsed], data: Any) -> Parsed:
    """Parse JSON data as a model. Raises ValueError with a message of one line if they have another form."""
    try:
        return model.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
    where = printable(".".join(str(part) for part in first["loc"]) or "top")
    if first["type"] == "missing":
        raise ValueError(f"{where}: missing, expected a value")
    if first["type"] == "value_error":  # of a validator of ibdata, which says it all
        raise ValueError(f"{where}: {first['ctx']['error']}")
    value = printable(repr(first["input"]))[:60]
    expected = MEANT.get(first.get("ctx", {}).get("pattern", ""), first["msg"])
    raise ValueError(f"{where}: found {value}, expected {expected}")
