"""Where the pictures of an object come from: a scene folder, or, for phantoms, the renderer."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.types import DensityObject
from xden_baselines.views.cameras import Rig
from xden_baselines.views.pictures import Pictures
from xden_baselines.views.rendering import Rendered, Surface, render
from xden_baselines.views.scenes import read_scene

__all__ = ["RenderedPhantoms", "SceneFolders", "open_pictures", "render_object"]

DEFAULT_RIG = Rig()
"""24 views of 320 by 320 pixels."""


@dataclass(frozen=True, slots=True)
class RenderedPhantoms:
    """Draws phantoms in the colours of their parts.

    Parameters
    ----------
    rig
        Where the cameras are.
    """

    rig: Rig = DEFAULT_RIG

    def __call__(self, folder: DatasetFolder, object_id: str) -> Pictures:
        """Draw an object.

        Raises
        ------
        DataError
            If it is no phantom: the parts of others have no true colours.
        """
        obj = folder.object(object_id)
        if obj.source != "phantom":
            raise DataError(
                f"{object_id}: its parts have no true colours, for its source is {obj.source!r}: "
                "name a folder of scenes with pictures"
            )
        return render_object(obj, self.rig).pictures


@dataclass(frozen=True, slots=True)
class SceneFolders:
    """Reads scene folders; that of an object has its id as name.

    Parameters
    ----------
    root
        Where they are.
    """

    root: Path

    def __call__(self, folder: DatasetFolder, object_id: str) -> Pictures:
        """Read the pictures of an object.

        Raises
        ------
        DataError
            If there is no folder of that name, or it breaks the layout.
        """
        scene = self.root / object_id
        if not scene.is_dir():
            raise DataError(f"{object_id}: no scene folder {scene}")
        parts = folder.object(object_id).parts
        # the first surface a ray meets is the outer one
        triangles = np.concatenate([np.asarray(part.mesh.triangles) for part in parts])
        return read_scene(scene, Surface(triangles))


def open_pictures(views: Path | None = None) -> RenderedPhantoms | SceneFolders:
    """Return the source of pictures: scene folders if a place is given, else the renderer.

    Raises
    ------
    DataError
        If the place is no folder.
    """
    if views is None:
        return RenderedPhantoms()
    if not views.is_dir():
        raise DataError(f"{views}: no folder of scenes")
    return SceneFolders(views)


def render_object(obj: DensityObject, rig: Rig = DEFAULT_RIG) -> Rendered:
    """Draw an object from all around, and say which part each pixel shows.

    For methods that read ``PARTS`` and for training; others get the pictures alone.
    """
    meshes = [part.mesh for part in obj.parts]
    vertices = np.concatenate([np.asarray(mesh.vertices) for mesh in meshes])
    return render(meshes, [part.color_rgb for part in obj.parts], rig.cameras(vertices))
