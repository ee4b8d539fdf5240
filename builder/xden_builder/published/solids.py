"""Closed part meshes in the object frame, from a labelled volume and where it lies."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Float32, Float64, UInt8

from xden1k.errors import DataError
from xden1k.values.arrays import Faces
from xden_builder.published import kernels
from xden_builder.published.labels import LabelVolume
from xden_builder.published.nets import Net, part_nets, surface_size
from xden_builder.published.shares import enclosed

__all__ = ["Solids", "part_solids", "thickness_voxels"]

MOST_FACES: Final = 200_000
"""Triangles of an object; one with more is meshed in voxels twice as large."""
BLOCK: Final = 2


@dataclass(frozen=True, slots=True, eq=False)
class Solids:
    """An object's meshes in the object frame, cm.

    Parameters
    ----------
    parts
        In the order of the labels; None for one that no voxel shows by a tenth.
    outer
        Outer surface of all of them, with enclosed cavities filled.
    """

    parts: Sequence[trimesh.Trimesh | None]
    outer: trimesh.Trimesh


def part_solids(volume: LabelVolume, affine: Float64[np.ndarray, "4 4"]) -> Solids:
    """Mesh the parts.

    Parameters
    ----------
    volume
        Labelled, with a margin of air.
    affine
        Takes points of the published volume, voxel i being i to i + 1, to the object frame in cm.

    Raises
    ------
    DataError
        If no part is left.
    """
    labels, share, size = volume.labels, volume.share, 1
    if surface_size(labels) > MOST_FACES:
        (labels, share), size = _coarse(volume), BLOCK
    of_net = affine @ np.diag([size, size, size, 1.0])
    of_net[:3, 3] += affine[:3, :3] @ volume.start
    net = part_nets(labels, share, volume.filled_voxels / size**3)
    parts = _placed(net, of_net)
    if all(part is None for part in parts):
        raise DataError("volume: no part is left")
    (outer,) = _placed(_outer_net(labels, share), of_net)
    assert outer is not None  # what shows a part shows all of them
    return Solids(parts, outer)


def _outer_net(labels: UInt8[np.ndarray, "x y z"], share: Float32[np.ndarray, "x y z"]) -> Net:
    """Mesh all parts as one, with their cavities."""
    full = enclosed(labels > 0)
    whole = np.where(full & (labels == 0), np.float32(1), share)
    return part_nets(full.astype(np.uint8), whole, np.array([float(whole[full].sum())]))


def _placed(net: Net, affine: Float64[np.ndarray, "4 4"]) -> list[trimesh.Trimesh | None]:
    """Take a net to the object frame."""
    points = net.points @ affine[:3, :3].T + affine[:3, 3]
    mirrored = np.linalg.det(affine[:3, :3]) < 0
    return [
        _solid(points, faces[:, ::-1] if mirrored else faces) if len(faces) else None
        for faces in net.faces
    ]


def _solid(points: Float64[np.ndarray, "n 3"], faces: Faces) -> trimesh.Trimesh:
    """Take the points that a part uses."""
    used, index = np.unique(faces, return_inverse=True)
    return trimesh.Trimesh(points[used], index.reshape(-1, 3), process=False)


def _coarse(
    volume: LabelVolume,
) -> tuple[UInt8[np.ndarray, "x y z"], Float32[np.ndarray, "x y z"]]:
    """Pool blocks of voxels: each goes to the part that fills most of it."""
    shape = [math.ceil(side / BLOCK) for side in volume.labels.shape]
    owner, total = np.zeros(shape, dtype=np.uint8), np.zeros(shape, dtype=np.float32)
    filled = np.zeros(len(volume.names) + 1, dtype=np.float32)
    kernels.pool_parts(volume.labels, volume.share, filled, owner, total)
    return owner, total


def thickness_voxels(volume: LabelVolume) -> Float64[np.ndarray, "parts"]:
    """Mean thickness of each part: of a sheet its own, of a rod half of its diameter.

    Volume over half of the surface, which columns along three axes count: a plane shows the sum of
    its three shadows, 1.5 times its area on average over all directions.
    """
    count = np.zeros(len(volume.names) + 1, dtype=np.int64)
    kernels.sides(volume.labels, count)
    return np.asarray(2 * volume.filled_voxels / (count[1:] / 1.5))
