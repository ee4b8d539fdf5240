"""Captures whose meshes lie in another frame, and the registration that a perfect search finds."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from xden_builder.capture import Capture
from xden_builder.capture.space import Space
from xden_builder.registration.placement import Found, Registration, RigidPlacement

THERE: Final = RigidPlacement(
    Rotation.from_euler("xyz", (70, -30, 200), degrees=True).as_matrix(),
    np.array([1.0, -7.0, 3.0]),
    0.8,
)
"""From a frame that a mesh might come in to the scanner's."""


def elsewhere(capture: Capture, there: RigidPlacement = THERE) -> Capture:
    """The capture with meshes in another frame, from which a placement brings them back."""
    parts = tuple(
        replace(
            part,
            mesh=trimesh.Trimesh(there.undone(part.mesh.vertices), part.mesh.faces, process=False),
        )
        for part in capture.parts
    )
    return replace(capture, parts=parts, pose="unknown", mesh_scale="unknown")


def found(
    placement: RigidPlacement, parts: int, *flags: str, density_factor: float = 1.0
) -> Registration:
    """A registration that found the placement, and its half turn about the vertical."""
    half_turn = np.diag([-1.0, -1.0, 1.0])
    other = RigidPlacement(
        half_turn @ placement.rotation, placement.translation_cm, placement.scale
    )
    density = np.ones(parts)
    return Registration(
        (Found(placement, 0.1, density), Found(other, 0.11, density_factor * density)),
        equal_poses=0,
        chosen=0,
        outline_share={"pa": 0.01, "lat": 0.02},
        flags=flags,
    )


class TrueSearch:
    """In place of the search: finds what ``truth.json`` says, and refuses what it is told to.

    Parameters
    ----------
    captures
        A simulated capture folder.
    flags
        By object, what its registrations are flagged with.
    """

    def __init__(self, captures: Path, **flags: Sequence[str]) -> None:
        self.captures, self.flags = captures, flags

    def __call__(self, capture: Capture, space: Space) -> Registration:
        """Stand in for ``register``."""
        text = (self.captures / capture.object_id / "truth.json").read_text()
        placement = RigidPlacement.from_dict(json.loads(text)["mesh_pose"])
        return found(placement, len(space.order), *self.flags.get(capture.category, ()))
