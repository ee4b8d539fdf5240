"""Part meshes as maintainers hand them over: moved, scaled, simplified and warped a little."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden1k.values.arrays import Points
from xden_builder.capture.solids import closed_mesh, simplified
from xden_builder.phantoms.shapes import from_mesh, to_mesh, without_splinters

__all__ = ["MeshError", "draw_mesh_error"]

WARP_LENGTH_CM: Final = 2.0
"""Of the Gaussian correlation between what a warp does to one point and to another."""
WAVES: Final = 200
"""Of random direction, length and phase, that a warp is added up of."""
AT_ONCE: Final = 20_000
"""Points that are moved, for the memory that it takes."""
FINER: Final = 4
"""Edges are so many times shorter than that length before they are warped."""


@dataclass(frozen=True, slots=True)
class MeshError:
    """How the part meshes of an object differ from the object on the scanner.

    A point x of the object is handed over as scale * R(rotation) x + shift.

    Parameters
    ----------
    rotation_deg
        Rotation vector about the origin of the object frame.
    shift_cm
        Along x, y and z.
    scale
        1 is right.
    tolerance_cm
        How far a simplified surface may leave the true one; 0: not simplified.
    warp_cm, warp_seed
        Standard deviation, along each axis, of a smooth random motion that all points then make,
        the same for all parts; and what it is drawn by.
    """

    rotation_deg: tuple[float, float, float]
    shift_cm: tuple[float, float, float]
    scale: float
    tolerance_cm: float
    warp_cm: float = 0.0
    warp_seed: int = 0

    @property
    def matrix(self) -> Float[np.ndarray, "4 4"]:
        """From the object's points to those handed over."""
        matrix = np.eye(4)
        turn = Rotation.from_rotvec(self.rotation_deg, degrees=True).as_matrix()
        matrix[:3, :3], matrix[:3, 3] = self.scale * turn, self.shift_cm
        return matrix

    @property
    def is_none(self) -> bool:
        """Whether meshes stay as they are."""
        still = bool((self.matrix == np.eye(4)).all())
        return still and self.tolerance_cm == 0 and self.warp_cm == 0

    def applied(self, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
        """Hand over a mesh, without splinters; the same one where there are none, and no error.

        It keeps its surface where a simpler one is no solid: where a thin wall lies between two
        surfaces, one may come out of the other.
        """
        mesh = without_splinters(mesh)
        if self.is_none:
            return mesh
        simple = self._moved(simplified(mesh, self.tolerance_cm))
        return simple if _is_solid(simple) else self._moved(mesh)

    def _moved(self, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
        return self._warped(mesh.copy().apply_transform(self.matrix))

    def _warped(self, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
        if self.warp_cm == 0:
            return mesh
        solid = from_mesh(mesh)
        if solid.is_empty():
            raise DataError("a part whose mesh is warped must be a solid")
        fine = solid.refine_to_length(WARP_LENGTH_CM / FINER)
        return to_mesh(fine.warp_batch(lambda points: points + self.warp(np.asarray(points))))

    def warp(self, points_cm: Points) -> Points:
        """By how much points, as they are handed over, are moved."""
        rng = np.random.default_rng(self.warp_seed)
        waves = rng.normal(0.0, 1 / WARP_LENGTH_CM, (3, WAVES))
        phases = rng.uniform(0.0, 2 * np.pi, WAVES)
        ways = rng.normal(0.0, self.warp_cm * np.sqrt(2 / WAVES), (WAVES, 3))
        some = np.array_split(points_cm, len(points_cm) // AT_ONCE + 1)
        return np.concatenate([np.cos(points @ waves + phases) @ ways for points in some])

    def as_dict(self) -> dict[str, Any]:
        """Give all of it in JSON's types; no warp goes without saying."""
        values = {**asdict(self), "matrix": self.matrix.tolist()}
        if self.warp_cm == 0:
            del values["warp_cm"], values["warp_seed"]
        return values


def _is_solid(mesh: trimesh.Trimesh) -> bool:
    """Whether the builder takes a mesh for a solid."""
    try:
        closed_mesh(mesh, 1.0, "")
    except DataError:
        return False
    return True


def draw_mesh_error(
    rng: np.random.Generator,
    rotation_deg: float,
    shift_cm: float,
    scale: float,
    tolerance_cm: float,
    warp_cm: float = 0.0,
) -> MeshError:
    """Draw an error.

    Parameters
    ----------
    rng
        Of one object.
    rotation_deg, shift_cm
        Root mean square of the angle, and of the length of the shift.
    scale
        Standard deviation.
    tolerance_cm, warp_cm
        As of :class:`MeshError`.
    """
    turn, way = (rng.normal(0.0, rms / np.sqrt(3), 3).tolist() for rms in (rotation_deg, shift_cm))
    factor = 1.0 + float(rng.normal(0.0, scale))
    warp_seed = int(rng.integers(2**32)) if warp_cm else 0
    return MeshError(tuple(turn), tuple(way), factor, tolerance_cm, warp_cm, warp_seed)
