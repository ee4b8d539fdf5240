"""One radiograph and where it was taken from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from xden1k.errors import DataError
from xden1k.values.arrays import Image, Mask, Points, Vec3

__all__ = ["ViewGeometry", "XRayView"]

Beam = Literal["cone", "parallel"]


@dataclass(frozen=True, eq=False)
class ViewGeometry:
    """Where a detector and its beam are, in the object frame.

    The centre of the pixel in row r, column c is ``pixel00 + c * column_step + r * row_step``.
    Steps need not be perpendicular to each other or to the beam.

    Parameters
    ----------
    beam
        ``cone`` (rays leave ``source_cm``) or ``parallel`` (rays run along ``direction``).
    pixel00_cm, column_step_cm, row_step_cm
        Shape (3,): centre of pixel (0, 0), step to the next column, step to the next row.
    shape
        Rows and columns of the image.
    source_cm
        Shape (3,): focal spot; cone beams only.
    direction
        Shape (3,): from source to detector, of any length; parallel beams only.

    Raises
    ------
    DataError
        If a vector is not finite, the beam lacks its source or direction or has the other's, or
        the detector is seen edge-on.
    """

    beam: Beam
    pixel00_cm: Vec3
    column_step_cm: Vec3
    row_step_cm: Vec3
    shape: tuple[int, int]
    source_cm: Vec3 | None = None
    direction: Vec3 | None = None

    def __post_init__(self) -> None:
        wanted, other = self._emitter_names()
        if getattr(self, wanted) is None or getattr(self, other) is not None:
            raise DataError(f"a {self.beam} beam needs {wanted} and no {other}")
        for name in ("pixel00_cm", "column_step_cm", "row_step_cm", wanted):
            vector = np.array(getattr(self, name), dtype=np.float64)
            if vector.shape != (3,) or not all(map(math.isfinite, vector.tolist())):
                raise DataError(f"{name} must be three finite numbers, got {vector.tolist()}")
            vector.flags.writeable = False
            object.__setattr__(self, name, vector)
        if min(self.shape) < 1:
            raise DataError(f"shape must be rows and columns of at least 1, got {self.shape}")
        if not abs(self._edge_on_measure()) > 1e-9:
            raise DataError("the detector is seen edge-on: its steps and the beam lie in one plane")

    def _emitter_names(self) -> tuple[str, str]:
        return ("source_cm", "direction") if self.beam == "cone" else ("direction", "source_cm")

    def _edge_on_measure(self) -> float:
        """Volume of the frame's unit vectors, negative if it is left-handed."""
        column, row, beam = self.matrix.T.tolist()
        volume: float = (
            column[0] * (row[1] * beam[2] - row[2] * beam[1])
            + column[1] * (row[2] * beam[0] - row[0] * beam[2])
            + column[2] * (row[0] * beam[1] - row[1] * beam[0])
        )
        return volume / max(math.prod(math.hypot(*each) for each in (column, row, beam)), 1e-300)

    @cached_property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """Columns: column step, row step, and the beam.

        For a cone the beam is the way from the source to pixel (0, 0), for a parallel beam the
        unit direction.
        """
        if self.source_cm is not None:
            beam = self.pixel00_cm - self.source_cm
        else:
            assert self.direction is not None
            beam = self.direction / np.linalg.norm(self.direction)
        matrix = np.empty((3, 3))
        matrix[:, 0], matrix[:, 1], matrix[:, 2] = self.column_step_cm, self.row_step_cm, beam
        return matrix

    @cached_property
    def mirrored(self) -> bool:
        """Whether (column step, row step, beam) is a left-handed frame."""
        return self._edge_on_measure() < 0

    def project(self, points_cm: Points) -> Float[np.ndarray, "points 3"]:
        """Column, row and depth of points.

        Depth grows linearly along each ray. For a cone it is 0 at the source and 1 on the
        detector; for a parallel beam it is in cm. Planes stay planes in (column * depth,
        row * depth, depth) for a cone, and in (column, row, depth) for a parallel beam.

        Raises
        ------
        DataError
            If a point of a cone beam is not in front of the source.
        """
        inverse = np.linalg.inv(self.matrix)
        if self.source_cm is None:
            return np.asarray((points_cm - self.pixel00_cm) @ inverse.T)
        u, v, depth = ((points_cm - self.source_cm) @ inverse.T).T
        if not (depth > 0).all():
            raise DataError(f"{int((depth <= 0).sum())} points lie behind the X-ray source")
        return np.stack([u / depth, v / depth, depth], axis=1)

    def pixel_centres_cm(
        self, rows: Float[np.ndarray, "*n"], columns: Float[np.ndarray, "*n"]
    ) -> Float[np.ndarray, "*n 3"]:
        """Points of the detector plane; rows and columns may be fractions."""
        return np.asarray(
            self.pixel00_cm
            + columns[..., None] * self.column_step_cm
            + rows[..., None] * self.row_step_cm
        )

    def cm_per_depth(
        self, rows: Float[np.ndarray, "*n"], columns: Float[np.ndarray, "*n"]
    ) -> Float[np.ndarray, "*n"]:
        """Length in cm of one unit of depth along the ray of each pixel."""
        if self.source_cm is None:
            return np.ones_like(rows)
        offsets = self.pixel_centres_cm(rows, columns) - self.source_cm
        return np.asarray(np.linalg.norm(offsets, axis=-1))

    def refined(self, factor: int) -> ViewGeometry:
        """Return the same detector with each pixel cut into ``factor * factor``."""
        back = (factor - 1) / (2 * factor)
        return replace(
            self,
            pixel00_cm=self.pixel00_cm - back * (self.column_step_cm + self.row_step_cm),
            column_step_cm=self.column_step_cm / factor,
            row_step_cm=self.row_step_cm / factor,
            shape=(self.shape[0] * factor, self.shape[1] * factor),
        )

    def moved(self, offset_cm: Vec3) -> ViewGeometry:
        """Return the same scanner, shifted as a whole."""
        return replace(
            self,
            pixel00_cm=self.pixel00_cm + offset_cm,
            source_cm=None if self.source_cm is None else self.source_cm + offset_cm,
        )

    def to_dict(self) -> dict[str, Any]:
        """Keys and values as in a capture folder's ``scanner.toml``."""
        wanted, _ = self._emitter_names()
        vectors = (wanted, "pixel00_cm", "column_step_cm", "row_step_cm")
        return {
            "beam": self.beam,
            **{name: getattr(self, name).tolist() for name in vectors},
            "shape": list(self.shape),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> ViewGeometry:
        """Read what :meth:`to_dict` gives.

        Examples
        --------
        >>> flat = {"beam": "parallel", "direction": [0, 1, 0], "pixel00_cm": [0, 5, 0],
        ...         "column_step_cm": [0.1, 0, 0], "row_step_cm": [0, 0, -0.1], "shape": [2, 3]}
        >>> ViewGeometry.from_dict(flat).project(np.array([[0.2, 7.0, -0.1]])).tolist()
        [[2.0, 1.0, 2.0]]
        """
        vectors = ("source_cm", "direction", "pixel00_cm", "column_step_cm", "row_step_cm")
        rows, columns = values["shape"]
        return cls(
            beam=values["beam"],
            shape=(int(rows), int(columns)),
            **{
                name: np.array(values[name], dtype=np.float64) for name in vectors if name in values
            },
        )


@dataclass(frozen=True, slots=True, eq=False)
class XRayView:
    """One radiograph as transmission, and its geometry.

    Parameters
    ----------
    name
        ``pa`` or ``lat`` in a dataset; audits may hold more.
    transmission
        Shape (rows, columns), I / I0: 1 = air. Above 1 is ordinary noise.
    valid
        Shape (rows, columns): False where the pixel is dead or saturated.
    geometry
        Where the image was taken from.

    Raises
    ------
    DataError
        If shapes differ, a valid pixel is not finite, or no pixel is valid.
    """

    name: str
    transmission: Image
    valid: Mask
    geometry: ViewGeometry

    def __post_init__(self) -> None:
        shapes = {self.transmission.shape, self.valid.shape, self.geometry.shape}
        if len(shapes) > 1:
            raise DataError(
                f"view {self.name}: transmission {self.transmission.shape}, valid "
                f"{self.valid.shape} and geometry {self.geometry.shape} must have one shape"
            )
        bad = self.valid & ~np.isfinite(self.transmission)
        if bad.any():
            first = tuple(int(i) for i in np.argwhere(bad)[0])
            raise DataError(
                f"view {self.name}: {int(bad.sum())} valid pixels are not finite, first at {first}"
            )
        if not self.valid.any():
            raise DataError(f"view {self.name}: no valid pixel")
