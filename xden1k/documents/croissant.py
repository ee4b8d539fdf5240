"""The Croissant description of a dataset folder (MLCommons, version 1.1)."""

from __future__ import annotations

import json
from pathlib import PurePosixPath
from typing import Any, Final

import pyarrow as pa

from xden1k.documents.card import CONFIGS, HOMEPAGE, TAGS, bibtex_entry
from xden1k.documents.facts import Facts
from xden1k.documents.responsible import RAI_VERSION, responsible_fields
from xden1k.documents.statements import (
    dataset_title,
    disturbed_text,
    licence_text,
    published_text,
    radiographs_text,
    shapes_text,
)
from xden1k.format.manifest import Manifest
from xden1k.format.schema import IMAGE, Column

__all__ = ["croissant_text"]

CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "sc": "https://schema.org/",
    "cr": "http://mlcommons.org/croissant/",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "dct": "http://purl.org/dc/terms/",
    "conformsTo": "dct:conformsTo",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "name": {"@container": "@language"},
    "description": {"@container": "@language"},
} | {
    key: f"cr:{key}"
    for key in (
        *("arrayShape", "citeAs", "column", "containedIn", "equivalentProperty", "extract"),
        *("field", "fileObject", "fileProperty", "fileSet", "format", "includes", "isArray"),
        *("isLiveDataset", "jsonPath", "key", "md5", "parentField", "path", "recordSet"),
        *("references", "regex", "repeated", "replace", "samplingRate", "separator", "source"),
        *("subField", "transform"),
    )
}
"""The context of the specification: its own words, and those of schema.org."""

_TYPES = {pa.float64(): "cr:Float64", pa.int32(): "cr:Int32", pa.string(): "sc:Text"}


def croissant_text(facts: Facts, base_url: str = "", date_published: str = "") -> str:
    """Text of ``croissant.json``: a file object per shard, a record set per config.

    With ``base_url`` there is a record set per file instead: readers look for a set of files on a
    disk, in an archive or a Git repository, and fetch by its address one file at a time.

    Parameters
    ----------
    facts
        Of the folder.
    base_url
        Where the files are, ending in a slash. Without it their addresses are relative to the
        document, which readers follow only where it lies beside them on a disk.
    date_published
        Day on which it was published, ``YYYY-MM-DD``; empty where it was not.
    """
    manifest = facts.manifest
    values = {
        "@context": CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": ["http://mlcommons.org/croissant/1.1", RAI_VERSION],
        "name": dataset_title(manifest),
        "description": _description(manifest),
        "keywords": [*TAGS, *(["synthetic"] if manifest.simulated else [])],
        "version": manifest.version,
        **({"datePublished": date_published} if date_published else {}),
        "license": _LICENCE if not manifest.on_partnext else licence_text(manifest),
        "url": HOMEPAGE,
        "citeAs": bibtex_entry(),
        **responsible_fields(facts),
        "distribution": [
            *_file_objects(manifest, base_url),
            *([] if base_url else map(_file_set, CONFIGS)),
        ],
        "recordSet": _sets_of_files(manifest) if base_url else _sets_of_configs(),
    }
    return json.dumps(values, indent=2, ensure_ascii=False) + "\n"


_LICENCE: Final = "https://creativecommons.org/licenses/by/4.0/"


def _description(manifest: Manifest) -> str:
    xrays = "Biplanar X-rays, p" if manifest.has_radiographs else "P"
    text = f"{xrays}art meshes and volumetric density of everyday objects."
    simulated = "Simulated: no object was ever made, scanned or weighed."
    texts = (shapes_text, radiographs_text, disturbed_text, published_text)
    told = [one(manifest) for one in texts]
    return " ".join(filter(None, [text, simulated * manifest.simulated, *told]))


def _file_objects(manifest: Manifest, base_url: str) -> list[dict[str, Any]]:
    return [
        {
            "@type": "cr:FileObject",
            "@id": file.path,
            "name": file.path,
            "contentUrl": base_url + file.path,
            "contentSize": f"{file.bytes} B",
            "encodingFormat": "application/x-parquet",
            "sha256": file.sha256,
        }
        for file in manifest.files
    ]


def _file_set(config: str) -> dict[str, Any]:
    folder = "data" if config == "default" else config
    return {
        "@type": "cr:FileSet",
        "@id": f"{config}-files",
        "name": f"{config}-files",
        "encodingFormat": "application/x-parquet",
        "includes": f"{folder}/*.parquet",
    }


def _sets_of_configs() -> list[dict[str, Any]]:
    return [_record_set(name, name, {"fileSet": {"@id": f"{name}-files"}}) for name in CONFIGS]


def _sets_of_files(manifest: Manifest) -> list[dict[str, Any]]:
    """Name each ``CONFIG/FILE``, as in ``default/train-00000-of-00004`` and ``metadata/train``."""
    return [
        _record_set(
            f"{file.config}/{PurePosixPath(file.path).stem}",
            file.config,
            {"fileObject": {"@id": file.path}},
        )
        for file in manifest.files
    ]


def _record_set(name: str, config: str, source: dict[str, Any]) -> dict[str, Any]:
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": "One record per object.",
        "key": {"@id": f"{name}/object_id"},
        "field": [_field(name, column, source) for column in CONFIGS[config]],
    }


def _field(record_set: str, column: Column, source: dict[str, Any]) -> dict[str, Any]:
    # An image is a struct of its bytes and a path.
    transform = {"transform": {"jsonPath": "bytes"}} if column.type == IMAGE else {}
    return {
        "@type": "cr:Field",
        "@id": f"{record_set}/{column.name}",
        "name": column.name,
        "description": column.text,
        **_type(column),
        "source": {
            **source,
            "extract": {"column": column.name},
            **transform,
        },
    }


def _type(column: Column) -> dict[str, Any]:
    """Return data type and shape of lists; bytes have no type of their own in Croissant."""
    if column.type == IMAGE:
        return {"dataType": "sc:ImageObject"}
    if column.codec is not None:
        return {"dataType": "sc:Text"}
    shape, item = [], column.type
    while pa.types.is_list(item) or pa.types.is_fixed_size_list(item):
        shape.append(item.list_size if pa.types.is_fixed_size_list(item) else -1)
        item = item.value_type
    if not shape:
        return {"dataType": _TYPES[item]}
    return {
        "dataType": _TYPES[item],
        "isArray": True,
        "arrayShape": ",".join(map(str, shape)),
    }
