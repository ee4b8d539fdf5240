"""Part meshes as maintainers hand them over: moved, scaled and simplified a little."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden_builder.capture.solids import closed_mesh, simplified

__all__ = ["MeshError", "draw_mesh_error"]


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
    """

    rotation_deg: tuple[float, float, float]
    shift_cm: tuple[float, float, float]
    scale: float
    tolerance_cm: float

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
        return self.tolerance_cm == 0 and bool((self.matrix == np.eye(4)).all())

    def applied(self, mesh: trimesh.Trimesh) -> trimesh.Trimesh:
        """Hand over a mesh; the same one where there is no error.

        It keeps its surface where a simpler one is no solid: where a thin wall lies between two
        surfaces, one may come out of the other.
        """
        if self.is_none:
            return mesh
        simple, whole = (
            each.copy().apply_transform(self.matrix)
            for each in (simplified(mesh, self.tolerance_cm), mesh)
        )
        return simple if _is_solid(simple) else whole

    def as_dict(self) -> dict[str, Any]:
        """Give all of it in JSON's types."""
        return {**asdict(self), "matrix": self.matrix.tolist()}


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
    tolerance_cm
        As of :class:`MeshError`.
    """
    turn, way = (rng.normal(0.0, rms / np.sqrt(3), 3).tolist() for rms in (rotation_deg, shift_cm))
    factor = 1.0 + float(rng.normal(0.0, scale))
    return MeshError(tuple(turn), tuple(way), factor, tolerance_cm)
