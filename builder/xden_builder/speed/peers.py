"""Other ways to path lengths, to be compared with: a float64 reference, ray casting, ray marching.

None of them is used to build anything.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
import trimesh
from jaxtyping import Float, Int

from xden1k.values.views import ViewGeometry

__all__ = ["cast_lengths", "march_lengths", "pixel_rays", "reference_lengths"]

Rays = tuple[Float[np.ndarray, "rays 3"], Float[np.ndarray, "rays 3"]]
"""A point on each ray, and its unit direction."""
Lengths = Float[np.ndarray, "rays parts"]


def pixel_rays(geometry: ViewGeometry, pixels: Int[np.ndarray, "rays"]) -> Rays:
    """Rays through pixel centres of a cone beam, from the source."""
    rows, columns = (index.astype(float) for index in np.divmod(pixels, geometry.shape[1]))
    ways = geometry.pixel_centres_cm(rows, columns) - geometry.source_cm
    directions = ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return np.broadcast_to(np.asarray(geometry.source_cm), ways.shape), directions


def reference_lengths(meshes: Sequence[trimesh.Trimesh], rays: Rays) -> Lengths:
    """Lengths through parts that do not overlap, triangle by triangle in float64.

    Each ray is tried against each triangle (Möller and Trumbore, 1997,
    doi:10.1080/10867651.1997.10487468); exits count positive, entries negative. Slow.
    """
    return np.stack([_signed_sums(mesh, rays) for mesh in meshes], axis=1)


def _signed_sums(mesh: trimesh.Trimesh, rays: Rays) -> Float[np.ndarray, "rays"]:
    corner, *others = np.moveaxis(mesh.triangles.astype(np.float64), 1, 0)
    first, second = (other - corner for other in others)
    normal = np.cross(first, second)
    sums = np.zeros(len(rays[0]))
    for i, (origin, direction) in enumerate(zip(*rays, strict=True)):
        with np.errstate(divide="ignore", invalid="ignore"):
            across = normal @ direction
            to_origin = origin - corner
            turned = np.cross(direction, to_origin)
            u = np.einsum("ij,ij->i", turned, second) / across
            v = -np.einsum("ij,ij->i", turned, first) / across
            depth = -np.einsum("ij,ij->i", to_origin, normal) / across
            hit = (u >= 0) & (v >= 0) & (u + v <= 1)
        sums[i] = (np.sign(across) * depth)[hit].sum()
    return sums


def cast_lengths(meshes: Sequence[trimesh.Trimesh], rays: Rays) -> Lengths:
    """Lengths by casting rays with trimesh and Embree, all hits of each part."""
    lengths = np.zeros((len(rays[0]), len(meshes)))
    for part, mesh in enumerate(meshes):
        points, ray, face = mesh.ray.intersects_location(*rays, multiple_hits=True)
        along = np.einsum("ij,ij->i", points - rays[0][ray], rays[1][ray])
        exits = np.einsum("ij,ij->i", mesh.face_normals[face], rays[1][ray]) > 0
        np.add.at(lengths[:, part], ray, np.where(exits, along, -along))
    return lengths


def march_lengths(
    shares: Float[np.ndarray, "parts x y z"],
    low_cm: Float[np.ndarray, "3"],
    edge_cm: float,
    rays: Rays,
    samples: int = 512,
    at_once: int = 2048,
) -> Lengths:
    """Lengths by sampling a voxel volume along each ray with ``torch.nn.functional.grid_sample``.

    Parameters
    ----------
    shares
        Share of each voxel that each part fills; the grid is a cube.
    low_cm, edge_cm
        Lowest corner of the cube, and its edge.
    rays
        Must meet the cube.
    samples
        Points along each ray, from its entry into the cube's bounding sphere to its exit.
    at_once
        Rays in one call, which bounds the memory.
    """
    volume = torch.from_numpy(np.ascontiguousarray(shares.transpose(0, 3, 2, 1))[None])
    radius = edge_cm * np.sqrt(3) / 2
    lengths = []
    for start in range(0, len(rays[0]), at_once):
        origins, directions = (half[start : start + at_once] for half in rays)
        nearest = np.einsum("ij,ij->i", low_cm + edge_cm / 2 - origins, directions)
        steps = (np.arange(samples) + 0.5) / samples * 2 * radius - radius
        points = origins[:, None] + (nearest[:, None] + steps)[..., None] * directions[:, None]
        grid = torch.from_numpy(((points - low_cm) / edge_cm * 2 - 1).astype(np.float32))
        values = torch.nn.functional.grid_sample(volume, grid[None, None], align_corners=False)
        lengths.append(values[0, :, 0].sum(dim=-1).T.numpy() * (2 * radius / samples))
    return np.concatenate(lengths)
