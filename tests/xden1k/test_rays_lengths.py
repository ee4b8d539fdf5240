"""Path lengths against half-space clipping and ray/triangle sums, and the laws they obey."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from xden1k.rays import PathLengths, path_lengths
from xden1k.views import ViewGeometry

SIZE = 48
seeds = st.integers(0, 2**32 - 1)
beams = st.sampled_from(["cone", "parallel"])


def view(beam="cone", *, size=SIZE, tilt=0.0, seed=0, flip_rows=False, mirror=False):
    """A panel 30 cm behind the object, source 100 cm before it; tilted panels have skewed steps."""
    rng = np.random.default_rng(seed)
    column = np.array([20 / size, 0, 0]) * (-1 if mirror else 1)
    row = np.array([0, 0, -20 / size]) * (-1 if flip_rows else 1)
    column, row = (step + tilt * rng.normal(size=3) * 20 / size for step in (column, row))
    middle = np.array([0.1, 30.0, -0.2])
    source = {"source_cm": np.array([0.3, -100.0, 0.7])}
    direction = {"direction": np.array([0.02, 1.0, -0.05])}
    return ViewGeometry(
        beam=beam,
        pixel00_cm=middle - (size - 1) / 2 * (column + row),
        column_step_cm=column,
        row_step_cm=row,
        shape=(size, size),
        **(source if beam == "cone" else direction),
    )


def turned(mesh, seed, shift=1.0):
    rng = np.random.default_rng(seed)
    pose = trimesh.transformations.random_rotation_matrix(rng.random(3))
    pose[:3, 3] = shift * rng.uniform(-1, 1, 3)
    return mesh.copy().apply_transform(pose)


def rays(geometry):
    """Origins and unit directions of the rays through all pixel centres."""
    rows, columns = np.indices(geometry.shape).reshape(2, -1).astype(float)
    targets = geometry.pixel_centres_cm(rows, columns)
    if geometry.beam == "parallel":
        along = np.broadcast_to(geometry.direction, targets.shape)
        starts = targets - 200 * along / np.linalg.norm(geometry.direction)
    else:
        along, starts = (
            targets - geometry.source_cm,
            np.broadcast_to(geometry.source_cm, targets.shape),
        )
    return starts, along / np.linalg.norm(along, axis=1, keepdims=True)


def length_in_convex(mesh, geometry):
    """Clip each ray by the half-space of each face."""
    starts, along = rays(geometry)
    enter, leave = np.full(len(starts), -np.inf), np.full(len(starts), np.inf)
    for a, b, c in mesh.triangles:
        normal = np.cross(b - a, c - a)
        height, slope = (a - starts) @ normal, along @ normal
        with np.errstate(divide="ignore"):
            meet = height / slope
        enter = np.where(slope < 0, np.maximum(enter, meet), enter)
        leave = np.where(slope > 0, np.minimum(leave, meet), leave)
    return np.clip(leave - enter, 0, None).reshape(geometry.shape)


def length_by_triangle_sums(mesh, geometry):
    """Sum of signed distances over all triangles hit (Moeller and Trumbore, 1997)."""
    starts, along = rays(geometry)
    total = np.zeros(len(starts))
    for a, b, c in mesh.triangles:
        across = np.cross(along, c - a)
        volume = across @ (b - a)
        with np.errstate(divide="ignore", invalid="ignore"):
            u = ((starts - a) * across).sum(axis=1) / volume
            q = np.cross(starts - a, b - a)
            v = (along * q).sum(axis=1) / volume
            hit = (u >= 0) & (v >= 0) & (u + v <= 1)
            total += np.where(hit, -np.sign(volume) * (q @ (c - a)) / volume, 0)
    return total.reshape(geometry.shape)


def frame(lengths: PathLengths, part=0):
    """Lengths of one part as an image: mean over the rays."""
    image = np.zeros(lengths.shape)
    image.flat[lengths.pixels] = lengths.lengths_cm[:, :, part].astype(float).mean(axis=1)
    return image


SOLIDS = {
    "box": trimesh.creation.box((3.0, 2.0, 5.0)),
    "thin plate": trimesh.creation.box((6.0, 0.01, 6.0)),
    "polygonal cylinder": trimesh.creation.cylinder(1.7, 4.0, sections=24),
    "cone": trimesh.creation.cone(2.0, 4.0, sections=20),
    "faceted sphere": trimesh.creation.icosphere(2, 2.5),
}


@pytest.mark.parametrize("name", SOLIDS)
@settings(max_examples=12, deadline=None)
@given(seed=seeds, beam=beams, flip_rows=st.booleans(), mirror=st.booleans(), tilted=st.booleans())
def test_convex_solids_are_exact_in_any_pose_and_geometry(
    name, seed, beam, flip_rows, mirror, tilted
):
    geometry = view(beam, tilt=0.3 * tilted, seed=seed, flip_rows=flip_rows, mirror=mirror)
    mesh = turned(SOLIDS[name], seed)
    lengths = path_lengths([mesh], [0], geometry)
    assert not lengths.broken.any()
    np.testing.assert_allclose(frame(lengths), length_in_convex(mesh, geometry), atol=2e-6)


@pytest.mark.parametrize("beam", ["cone", "parallel"])
def test_bodies_with_holes_agree_with_triangle_sums(beam):
    geometry = view(beam, tilt=0.2, seed=4)
    for mesh in (
        trimesh.creation.torus(2.5, 0.8, major_sections=24, minor_sections=12),
        trimesh.creation.annulus(1.5, 2.5, 3.0, sections=20),
    ):
        posed = turned(mesh, seed=7)
        np.testing.assert_allclose(
            frame(path_lengths([posed], [0], geometry)),
            length_by_triangle_sums(posed, geometry),
            atol=2e-6,
        )
