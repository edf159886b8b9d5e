"""The description of a dataset in Croissant 1.1, with the minimal fields on responsible AI.

https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Any

from ibdata.dataset import manifest
from ibdata.dataset.models import Column
from ibdata.experiment.dataset_spec import DatasetSpec
from ibdata.system.files import FileEntry
from ibdata.version import DATE, __version__
from ibdata.writing.card import ABOUT, KEYWORDS, bibtex, facts, how_to_make_again
from ibdata.writing.metadata import info, splits
from ibdata.writing.shard import WrittenShard

Json = dict[str, Any]

TERMS = """
annotation arrayShape citeAs column containedIn equivalentProperty excludes extract field fileObject
fileProperty fileSet format includes isArray isLiveDataset jsonPath key md5 parentField path readLines
recordSet references regex repeated replace samplingRate sdVersion separator source subField transform
unArchive
"""
CONTEXT = {  # the usual one, which readers expect whole
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "prov": "http://www.w3.org/ns/prov#",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    **{term: f"cr:{term}" for term in TERMS.split()},
}
CONFORMS_TO = ["http://mlcommons.org/croissant/1.1", "http://mlcommons.org/croissant/RAI/1.0"]
BENCHMARK = "https://arxiv.org/abs/1709.09480"
RESPONSIBLE = {
    "rai:dataCollection": "Simulated from the experiment in meta/: nothing was measured, nobody was asked.",
    "rai:dataCollectionType": ["Simulation"],
    "rai:hasSyntheticData": True,
    "rai:personalSensitiveInformation": ["None: every number is simulated."],
    "rai:dataLimitations": [
        "The data are those of a benchmark, which is modelled on no single plant.",
        "Episodes end at a time limit; the benchmark has no terminal states.",
    ],
    "rai:dataBiases": [
        "States and actions are as frequent as the behaviour policies make them; there are no others.",
    ],
    "rai:dataUseCases": [
        "Research on offline reinforcement learning: learning, evaluating and selecting policies, learning "
        "models of the dynamics. Not the control of a real plant.",
    ],
    "rai:dataSocialImpact": "The data describe no person, group or place.",
}
OTHER_TYPES = {"bool": "sc:Boolean", "string": "sc:Text"}  # than cr:Int32, cr:Float64 and their like
PARQUET = "application/x-parquet"
FORMATS = {"parquet": PARQUET, "json": "application/json", "yaml": "application/yaml"}
USES = {"train": "cr:TrainingSplit", "validation": "cr:ValidationSplit", "test": "cr:TestSplit"}


def croissant(
    spec: DatasetSpec, written: Sequence[WrittenShard], entries: Iterable[FileEntry], root: str
) -> Json:
    """The description of a dataset as JSON.

    Args:
        spec: The experiments and splits of the dataset; those of its splits that are labels have no files.
        written: Its shards with their file entries; their content is not needed.
        entries: All files that the manifest lists, but for this one.
        root: Its content root.
    """
    files = {name: [w.entry.path for w in written if name in w.shard.splits] for name in spec.declared}
    columns = info(spec).columns
    distribution = [_folder(root), _file_set("files", ["data/part-*.parquet"])]
    distribution += [_file_set(f"files/{name}", paths) for name, paths in files.items()]
    distribution += [_file(entry) for entry in entries if entry.path != manifest.CROISSANT]
    record_sets = [_rows("rows", "files", columns, described=True)]
    record_sets += [_rows(f"split/{name}", f"files/{name}", columns) for name in files]
    return {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS_TO,
        "name": spec.name,
        "description": " ".join([ABOUT, *(f"{name.capitalize()}: {value}." for name, value in facts(spec))]),
        "url": BENCHMARK,
        "creator": {"@type": "Organization", "name": "The ibdata developers"},
        "datePublished": DATE,
        "version": f"{manifest.DATA_VERSION}.0.0",
        "license": [_licence(licence) for licence in spec.licences],
        "citeAs": bibtex(spec.name, root, __version__),
        "keywords": KEYWORDS,
        **RESPONSIBLE,
        "prov:wasDerivedFrom": [{"@id": BENCHMARK, "prov:label": "The Industrial Benchmark"}],
        "prov:wasGeneratedBy": [_activity(spec, distribution, root)],
        "distribution": distribution,
        "recordSet": [*record_sets, *_splits(spec)],
    }


def _activity(spec: DatasetSpec, distribution: Sequence[Json], root: str) -> Json:
    """What made the dataset, of which experiments, and the hash that names its content."""
    ids = [file["@id"] for file in distribution]
    return {
        "@type": "prov:Activity",
        "prov:label": "Simulation of the experiment",
        "description": " ".join(how_to_make_again(spec)),
        "prov:used": [{"@id": path} for path in ids if path.startswith("meta/experiment")],
        "prov:wasAssociatedWith": {
            "@type": "prov:SoftwareAgent",
            "prov:label": "ibdata",
            "softwareVersion": __version__,
        },
        "prov:generated": {"@type": "prov:Entity", "prov:label": "content root", "identifier": root},
    }


def _head(kind: str, name: str) -> Json:
    return {"@type": f"cr:{kind}", "@id": name, "name": name}


def _folder(root: str) -> Json:
    """The folder around meta/, by which files are found in it; a file object needs a hash."""
    return {
        **_head("FileObject", "dataset"),
        "description": "The folder of the dataset, or its repository. The hash is the content root.",
        "contentUrl": "..",
        "encodingFormat": ["inode/directory", "git+https"],
        "sha256": root,
    }


def _file(entry: FileEntry) -> Json:
    return {
        **_head("FileObject", entry.path),
        "contentUrl": f"../{entry.path}",
        "contentSize": f"{entry.bytes} B",
        "encodingFormat": FORMATS.get(entry.path.rpartition(".")[2], "application/octet-stream"),
        "sha256": entry.sha256,
    }


def _file_set(name: str, includes: Sequence[str]) -> Json:
    return {
        **_head("FileSet", name),
        "containedIn": {"@id": "dataset"},
        "encodingFormat": PARQUET,
        "includes": list(includes),
    }


def _rows(name: str, files: str, columns: Sequence[Column], described: bool = False) -> Json:
    """The rows of a set of files, perhaps with the meaning, unit and bounds of each column."""
    return {
        **_head("RecordSet", name),
        "key": [{"@id": f"{name}/episode"}, {"@id": f"{name}/step"}],
        "field": [
            {
                "@type": "cr:Field",
                "@id": f"{name}/{column.name}",
                "name": column.name,
                "dataType": OTHER_TYPES.get(column.dtype, f"cr:{column.dtype.capitalize()}"),
                **(_meaning(column) if described else {}),
                "source": {"fileSet": {"@id": files}, "extract": {"column": column.name}},
            }
            for column in columns
        ],
    }


def _meaning(column: Column) -> Json:
    bounds = {"minValue": column.low, "maxValue": column.high}
    known = {name: value for name, value in bounds.items() if value is not None}
    return {"description": column.description, "unitText": column.unit, **known}


def _splits(spec: DatasetSpec) -> list[Json]:
    """The record set of the declared splits; there is none without them."""
    declared = {name: entry for name, entry in splits(spec).items() if entry.declared}
    if not declared:
        return []
    types = {"name": "sc:Text", "url": "sc:URL", "episodes": "cr:Int64", "rows": "cr:Int64"}
    values = [(name, USES.get(name), entry.episodes, entry.rows) for name, entry in declared.items()]
    ids = [f"splits/{name}" for name in types]
    return [
        {
            **_head("RecordSet", "splits"),
            "dataType": "cr:Split",
            "key": {"@id": ids[0]},
            "field": [
                {"@type": "cr:Field", "@id": id, "name": name, "dataType": types[name]}
                for id, name in zip(ids, types, strict=True)
            ],
            "data": [dict(zip(ids, row, strict=True)) for row in values],
        }
    ]


def _licence(licence: str) -> str:
    """The page of an SPDX identifier; any other expression as it is."""
    known = re.fullmatch(r"(?!LicenseRef-)[\w.-]+", licence)
    return f"https://spdx.org/licenses/{licence}" if known else licence
