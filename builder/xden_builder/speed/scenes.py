"""Objects of any size for measuring speed, and the two views they are seen in."""

from __future__ import annotations

import numpy as np
import trimesh
from jaxtyping import Float64

from xden1k.rays import PathLengths
from xden1k.values.views import ViewGeometry, XRayView

__all__ = ["nested_parts", "radiograph", "six_parts", "two_views"]

QUANTA = 20_000
"""Open-field quanta of a pixel."""


def six_parts() -> list[trimesh.Trimesh]:
    """Make six parts that do not overlap: 54,000 faces, 10 x 5 x 17 cm.

    A ball with bumps, an ellipsoid, a capsule, a torus, a thin-walled tube and a box.
    """
    blob = trimesh.creation.icosphere(subdivisions=5, radius=1.8)
    bumps = 1 + 0.12 * np.sin(5 * blob.vertices).prod(axis=1, keepdims=True)
    blob.vertices = blob.vertices * bumps
    ellipsoid = trimesh.creation.icosphere(subdivisions=5)
    ellipsoid.apply_scale((1.5, 1.0, 2.2))
    capsule = trimesh.creation.capsule(height=4.0, radius=0.7, count=[64, 64])
    torus = trimesh.creation.torus(1.6, 0.4, major_sections=64, minor_sections=32)
    tube = trimesh.creation.annulus(1.1, 1.2, 5.0, sections=96)
    box = trimesh.creation.box((2.0, 3.0, 1.0))
    places = [(-3, 0, 6), (3, 1, 6), (-3, 0, -1), (3, -1, 0), (-3, 1, -6.5), (3, 0, -6)]
    parts = [blob, ellipsoid, capsule, torus, tube, box]
    tilt = trimesh.transformations.rotation_matrix(0.3, (1, 2, 3))  # type: ignore[no-untyped-call]
    for part, place in zip(parts, places, strict=True):
        part.apply_transform(tilt)
        part.apply_translation(place)
    return parts


def nested_parts(faces: int, parts: int) -> list[trimesh.Trimesh]:
    """Make a casing, listed last, and a pile of ``parts - 1`` lenses within it.

    The casing is an ellipsoid of 8 x 5 x 18 cm whatever the counts, so that the same pixels see it.

    Parameters
    ----------
    faces
        Of all parts together, in equal shares.
    parts
        At least one.
    """
    ball = _ball(faces // parts)
    height = 14.0 / max(parts - 1, 1)
    heights = (np.arange(parts - 1) + 0.5) * height - 7.0
    lenses = [_placed(ball, (2.5, 1.5, 0.48 * height), z) for z in heights.tolist()]
    return [*lenses, _placed(ball, (4.0, 2.5, 9.0), 0.0)]


def _placed(
    ball: trimesh.Trimesh, axes_cm: tuple[float, float, float], z_cm: float
) -> trimesh.Trimesh:
    vertices = ball.vertices * axes_cm + (0.0, 0.0, z_cm)
    return trimesh.Trimesh(vertices, ball.faces, process=False)


def _ball(faces: int) -> trimesh.Trimesh:
    """Make a unit ball of any even number of faces: vertices evenly spread along a spiral."""
    count = faces // 2 + 2
    place = np.arange(count) + 0.5
    height, turn = 1 - 2 * place / count, np.pi * (1 + np.sqrt(5)) * place
    around = np.sqrt(1 - height**2)
    points = np.stack([around * np.cos(turn), around * np.sin(turn), height], axis=1)
    hull: trimesh.Trimesh = trimesh.convex.convex_hull(points)
    return hull


def two_views(size: int) -> tuple[ViewGeometry, ViewGeometry]:
    """PA and LAT by a 43 cm panel of ``size`` pixels a side, 100 cm before and 30 behind."""
    step = 43.0 / size
    edge = 21.5 - step / 2
    down = np.array([0.0, 0.0, -step])
    return (
        ViewGeometry(
            beam="cone",
            source_cm=np.array([0.0, -100.0, 0.0]),
            pixel00_cm=np.array([-edge, 30.0, edge]),
            column_step_cm=np.array([step, 0.0, 0.0]),
            row_step_cm=down,
            shape=(size, size),
        ),
        ViewGeometry(
            beam="cone",
            source_cm=np.array([-100.0, 0.0, 0.0]),
            pixel00_cm=np.array([30.0, edge, edge]),
            column_step_cm=np.array([0.0, -step, 0.0]),
            row_step_cm=down,
            shape=(size, size),
        ),
    )


def radiograph(
    name: str,
    geometry: ViewGeometry,
    lengths: PathLengths,
    lac_per_cm: Float64[np.ndarray, "k"],
    rng: np.random.Generator,
) -> XRayView:
    """Transmission with the noise of 20,000 quanta a pixel."""
    image = lengths.image(lac_per_cm)
    for row in image:  # row by row, which needs no memory to speak of
        row[:] = rng.poisson(QUANTA * row) / QUANTA
    return XRayView(name, image, np.ones(image.shape, dtype=bool), geometry)
