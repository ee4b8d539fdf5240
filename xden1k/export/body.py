"""An object as one rigid body in SI: exact inertial, a shape for each part, names that can be held.

What cannot become one is refused here: nothing is ever given a density, a mass or an inertia that
the dataset does not have.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
import trimesh

from xden1k.errors import DataError
from xden1k.export.closed import closed_mesh
from xden1k.export.hulls import convex_shapes
from xden1k.export.names import file_name, written_names
from xden1k.export.si import M_PER_CM, Inertial
from xden1k.values.closed import edge_faults
from xden1k.values.mass import MassProperties
from xden1k.values.types import DensityObject, Part

__all__ = ["Body", "Shape", "body_of"]

FIELD_TOLERANCE: Final = 0.05
"""Relative: mass of the field, to which space belongs once, against that of the meshes."""
LIGHTEST_KG: Final = 0.01
"""Lighter bodies do not move in Gazebo classic (gazebo-classic issue 1646)."""
SMALLEST_KG_M2: Final = 1e-6
"""Smaller principal moments are raised to it, in silence, by Newton (newton issue 2211)."""
FLAT: Final = 1e-12
"""Of the largest coordinate, cubed: less volume is rounding."""


@dataclass(frozen=True, eq=False)
class Shape:
    """One part as it is written.

    Parameters
    ----------
    name
        What every format can hold, unique in the body.
    part
        Whose shape it is, under its own name.
    visual
        Its surface, closed under the readers' defaults, m.
    collision
        Closed convex meshes that cover it, m; they have no mass.
    """

    name: str
    part: Part
    visual: trimesh.Trimesh
    collision: tuple[trimesh.Trimesh, ...]


@dataclass(frozen=True, eq=False)
class Body:
    """One rigid body, in SI.

    Parameters
    ----------
    name
        What every format can hold.
    obj
        Whose body it is.
    inertial
        Exact, of the part meshes and their densities.
    pieces
        Convex pieces for each part's collision shape; 1 = its hull.
    """

    name: str
    obj: DensityObject
    inertial: Inertial
    pieces: int = 1

    @property
    def file_name(self) -> str:
        """What its folder and its main file are called."""
        return file_name(self.obj.object_id)

    @cached_property
    def part_names(self) -> list[str]:
        """What the parts are written as, in their order."""
        return written_names(part.name for part in self.obj.parts)

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """One for each part, in the order of the parts."""
        return tuple(
            Shape(name, part, self._visual(part), self._collision(part))
            for name, part in zip(self.part_names, self.obj.parts, strict=True)
        )

    def _visual(self, part: Part) -> trimesh.Trimesh:
        with _told(self.obj, part):
            return closed_mesh(_scaled(part.mesh, M_PER_CM))

    def _collision(self, part: Part) -> tuple[trimesh.Trimesh, ...]:
        with _told(self.obj, part):
            return convex_shapes(_scaled(part.mesh, M_PER_CM), self.pieces)


def body_of(obj: DensityObject, pieces: int = 1) -> Body:
    """Make an object a rigid body.

    Parameters
    ----------
    obj
        Each part with a density.
    pieces
        Convex pieces, at most, for each part's collision shape. 1 = its hull; more need the extra
        ``sim`` (V-HACD).

    Raises
    ------
    DataError
        If a density is unknown or withheld, a part is not a closed solid, parts overlap, or no
        rigid body has such an inertia.

    Warns
    -----
    UserWarning
        If simulators are known not to take so light a body as it is.
    """
    if pieces < 1:
        raise DataError(f"a collision shape has at least one piece, got {pieces}")
    for part in obj.parts:
        _check_density(obj, part)
        _check_solid(obj, part)
    _check_disjoint(obj)
    inertial = Inertial.of(obj.mass_properties)
    _check_inertial(obj, obj.mass_properties, inertial)
    (name,) = written_names([obj.object_id])
    return Body(name, obj, inertial, pieces)


@contextmanager
def _told(obj: DensityObject, part: Part) -> Iterator[None]:
    """Say of which part an error is."""
    try:
        yield
    except DataError as err:
        raise DataError(f"{_where(obj, part)}: {err}") from err


def _where(obj: DensityObject, part: Part) -> str:
    return f"{obj.object_id}: part {part.name}"


def _check_density(obj: DensityObject, part: Part) -> None:
    if np.isnan(part.density_g_cm3):
        known = {"withheld": "its density is withheld", "none": "only its attenuation is known"}
        raise DataError(
            f"{_where(obj, part)}: expected a density, but {known[part.density_source]}; "
            "none is made up"
        )


def _check_solid(obj: DensityObject, part: Part) -> None:
    faults = edge_faults(part.mesh.faces)
    if faults.open or faults.twisted:
        raise DataError(
            f"{_where(obj, part)}: expected a closed mesh, got {faults.open} open and "
            f"{faults.twisted} twisted edges"
        )
    corners = np.asarray(part.mesh.triangles, dtype=np.float64)  # trimesh divides by the volume
    volume = float(np.einsum("ij,ij->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6)
    if not volume > FLAT * float(np.abs(corners).max(initial=0.0)) ** 3:
        raise DataError(f"{_where(obj, part)}: expected a solid, got a volume of {volume:.3g} cm³")


def _check_disjoint(obj: DensityObject) -> None:
    if obj.density is None:
        return
    field_g, mesh_g = obj.density.mass_g, obj.mass_g
    if abs(field_g - mesh_g) > FIELD_TOLERANCE * mesh_g:
        raise DataError(
            f"{obj.object_id}: its parts weigh {mesh_g:.6g} g, its voxels {field_g:.6g} g: "
            "expected parts that do not overlap"
        )


def _check_inertial(obj: DensityObject, mass: MassProperties, inertial: Inertial) -> None:
    if not mass.mass_g > 0:
        raise DataError(f"{obj.object_id}: expected a mass above 0, got {mass.mass_g} g")
    moments, _ = inertial.principal()
    if not moments[0] > 0 or moments[0] + moments[1] < moments[2] * (1 - 1e-9):
        raise DataError(
            f"{obj.object_id}: no rigid body has the principal moments {moments.tolist()} kg·m²"
        )
    corners = np.array([part.mesh.bounds for part in obj.parts])
    low, high = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    if (mass.com_cm < low).any() or (mass.com_cm > high).any():
        raise DataError(f"{obj.object_id}: its centre of mass {mass.com_cm} is outside its box")
    _warn_if_light(obj, inertial.mass_kg, float(moments[0]))


def _warn_if_light(obj: DensityObject, mass_kg: float, smallest: float) -> None:
    if mass_kg < LIGHTEST_KG or smallest < SMALLEST_KG_M2:
        warnings.warn(
            f"{obj.object_id}: {1e3 * mass_kg:.3g} g with a smallest principal moment of "
            f"{smallest:.2g} kg·m² is written as it is, but some simulators do not take so little "
            f"(Gazebo classic below {1e3 * LIGHTEST_KG:g} g, Newton below {SMALLEST_KG_M2:g} "
            "kg·m²): use a short time step, and read back what the simulator made of it",
            stacklevel=4,
        )


def _scaled(mesh: trimesh.Trimesh, factor: float) -> trimesh.Trimesh:
    return trimesh.Trimesh(np.asarray(mesh.vertices) * factor, mesh.faces, process=False)
