"""One object as it is tried: all that a trial needs, in arrays that can be frozen."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from typing import Final, Literal

import numpy as np
import trimesh

from xden1k.values.arrays import Vec3
from xden1k.values.mass import MassProperties
from xden_bench.manip.arrays import pack_meshes, unpack_meshes
from xden_bench.manip.draws import Draw
from xden_bench.manip.grasps import Grasps
from xden_bench.manip.pose import Pose

__all__ = ["STRATA", "Item", "Stratum"]

Stratum = Literal["off", "balanced"]
STRATA: Final[tuple[Stratum, ...]] = ("off", "balanced")


@dataclass(frozen=True, slots=True, eq=False)
class Item:
    """An object of the benchmark; lengths in cm, in its own frame unless said otherwise.

    Parameters
    ----------
    object_id, category
        As in the dataset.
    stratum
        Whether its centre of mass is far from its centroid.
    mass
        Its true mass properties.
    homogeneous
        Those of as much mass, spread evenly inside the outer surface.
    uniform_cm
        Shape (3,): centroid of the envelope's voxels, which a method without density is given.
    long_axis
        Shape (3,): unit vector along which it is longest.
    hulls
        Convex meshes that are felt.
    rest
        Of the object in the world, on the table z = 0.
    grasps
        Candidates, in the world.
    draws
        Conditions of the trials, by regime.
    """

    object_id: str
    category: str
    stratum: Stratum
    mass: MassProperties
    homogeneous: MassProperties
    uniform_cm: Vec3
    long_axis: Vec3
    hulls: tuple[trimesh.Trimesh, ...]
    rest: Pose
    grasps: Grasps
    draws: Mapping[str, tuple[Draw, ...]]

    def along_cm(self, point_cm: Vec3) -> float:
        """Where a point lies along the longest axis, from the true centre of mass."""
        return float((point_cm - self.mass.com_cm) @ self.long_axis)

    def lever_cm(self, candidate: int, com_cm: Vec3) -> float:
        """Lever with which a weight turns the object about the closing axis of a grasp.

        Parameters
        ----------
        candidate
            Index of the grasp.
        com_cm
            Where the weight acts, in the object's frame.
        """
        (com_in_world,) = self.rest.to_world(com_cm[None])
        arm = com_in_world - self.grasps.centre_cm[candidate]
        moment = np.cross(arm, [0.0, 0.0, -1.0])
        return float(abs(moment @ self.grasps.closing[candidate]))

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything in arrays, for a file."""
        named: dict[str, np.ndarray] = {
            name: np.array(getattr(self, name))
            for name in ("object_id", "category", "stratum", "uniform_cm", "long_axis")
        }
        for name in ("mass", "homogeneous", "rest", "grasps"):
            value = getattr(self, name)
            for part in fields(value):
                named[f"{name}.{part.name}"] = np.array(getattr(value, part.name))
        for regime, draws in self.draws.items():
            named[f"draws.{regime}"] = np.array([list(asdict(draw).values()) for draw in draws])
        return named | pack_meshes(self.hulls, "hulls")

    @classmethod
    def of_arrays(cls, arrays: Mapping[str, np.ndarray]) -> Item:
        """Return what :meth:`arrays` took apart.

        Raises
        ------
        KeyError
            If an array is missing.
        """

        def parts(name: str) -> dict[str, np.ndarray]:
            start = f"{name}."
            return {key[len(start) :]: arrays[key] for key in arrays if key.startswith(start)}

        def mass(name: str) -> MassProperties:
            found = parts(name)
            return MassProperties(float(found["mass_g"]), found["com_cm"], found["inertia_g_cm2"])

        stratum = str(arrays["stratum"])
        return cls(
            object_id=str(arrays["object_id"]),
            category=str(arrays["category"]),
            stratum=next(one for one in STRATA if one == stratum),
            mass=mass("mass"),
            homogeneous=mass("homogeneous"),
            uniform_cm=arrays["uniform_cm"],
            long_axis=arrays["long_axis"],
            hulls=unpack_meshes(arrays, "hulls"),
            rest=Pose(**parts("rest")),
            grasps=Grasps(**parts("grasps")),
            draws={
                regime: tuple(map(_draw, rows.tolist())) for regime, rows in parts("draws").items()
            },
        )


def _draw(row: list[float]) -> Draw:
    friction, grip_force_n, shake_rad, shake_azimuth_rad, redrawn = row
    return Draw(friction, grip_force_n, shake_rad, shake_azimuth_rad, int(redrawn))
