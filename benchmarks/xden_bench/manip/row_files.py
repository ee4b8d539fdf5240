"""Writing rows, each a JSON file that says what was tried, and by what."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from xden_bench.entries.durable import write_text
from xden_bench.entries.result import slug
from xden_bench.manip.choosing import Chooser
from xden_bench.manip.item import Item
from xden_bench.manip.rows import SCHEMA, ObjectRow, TrialRow
from xden_bench.manip.scenes import Scenes

__all__ = ["file_name", "write_row"]


def write_row(
    out: Path,
    scenes: Scenes,
    chooser: Chooser,
    trials: Sequence[Sequence[TrialRow]],
    facts: Mapping[str, Any],
) -> Path:
    """Write a row.

    Parameters
    ----------
    out
        Folder of the rows.
    scenes
        That were tried.
    chooser
        Whose row it is.
    trials
        Of each object of the scenes.
    facts
        More that it says.
    """
    values = {
        "schema": SCHEMA,
        "simulated": True,
        "method": chooser.name,
        "inputs": list(chooser.inputs),
        "submission_sha256": chooser.submission_sha256,
        "submission_command": chooser.submission_command,
        "without_mass": list(chooser.without_mass),
        "scenes_sha256": scenes.sha256,
        **{name: scenes.facts[name] for name in ("protocol", "mujoco", "tier", "dataset")},
        **facts,
        "objects": [
            _object(item, chooser, tuple(tried)).columns()
            for item, tried in zip(scenes.items(), trials, strict=True)
        ],
    }
    path = out / file_name(chooser)
    write_text(path, json.dumps(values, allow_nan=False) + "\n")
    return path


def file_name(chooser: Chooser) -> str:
    """Name of a row's file: a submission cannot take that of a control, nor leave the folder.

    Examples
    --------
    >>> file_name(Chooser("../true", "nearest", {}, submission_sha256="0123456789"))
    'true-01234567.json'
    """
    if not chooser.submission_sha256:
        return f"{chooser.name}.json"
    return f"{slug(chooser.name)}-{chooser.submission_sha256[:8]}.json"


def _object(item: Item, chooser: Chooser, trials: tuple[TrialRow, ...]) -> ObjectRow:
    centre = chooser.centres_cm.get(item.object_id)
    error = None if centre is None else item.along_cm(centre)
    one = item
    return ObjectRow(one.object_id, one.category, one.stratum, one.mass.mass_g, error, trials)
