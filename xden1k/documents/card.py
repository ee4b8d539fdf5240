"""The texts beside the data, made from the manifest: Hub card, citation, registration."""

from __future__ import annotations

from typing import Any, Final

import pyarrow as pa
import yaml  # type: ignore[import-untyped]

from xden1k.documents.statements import (
    dataset_title,
    disturbed_text,
    label_voxels_text,
    licence_text,
    materials_text,
    provenance_text,
    published_text,
    radiographs_text,
    shapes_text,
)
from xden1k.format.manifest import Manifest
from xden1k.format.schema import COLUMNS, IMAGE, LIGHT_COLUMNS, Column
from xden1k.values.types import PRIVATE

__all__ = [
    "AUTHORS",
    "CONFIGS",
    "HOMEPAGE",
    "bibtex",
    "bibtex_entry",
    "citation_text",
    "eval_text",
    "header",
    "readme_text",
    "yaml_block",
]

AUTHORS = (
    ("Jingxuan", "Zhang"),
    ("Tianqi", "Yu"),
    ("Yatu", "Zhang"),
    ("Jinze", "Wu"),
    ("Kaixin", "Yao"),
    ("Jingyang", "Liu"),
    ("Yuyao", "Zhang"),
    ("Jiayuan", "Gu"),
    ("Jingyi", "Yu"),
)
"""Given and family names of the paper's authors, arXiv 2512.10668."""
TAGS = ("x-ray", "density", "mass", "center-of-mass", "physical-properties", "3d")
PAPER_TITLE = "XDen-1K: A Density Field Dataset of Real-World Objects"
HOMEPAGE = "https://arxiv.org/abs/2512.10668"
"""Where the paper is."""
CONFIGS = {"default": COLUMNS, "metadata": COLUMNS[: len(LIGHT_COLUMNS)]}
"""Columns of each config."""
_GLOBS = {"default": "data/{}-*.parquet", "metadata": "metadata/{}.parquet"}
_VALUES = {pa.float64(): "float64", pa.int32(): "int32", IMAGE: "image"}


def header(manifest: Manifest, prefix: str = "", *, features: bool = True) -> dict[str, Any]:
    """YAML header of a Hub card.

    Parameters
    ----------
    manifest
        Of the folder.
    prefix
        Put before each path, where the card is not in the dataset folder itself.
    features
        Whether to list the columns and their types, which every Parquet file gives as well.
    """
    return {
        "language": ["en"],
        "license": "other" if manifest.on_partnext else "cc-by-4.0",
        "pretty_name": dataset_title(manifest),
        "size_categories": ["1K<n<10K" if manifest.objects >= 1000 else "n<1K"],
        "source_datasets": ["original"],
        "annotations_creators": ["machine-generated" if manifest.simulated else "expert-generated"],
        "task_categories": ["image-to-3d", "robotics"],
        "tags": [*TAGS, *(["synthetic"] if manifest.simulated else [])],
        "configs": [_config(manifest, name, prefix) for name in CONFIGS],
        "dataset_info": [_info(manifest, name, features) for name in CONFIGS],
    }


def _config(manifest: Manifest, name: str, prefix: str) -> dict[str, Any]:
    files = [
        {"split": split, "path": prefix + _GLOBS[name].format(split)} for split in manifest.splits
    ]
    default = {"default": True} if name == "default" else {}
    return {"config_name": name, **default, "version": manifest.version, "data_files": files}


def _info(manifest: Manifest, name: str, features: bool) -> dict[str, Any]:
    shards = {split: manifest.shards(name, split) for split in manifest.splits}
    splits = [
        {
            "name": split,
            "num_bytes": sum(file.num_bytes for file in files),
            "num_examples": sum(file.rows for file in files),
        }
        for split, files in shards.items()
    ]
    columns = [{"name": column.name} | _yaml_type(column.type) for column in CONFIGS[name]]
    return {
        "config_name": name,
        **({"features": columns} if features else {}),
        "splits": splits,
        "download_size": sum(file.bytes for file in manifest.shards(name)),
        "dataset_size": sum(split["num_bytes"] for split in splits),
    }


def _yaml_type(arrow_type: pa.DataType) -> dict[str, Any]:
    """Return the type as a card writes it."""
    if pa.types.is_fixed_size_list(arrow_type):
        return _yaml_list(arrow_type.value_type) | {"length": arrow_type.list_size}
    if pa.types.is_list(arrow_type):
        return _yaml_list(arrow_type.value_type)
    return {"dtype": _VALUES.get(arrow_type, str(arrow_type))}


def _yaml_list(item_type: pa.DataType) -> dict[str, Any]:
    item = _yaml_type(item_type)
    return {"list": item["dtype"] if item.keys() == {"dtype"} else item}


def yaml_block(values: dict[str, Any]) -> str:
    """YAML between the two lines that open a card."""
    return f"---\n{yaml.safe_dump(values, sort_keys=False, width=100, allow_unicode=True)}---\n"


_OBJECTS: Final = """\
Everyday objects with two radiographs (PA and LAT), closed part meshes and volumetric density.
One row is one object. Units are cm, g and g/cm³; attenuation is in 1/cm; a transmission of 1 is
air."""
_PROVENANCE: Final = (
    disturbed_text,
    shapes_text,
    provenance_text,
    radiographs_text,
    published_text,
)
_OBJECTS_WITHOUT_RADIOGRAPHS: Final = """\
Everyday objects with closed part meshes and volumetric density, without radiographs. One row is one
object. Units are cm, g and g/cm³; attenuation is in 1/cm."""
_DECODED_RADIOGRAPH: Final = """\
planes = np.frombuffer(row["xray_pa"], np.uint8).reshape(2, -1)
codes = (planes[0] | planes[1].astype(np.uint16) << 8).reshape(row["xray_pa_shape"])
transmission = codes * (1.25 / 65535)  # 0 = invalid pixel
"""


def readme_text(manifest: Manifest) -> str:
    """Text of ``README.md``: the card of the Hub repository."""
    decoded = _DECODED_RADIOGRAPH * manifest.has_radiographs
    return (
        yaml_block(header(manifest))
        + f"""
# {dataset_title(manifest)}, version {manifest.version}

{_OBJECTS if manifest.has_radiographs else _OBJECTS_WITHOUT_RADIOGRAPHS}

{_said(*(text(manifest) for text in _PROVENANCE))}

{_split_table(manifest)}

## Load

```python
import xden1k  # pip install xden1k: arrays decode
from datasets import load_dataset

ds = load_dataset("xden1k", split="{next(iter(manifest.splits))}")
train = xden1k.XDen1K(root="this/folder", split="train")  # torch samples
obj = train.object(train.ids[0])  # meshes, views, fields
```

Without the package a binary column is bytes: little-endian, C order, all lowest bytes first, then
all second bytes, and so on.

```python
import numpy as np

{decoded}labels = np.frombuffer(row["labels"], np.uint8).reshape(128, 128, 128)
```

The config `metadata` holds the light columns only, for browsing.

## Columns

{_column_table()}

A figure that was never measured is null (`weighed_mass_g`, `density`); one computed from an
unknown figure is not a number. Part k, 1 to K, is entry k - 1 of the `part_` lists. All grids fill
one cube, the bounding cube of the object with a 3 % margin: label voxels have half the edge of
field voxels and start a quarter of a field voxel lower on each axis.

## What labels do not tell

{label_voxels_text(manifest)}

{materials_text(manifest)}
{_withheld_text(manifest)}
## Check

`sha256sum -c SHA256SUMS` compares the files; `xden verify FOLDER` also every row.

## Licence and citation

Data: {licence_text(manifest)}. `DATASHEET.md` says how it was made and what it is not good for.

{bibtex()}
"""
    )


def _said(*paragraphs: str) -> str:
    return "\n\n".join(filter(None, paragraphs))


def _withheld_text(manifest: Manifest) -> str:
    if PRIVATE not in manifest.splits:
        return ""
    return f"""
In the split `{PRIVATE}` every answer is withheld, stored as if it were unknown. `commitments.json`
has a salted checksum of each object's answers, so that they cannot be changed afterwards.
"""


def _split_table(manifest: Manifest) -> str:
    lines = ["| split | objects | shards | MB |", "| --- | ---: | ---: | ---: |"]
    for split, count in manifest.splits.items():
        shards = manifest.shards(split=split)
        size = sum(file.bytes for file in shards) / 1e6
        lines.append(f"| {split} | {count} | {len(shards)} | {size:.1f} |")
    return "\n".join(lines)


def _column_table() -> str:
    lines = ["| column | type | what it is |", "| --- | --- | --- |"]
    lines += [f"| `{c.name}` | {type_name(c)} | {c.text} |" for c in COLUMNS]
    return "\n".join(lines)


def type_name(column: Column) -> str:
    """Type of a column, for people.

    Examples
    --------
    >>> [type_name(c) for c in COLUMNS if c.name in ("com_cm", "part_names", "labels")]
    ['float64[3]', 'list of string', 'uint8 (128, 128, 128)']
    """
    if column.codec is None:
        return _value_name(column.type)
    stored = {"|u1": "uint8", "<u2": "uint16", "<f2": "float16", "<f4": "float32", "<i4": "int32"}
    shape = column.codec.shape
    size = "(rows, columns)" if isinstance(shape, str) else str(shape).replace("-1", "n")
    return f"{stored[column.codec.stored]} {size}"


def _value_name(arrow_type: pa.DataType) -> str:
    if pa.types.is_fixed_size_list(arrow_type):
        return f"{_value_name(arrow_type.value_type)}[{arrow_type.list_size}]"
    if pa.types.is_list(arrow_type):
        return f"list of {_value_name(arrow_type.value_type)}"
    return _VALUES.get(arrow_type, str(arrow_type))


def bibtex() -> str:
    """Entry of the paper, as a Markdown block."""
    return f"```bibtex\n{bibtex_entry()}\n```"


def bibtex_entry() -> str:
    """Entry of the paper for BibTeX."""
    authors = " and ".join(f"{family}, {given}" for given, family in AUTHORS)
    return f"""@article{{zhang2025xden1k,
  title   = {{{PAPER_TITLE}}},
  author  = {{{authors}}},
  journal = {{arXiv preprint arXiv:2512.10668}},
  year    = {{2025}}
}}"""


def citation_text(manifest: Manifest) -> str:
    """Text of ``CITATION.cff``."""
    values = {
        "cff-version": "1.2.0",
        "message": "If you use the dataset, please cite the paper.",
        "title": dataset_title(manifest),
        "type": "dataset",
        **({} if manifest.on_partnext else {"license": "CC-BY-4.0"}),
        "version": manifest.version,
        "authors": [{"name": "The XDen-1K maintainers"}],
        "preferred-citation": {
            "type": "article",
            "title": PAPER_TITLE,
            "authors": [{"given-names": given, "family-names": name} for given, name in AUTHORS],
            "year": 2025,
            "month": 12,
            "journal": "arXiv preprint arXiv:2512.10668",
            "doi": "10.48550/arXiv.2512.10668",
            "url": HOMEPAGE,
        },
    }
    return str(yaml.safe_dump(values, sort_keys=False, width=100, allow_unicode=True))


def eval_text() -> str:
    """Text of ``eval.yaml``, which registers the benchmark on the Hub: one task per metric."""
    tasks = ("density-mae", "com-l1", "mass-mape")
    values = {
        "name": "XDen-1K",
        "description": "Volumetric density, mass and centre of mass of everyday objects.",
        "evaluation_framework": "xden-bench",
        "tasks": [{"id": task, "config": "default", "split": "test"} for task in tasks],
    }
    return str(yaml.safe_dump(values, sort_keys=False, width=100, allow_unicode=True))
