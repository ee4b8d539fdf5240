"""Where the pictures of an object come from: a scene folder, or, for phantoms, the renderer."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.values.types import DensityObject
from xden_baselines.views.cameras import Rig
from xden_baselines.views.pictures import Pictures
from xden_baselines.views.rendering import Rendered, Surface, render
from xden_baselines.views.scenes import read_scene

__all__ = ["RenderedPhantoms", "SceneFolders", "render_object"]

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

    @property
    def description(self) -> str:
        """How many views there are, and of what size."""
        views, size = len(self.rig.elevations_deg) * self.rig.per_ring, self.rig.size_px
        return f"{views} views of {size} x {size} px rendered in part colours"

    @property
    def fingerprint(self) -> str:
        """Where the cameras are."""
        return repr(self.rig)

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

    Raises
    ------
    DataError
        If that is no folder.
    """

    root: Path

    def __post_init__(self) -> None:
        if not self.root.is_dir():
            raise DataError(f"{self.root}: no folder of scenes")

    @property
    def description(self) -> str:
        """Say that they are files."""
        return "pictures from scene folders"

    @property
    def fingerprint(self) -> str:
        """Checksum of the cameras, and of names and sizes of all files."""
        digest = hashlib.sha256()
        for path in sorted(self.root.rglob("*")):
            if path.is_file():
                digest.update(f"{path.relative_to(self.root)} {path.stat().st_size}\n".encode())
            if path.name == "transforms.json":
                digest.update(path.read_bytes())
        return digest.hexdigest()

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


def render_object(obj: DensityObject, rig: Rig = DEFAULT_RIG) -> Rendered:
    """Draw an object from all around, and say which part each pixel shows.

    For methods that read ``PARTS`` and for training; others get the pictures alone.
    """
    meshes = [part.mesh for part in obj.parts]
    vertices = np.concatenate([np.asarray(mesh.vertices) for mesh in meshes])
    return render(meshes, [part.color_rgb for part in obj.parts], rig.cameras(vertices))
