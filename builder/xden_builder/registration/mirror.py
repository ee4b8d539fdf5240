"""Meshes of the other hand, as a program of left-handed axes exports them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from xden_builder.capture import Capture
from xden_builder.capture.space import Space
from xden_builder.registration.body import Body
from xden_builder.registration.placement import Found, RigidPlacement

__all__ = ["as_itself", "mirrored"]

ACROSS = np.array([-1.0, 1.0, 1.0])


def mirrored(capture: Capture, space: Space) -> tuple[Capture, Space]:
    """Give an object of the mirror images of its meshes, of which no pose is known.

    Parameters
    ----------
    capture, space
        The object, and what is each part's.
    """
    there = space.moved(_mirrored)
    parts = tuple(
        replace(part, mesh=mesh) for part, mesh in zip(capture.parts, there.meshes, strict=True)
    )
    return replace(capture, parts=parts, pose="unknown"), there


def _mirrored(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Mirror a mesh; its faces are wound the other way, so that they look outwards still."""
    return trimesh.Trimesh(np.asarray(mesh.vertices) * ACROSS, mesh.faces[:, ::-1], process=False)


def as_itself(seen: Found, body: Body) -> list[RigidPlacement]:
    """Give poses in which an object would look as its mirror image does, were they the same.

    It is that where it is symmetric to the plane through its middle across one of its axes.

    Parameters
    ----------
    seen
        A pose of the mirror image.
    body
        The object.
    """
    there = seen.placement
    turned = there.rotation * ACROSS  # of the meshes, mirrored before
    found = []
    for axis in body.axes:
        over = np.eye(3) - 2 * np.outer(axis, axis)
        middle_cm = body.middle_cm - over @ body.middle_cm
        shift_cm = there.translation_cm + there.scale * turned @ middle_cm
        found.append(RigidPlacement(turned @ over, shift_cm, there.scale))
    return found
