"""A copy of a dataset folder with disturbed radiographs."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from xden1k.documents.maintainer import Answers
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, write_rows
from xden1k.format.manifest import Disturbed, Manifest
from xden1k.format.records import radiograph_columns, row_object
from xden1k.values.types import PRIVATE
from xden_bench.datasets.disturbances import Disturbance
from xden_bench.scoring.submission import Progress

__all__ = ["chosen_splits", "disturb"]


def chosen_splits(folder: DatasetFolder, split: str | None) -> tuple[str, ...]:
    """Return the splits that a copy has.

    Parameters
    ----------
    folder
        The dataset.
    split
        The only one; None = all.

    Raises
    ------
    DataError
        If there is no such split, one is ``private``, an object has no radiographs, or they are
        disturbed already.
    """
    manifest = folder.manifest
    if manifest.disturbed:
        raise DataError(f"{folder.root}: its radiographs {manifest.disturbed.radiographs} already")
    splits = tuple(manifest.splits) if split is None else (split,)
    for each in splits:
        folder.ids(each)  # refuses what is not there
        if without := manifest.without_radiographs.get(each, 0):
            raise DataError(
                f"{folder.root}: {without} objects of the split {each} have no radiographs that "
                "could be disturbed"
            )
    if PRIVATE in splits:
        raise DataError(
            f"{folder.root}: of the split {PRIVATE} no copy can be scored; name another split"
        )
    return splits


def disturb(
    folder: DatasetFolder,
    out: Path,
    disturbance: Disturbance,
    splits: Sequence[str],
    *,
    seed: int = 0,
    progress: Progress = iter,
) -> Manifest:
    """Write a copy of a dataset folder in which radiographs are disturbed, and nothing else.

    Previews go with the radiographs, and manifest, card, datasheet and Croissant file say what was
    done. The copy appears whole or not at all; the same arguments give the same bytes.

    Parameters
    ----------
    folder
        The dataset.
    out
        The folder to make.
    disturbance
        What is done.
    splits
        From :func:`chosen_splits`.
    seed
        Of what is drawn: with the CRC-32 of its id, each object's own.
    progress
        Goes through the object ids.

    Raises
    ------
    DataError
        If there is something at ``out``, or an object cannot be disturbed so.
    """
    if out.exists():
        raise DataError(f"{out} exists: remove it yourself, or choose another")
    manifest = folder.manifest
    ids = sorted({each for split in splits for each in folder.ids(split)} - {*disturbance.left_out})
    return write_rows(
        (_row(folder, object_id, disturbance, seed) for object_id in progress(ids)),
        out,
        version=manifest.version,
        builder=manifest.builder,
        config_sha256=manifest.config_sha256,
        answers=Answers.of_folder(folder.root),
        disturbed=Disturbed(disturbance.words, seed, folder.manifest_sha256),
    )


def _row(
    folder: DatasetFolder, object_id: str, disturbance: Disturbance, seed: int
) -> Mapping[str, Any]:
    row = folder.row(object_id)
    rng = np.random.default_rng((seed, zlib.crc32(object_id.encode())))
    views = disturbance(row_object(row), rng)
    meta = json.loads(row["meta_json"])
    meta["views"] = {view.name: view.geometry.to_dict() for view in views}
    text = json.dumps(meta, sort_keys=True, ensure_ascii=False, allow_nan=False)
    return {**row, **radiograph_columns(views), "meta_json": text}
