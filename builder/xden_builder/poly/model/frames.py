"""Where an object stands on the scanner, against the frame of its meshes."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import reduce
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float64, Num
from scipy.spatial.transform import Rotation

from xden1k.values.arrays import Image, Mask, Vec3
from xden1k.values.views import ViewGeometry, XRayView

__all__ = ["Pose", "any_of", "binned", "coarse", "nearer", "posed"]

Three = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Pose:
    """A rigid pose, and the relative height of the two views.

    A point x of a mesh stands at R (x - centre) + centre + shift. Shifts of both images across
    the beam are translations of the object, but for one: rows of the two views may disagree.

    Parameters
    ----------
    rotation_rad
        Rotation vector.
    shift_cm
        Translation.
    row_shift_cm
        By which the panel of ``lat`` is displaced along its rows' step, beside the file's word.
    centre_cm
        What the object turns about.
    """

    rotation_rad: Three = (0.0, 0.0, 0.0)
    shift_cm: Three = (0.0, 0.0, 0.0)
    row_shift_cm: float = 0.0
    centre_cm: Three = (0.0, 0.0, 0.0)

    @property
    def vector(self) -> Float64[np.ndarray, "7"]:
        """Rotation, shift and row shift."""
        return np.array([*self.rotation_rad, *self.shift_cm, self.row_shift_cm])

    def moved(self, vector: Float[np.ndarray, "7"]) -> Pose:
        """Return the pose of another vector about the same centre."""
        rx, ry, rz, x, y, z, row = vector.tolist()
        return Pose((rx, ry, rz), (x, y, z), row, self.centre_cm)

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {
            name: list(value) if isinstance(value, tuple) else value
            for name, value in asdict(self).items()
        }

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> Pose:
        """Read what :meth:`to_dict` gives, beside other keys.

        Examples
        --------
        >>> pose = Pose((0.0, 0.0, 0.1), row_shift_cm=0.01)
        >>> Pose.from_dict(pose.to_dict()) == pose
        True
        """
        rotation, shift, centre = (
            tuple(values[name]) for name in ("rotation_rad", "shift_cm", "centre_cm")
        )
        return cls(rotation, shift, values["row_shift_cm"], centre)


def posed(geometry: ViewGeometry, pose: Pose, *, shifted_rows: bool) -> ViewGeometry:
    """Move a scanner so that meshes at rest look like meshes in a pose.

    Parameters
    ----------
    geometry
        Where the scanner file says the panel is.
    pose
        Of the object.
    shifted_rows
        Whether the row shift is this view's.
    """
    back = Rotation.from_rotvec(pose.rotation_rad).as_matrix().T

    centre, shift = np.array(pose.centre_cm), np.array(pose.shift_cm)

    def point(place: Vec3) -> Vec3:
        return np.asarray(back @ (place - centre - shift) + centre)

    row = geometry.row_step_cm
    slide = pose.row_shift_cm * row / np.linalg.norm(row) if shifted_rows else np.zeros(3)
    return replace(
        geometry,
        pixel00_cm=point(geometry.pixel00_cm + slide),
        column_step_cm=back @ geometry.column_step_cm,
        row_step_cm=back @ row,
        source_cm=None if geometry.source_cm is None else point(geometry.source_cm),
        direction=None if geometry.direction is None else back @ geometry.direction,
    )


def nearer(geometry: ViewGeometry, factor: float, centre_cm: Vec3) -> ViewGeometry:
    """Shrink a scanner about a point, so that meshes look so many times as large.

    Parameters
    ----------
    geometry
        Of a view.
    factor
        Size of the object over that of its meshes.
    centre_cm
        Shape (3,): stays where it is.
    """

    def point(place: Vec3) -> Vec3:
        return np.asarray((place - centre_cm) / factor + centre_cm)

    return replace(
        geometry,
        pixel00_cm=point(geometry.pixel00_cm),
        column_step_cm=geometry.column_step_cm / factor,
        row_step_cm=geometry.row_step_cm / factor,
        source_cm=None if geometry.source_cm is None else point(geometry.source_cm),
    )


def coarse(geometry: ViewGeometry, binning: int) -> ViewGeometry:
    """Return the same panel with ``binning * binning`` pixels read as one; a rest is left out."""
    half = (binning - 1) / 2
    return replace(
        geometry,
        pixel00_cm=geometry.pixel00_cm + half * (geometry.column_step_cm + geometry.row_step_cm),
        column_step_cm=binning * geometry.column_step_cm,
        row_step_cm=binning * geometry.row_step_cm,
        shape=(geometry.shape[0] // binning, geometry.shape[1] // binning),
    )


def binned(view: XRayView, binning: int) -> tuple[Image, Mask]:
    """Average transmission over the valid pixels of each bin, and say which bins have any."""
    values = np.where(view.valid, view.transmission, 0).astype(np.float64)
    counts = _joined(view.valid.astype(np.float64), binning, np.add)
    mean = _joined(values, binning, np.add) / np.maximum(counts, 1)
    return np.where(counts, mean, 1.0).astype(np.float32), counts > 0


def _joined(
    values: Num[np.ndarray, "rows columns"], binning: int, join: np.ufunc
) -> Num[np.ndarray, "_rows _columns"]:
    """Join bins of ``binning * binning`` pixels: row after row, far faster than over two axes."""
    rows, columns = (size // binning for size in values.shape)
    cut = values[: rows * binning, : columns * binning]
    down = reduce(join, [cut[start::binning] for start in range(binning)])
    return np.asarray(reduce(join, [down[:, start::binning] for start in range(binning)]))


def any_of(mask: Mask, binning: int) -> Bool[np.ndarray, "_rows _columns"]:
    """Say which bins of ``binning * binning`` pixels hold any of the marked ones."""
    return _joined(mask, binning, np.logical_or)
