"""Antipodal grasps of a surface, by its shape alone: no density is asked for."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh
from jaxtyping import Float

from xden1k.errors import require
from xden1k.values.arrays import Points
from xden_bench.manip.clearance import above_table, clear_of_object
from xden_bench.manip.grasps import Grasps
from xden_bench.manip.protocol import GraspRules, GripperRules

__all__ = ["antipodal_grasps", "usable"]

OFF_SURFACE_CM = 1e-3
"""How far behind the exit's farthest place a ray starts, and what is no width."""
DOWN = np.array([0.0, 0.0, -1.0])

Directions = Float[np.ndarray, "n 3"]


def antipodal_grasps(
    surface: trimesh.Trimesh,
    rules: GraspRules,
    gripper: GripperRules,
    generator: np.random.Generator,
) -> Grasps:
    """Sample grasps whose two contacts are within each other's friction cones.

    Parameters
    ----------
    surface
        Closed, cm, at rest on the table z = 0.
    rules, gripper
        The protocol's.
    generator
        Of the draw.

    Raises
    ------
    MissingExtraError
        If embreex, which casts the rays, is not installed.
    """
    points, faces = trimesh.sample.sample_surface(surface, rules.surface_points, seed=generator)
    normals = np.asarray(surface.face_normals)
    cone_cos = 1 / np.hypot(1, rules.friction)
    directions = _in_cone(-normals[faces], cone_cos, generator)
    exits, exit_faces = _farthest(surface, np.asarray(points), directions)
    leaving = np.einsum("ij,ij->i", directions, normals[exit_faces])
    entering = -np.einsum("ij,ij->i", directions, normals[faces])
    widths = np.einsum("ij,ij->i", exits - points, directions)
    fits = (widths >= rules.min_width_cm) & (widths <= rules.max_width_cm) & (leaving >= cone_cos)
    pairs = Grasps(
        score=((entering + leaving) / 2)[fits],
        width_cm=widths[fits],
        rotation=_turned(directions[fits], 0.0),
        centre_cm=((points + exits) / 2)[fits],
    )
    surface_points, _ = trimesh.sample.sample_surface(
        surface, rules.collision_points, seed=generator
    )
    return usable(_approached(pairs, rules), np.asarray(surface_points), rules, gripper)


def usable(
    grasps: Grasps, surface_points_cm: Points, rules: GraspRules, gripper: GripperRules
) -> Grasps:
    """Keep the grasps that come from above, and that the gripper can take.

    Parameters
    ----------
    grasps
        In the world.
    surface_points_cm
        Evenly spread over the surface, in the world.
    rules, gripper
        The protocol's.
    """
    from_above = grasps.approach @ DOWN >= np.cos(np.radians(rules.max_tilt_deg)) - 1e-9
    above = grasps[from_above]
    above = above[above_table(above, rules, gripper)]
    return above[clear_of_object(above, surface_points_cm, rules, gripper)]


def _in_cone(axes: Directions, cone_cos: float, generator: np.random.Generator) -> Directions:
    """Draw one direction about each axis, even over the cap of the sphere."""
    cos = generator.uniform(cone_cos, 1, len(axes))[:, None]
    angle = generator.uniform(0, 2 * np.pi, len(axes))[:, None]
    # a vector across each axis, from the coordinate axis that it is farthest from
    across = np.cross(axes, np.eye(3)[np.abs(axes).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    around = np.cos(angle) * across + np.sin(angle) * np.cross(axes, across)
    drawn: Directions = cos * axes + np.sqrt(1 - cos**2) * around
    return drawn


def _farthest(
    surface: trimesh.Trimesh, points_cm: Points, directions: Directions
) -> tuple[Points, np.ndarray]:
    """Return where rays leave a surface for good, and through which faces.

    They are cast back, from beyond: what they meet first is what they left last.
    """
    require("embreex", "sim")
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    caster: Any = RayMeshIntersector(surface)
    far_cm = float(np.linalg.norm(surface.extents)) + OFF_SURFACE_CM
    faces, rays, met = caster.intersects_id(
        points_cm + far_cm * directions, -directions, multiple_hits=False, return_locations=True
    )
    exits, exit_faces = points_cm.copy(), np.zeros(len(points_cm), dtype=np.int64)
    exits[rays], exit_faces[rays] = met, faces
    return exits, exit_faces


def _turned(closing: Directions, angle_rad: float) -> Float[np.ndarray, "n 3 3"]:
    """Tool frames with a closing direction, turned about it from nearest to straight down.

    Where the closing direction is vertical no approach is nearest: it is not a number.
    """
    with np.errstate(invalid="ignore", divide="ignore"):
        nearest = DOWN - (closing @ DOWN)[:, None] * closing
        nearest /= np.linalg.norm(nearest, axis=1, keepdims=True)
    approach = np.cos(angle_rad) * nearest + np.sin(angle_rad) * np.cross(closing, nearest)
    return np.stack([np.cross(closing, approach), closing, approach], axis=-1)


def _approached(pairs: Grasps, rules: GraspRules) -> Grasps:
    """Every pair of contacts with every approach."""
    turned = [
        Grasps(pairs.score, pairs.width_cm, _turned(pairs.closing, angle), pairs.centre_cm)
        for angle in np.radians(rules.approaches_deg)
    ]
    return Grasps(*(np.concatenate([one.arrays[name] for one in turned]) for name in pairs.arrays))
