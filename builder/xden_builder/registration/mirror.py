"""Meshes of the other hand, as a program of left-handed axes exports them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from xden_builder.capture import Capture
from xden_builder.capture.space import Space

__all__ = ["mirrored"]

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
