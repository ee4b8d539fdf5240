"""Pictures of a split as scene folders, for programs of others.

::

    DATA/  scenes/OBJECT_ID/...   nothing else is in here: NeRF2Physics and PUGS take all for scenes
           pictures.json          of what dataset they are, and how they were drawn
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden_baselines.views.scenes import write_scene
from xden_baselines.views.source import RenderedPhantoms

__all__ = ["export_scenes"]

ABOUT, SCENES = "pictures.json", "scenes"


def export_scenes(
    folder: DatasetFolder,
    split: str,
    source: RenderedPhantoms,
    out: Path,
    progress: Callable[[Iterable[str]], Iterable[str]] = iter,
) -> int:
    """Write ``scenes/OBJECT_ID`` for each object of a split, but for those that are there already.

    A scene appears whole, so an export that was interrupted goes on when it is called again.

    Parameters
    ----------
    folder, split
        The objects.
    source
        Draws them.
    out
        Folder of ``scenes``; made if it is missing.
    progress
        Iterates over the ids, and may show how far it is.

    Returns
    -------
    count
        How many were written.

    Raises
    ------
    DataError
        If there is no such split, an object cannot be drawn, or the folder has scenes of another
        dataset or drawn in another way.
    """
    ids = folder.ids(split)
    _claim(out, {"dataset": folder.manifest_sha256, "pictures": source.recipe})
    scenes = out / SCENES
    scenes.mkdir(exist_ok=True)
    missing = [object_id for object_id in ids if not (scenes / object_id).exists()]
    for object_id in progress(missing):
        fresh = out / f".{object_id}.partial"
        shutil.rmtree(fresh, ignore_errors=True)
        write_scene(source(folder, object_id), fresh)
        fresh.rename(scenes / object_id)
    return len(missing)


def _claim(out: Path, about: dict[str, str]) -> None:
    """Say what the folder's scenes are, if it does not say so already."""
    path, text = out / ABOUT, json.dumps(about, indent=1) + "\n"
    if path.exists():
        if path.read_text(encoding="utf-8") != text:
            raise DataError(f"{path}: scenes of another dataset, or drawn in another way")
        return
    if out.exists() and any(out.iterdir()):
        raise DataError(f"{out}: expected an empty folder or one of scenes, with {ABOUT}")
    out.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
