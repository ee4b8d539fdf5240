"""Where the pictures of an object come from: a scene folder, or, for phantoms, the renderer."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import trimesh

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.values.types import DensityObject
from xden_baselines.views.cameras import Camera, Rig
from xden_baselines.views.keeping import keep, name_of
from xden_baselines.views.pictures import Pictures
from xden_baselines.views.rendering import Rendered, Surface, render
from xden_baselines.views.scenes import read_scene
from xden_baselines.views.shaded.finishes import draw_looks
from xden_baselines.views.shaded.rendering import VERSION, render_shaded
from xden_baselines.views.shaded.studio import studio_of

__all__ = ["RenderedPhantoms", "SceneFolders", "ShadedPhantoms", "render_object"]

DEFAULT_RIG = Rig()
"""Twelve views of 256 by 256 pixels."""
FLAT_VERSION = "1"
"""Of all that decides what flat pictures look like."""


@dataclass(frozen=True, slots=True)
class RenderedPhantoms:
    """Draws phantoms in the colours of their parts, or takes what it drew before from the cache.

    Parameters
    ----------
    rig
        Where the cameras are.
    """

    rig: Rig = DEFAULT_RIG

    @property
    def description(self) -> str:
        """How many views there are, and of what size."""
        return f"{_views(self.rig)} rendered in part colours"

    @property
    def fingerprint(self) -> str:
        """Where the cameras are."""
        return repr(self.rig)

    @property
    def recipe(self) -> str:
        """All that decides the pixels but the object: renderer, version and rig."""
        return f"flat {FLAT_VERSION} {self.rig}"

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
        cameras = _cameras(obj, self.rig)
        return keep(name_of(obj, self.recipe), cameras, lambda: self._drawn(obj, cameras))

    def _drawn(self, obj: DensityObject, cameras: tuple[Camera, ...]) -> Pictures:
        meshes, colors = _meshes(obj), [part.color_rgb for part in obj.parts]
        return render(meshes, colors, cameras).pictures


@dataclass(frozen=True, slots=True)
class ShadedPhantoms(RenderedPhantoms):
    """Draws phantoms with their finish, in a room; or takes what it drew before from the cache."""

    @property
    def description(self) -> str:
        """How many views there are, of what size, and the version of their look."""
        return f"{_views(self.rig)} shaded by material (look {VERSION})"

    @property
    def recipe(self) -> str:
        """All that decides the pixels but the object: renderer, version and rig."""
        return f"shaded {VERSION} {self.rig}"

    def _drawn(self, obj: DensityObject, cameras: tuple[Camera, ...]) -> Pictures:
        looks = draw_looks(obj.object_id, obj.parts)
        return render_shaded(_meshes(obj), looks, cameras, studio_of(obj.object_id)).pictures


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
        """Checksum of the cameras, and of names, sizes and times of all files.

        Not of what is in them: pictures of a split may take longer to read than to answer for.
        """
        digest = hashlib.sha256()
        for path in sorted(self.root.rglob("*")):
            if path.is_file():
                about = path.stat()
                said = f"{path.relative_to(self.root)} {about.st_size} {about.st_mtime_ns}\n"
                digest.update(said.encode())
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
    """Draw an object flat from all around, and say which part each pixel shows.

    For methods that read ``PARTS`` and for training; others get the pictures alone.
    """
    return render(_meshes(obj), [part.color_rgb for part in obj.parts], _cameras(obj, rig))


def _meshes(obj: DensityObject) -> list[trimesh.Trimesh]:
    return [part.mesh for part in obj.parts]


def _cameras(obj: DensityObject, rig: Rig) -> tuple[Camera, ...]:
    return rig.cameras(np.concatenate([np.asarray(mesh.vertices) for mesh in _meshes(obj)]))


def _views(rig: Rig) -> str:
    views = len(rig.elevations_deg) * rig.per_ring
    return f"{views} views of {rig.size_px} x {rig.size_px} px"
