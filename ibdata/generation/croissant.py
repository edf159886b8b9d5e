"""The description of a dataset in Croissant 1.1, with the minimal fields on responsible AI.

https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from typing import Any

from ibdata._system.files import FileEntry
from ibdata.dataset import manifest
from ibdata.dataset.models import ColumnEntry
from ibdata.generation.card import ABOUT, KEYWORDS, bibtex, facts, how_to_make_again
from ibdata.generation.metadata import info, splits
from ibdata.plan.dataset_spec import DatasetSpec
from ibdata.version import DATE, __version__

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
FORMATS = {"parquet": PARQUET, "table": PARQUET, "json": "application/json", "yaml": "application/yaml"}
SPDX = re.compile(r"(?!LicenseRef-)[\w.-]+")  # an identifier, which has a page; other expressions have none
USES = {"train": "cr:TrainingSplit", "validation": "cr:ValidationSplit", "test": "cr:TestSplit"}


def croissant(spec: DatasetSpec, entries: Collection[FileEntry], root: str) -> Json:
    """The content of croissant.json.

    Args:
        spec: The experiments and splits of the dataset; those of its splits that are labels have no files.
        entries: All files that the manifest lists, those of the shards in order; this one does not count.
        root: Its content root.
    """
    columns = info(spec).columns
    files = _distribution(spec, entries, root)
    record_sets = [_record_set("rows", "files", columns, described=True)]
    record_sets += [_record_set(f"split/{name}", f"files/{name}", columns) for name in spec.declared]
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
        "license": [
            f"https://spdx.org/licenses/{licence}" if SPDX.fullmatch(licence) else licence
            for licence in spec.licences
        ],
        "citeAs": bibtex(spec.name, root, __version__),
        "keywords": KEYWORDS,
        **RESPONSIBLE,
        "prov:wasDerivedFrom": [{"@id": BENCHMARK, "prov:label": "The Industrial Benchmark"}],
        "prov:wasGeneratedBy": [
            {
                "@type": "prov:Activity",
                "prov:label": "Simulation of the experiment",
                "description": " ".join(how_to_make_again(spec)),
                "prov:used": [{"@id": x["@id"]} for x in files if x["@id"].startswith("meta/experiment")],
                "prov:wasAssociatedWith": {
                    "@type": "prov:SoftwareAgent",
                    "prov:label": "ibdata",
                    "softwareVersion": __version__,
                },
                "prov:generated": {"@type": "prov:Entity", "prov:label": "content root", "identifier": root},
            }
        ],
        "distribution": files,
        "recordSet": [*record_sets, *_splits(spec)],
    }


def _head(kind: str, name: str) -> Json:
    return {"@type": f"cr:{kind}", "@id": name, "name": name}


def _distribution(spec: DatasetSpec, entries: Collection[FileEntry], root: str) -> list[Json]:
    """The folder around meta/, in which files are found, the files of all and of each split, each file."""
    folder = {
        **_head("FileObject", "dataset"),
        "description": "The folder of the dataset, or its repository. The hash is the content root.",
        "contentUrl": "..",
        "encodingFormat": ["inode/directory", "git+https"],
        "sha256": root,  # a file object needs one
    }
    paths = (entry.path for entry in entries if entry.path.startswith("data/"))
    shards = list(zip(spec.shards, paths, strict=True))
    sets = {"files": ["data/part-*.parquet"]}
    for name in spec.declared:
        sets[f"files/{name}"] = [path for shard, path in shards if name in shard.splits]
    file_sets = [
        {
            **_head("FileSet", name),
            "containedIn": {"@id": "dataset"},
            "encodingFormat": PARQUET,
            "includes": includes,
        }
        for name, includes in sets.items()
    ]
    file_objects = [
        {
            **_head("FileObject", entry.path),
            "contentUrl": f"../{entry.path}",
            "contentSize": f"{entry.bytes} B",
            "encodingFormat": FORMATS.get(entry.path.rpartition(".")[2], "application/octet-stream"),
            "sha256": entry.sha256,
        }
        for entry in entries
        if entry.path != manifest.CROISSANT
    ]
    return [folder, *file_sets, *file_objects]


def _record_set(name: str, files: str, columns: Sequence[ColumnEntry], described: bool = False) -> Json:
    """The rows of a set of files, perhaps with the meaning, unit and bounds of each column."""
    fields = []
    for column in columns:
        meaning: Json = {}
        if described:
            bounds = {"minValue": column.low, "maxValue": column.high}
            known = {key: bound for key, bound in bounds.items() if bound is not None}
            meaning = {"description": column.description, "unitText": column.unit, **known}
        fields.append(
            {
                "@type": "cr:Field",
                "@id": f"{name}/{column.name}",
                "name": column.name,
                "dataType": OTHER_TYPES.get(column.dtype, f"cr:{column.dtype.capitalize()}"),
                **meaning,
                "source": {"fileSet": {"@id": files}, "extract": {"column": column.name}},
            }
        )
    key = [{"@id": f"{name}/episode"}, {"@id": f"{name}/step"}]
    return {**_head("RecordSet", name), "key": key, "field": fields}


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
