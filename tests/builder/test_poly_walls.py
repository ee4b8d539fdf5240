"""Surfaces that are off: how much ways and volumes change, and what it does to a density."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from tests.builder.poly_scenes import Solid, captured, solved
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.poly.judgement import judge
from xden_builder.poly.model.walls import MOST, Walls, offset


def parallel(size: int = 96, width_cm: float = 8.0) -> ViewGeometry:
    """Look along y at what stands in the middle."""
    step = width_cm / size
    return ViewGeometry.from_dict(
        {
            "beam": "parallel",
            "direction": [0, 1, 0],
            "pixel00_cm": [step / 2 - width_cm / 2, 0, width_cm / 2 - step / 2],
            "column_step_cm": [step, 0, 0],
            "row_step_cm": [0, 0, -step],
            "shape": [size, size],
        }
    )


def faint(transmission: float = 0.99) -> XRayView:
    """A radiograph that weighs all pixels alike."""
    geometry = parallel()
    light = np.full(geometry.shape, transmission, dtype=np.float32)
    return XRayView("pa", light, np.ones(geometry.shape, dtype=np.bool_), geometry)


@pytest.mark.parametrize("thickness_cm", [0.2, 1.0, 4.0])
def test_a_plate_is_as_much_thicker_as_both_its_faces_are_off(thickness_cm: float) -> None:
    plate = trimesh.creation.box((6, thickness_cm, 6))
    walls = Walls.of([plate], [faint()], 0.01)
    assert walls.way_sd[0] == pytest.approx(2 * 0.01 / thickness_cm, rel=0.02)


def test_a_ball_is_thicker_by_twice_its_surfaces_error_over_its_radius() -> None:
    """Where pixels count by the square of the way through: 4 pi d r^3 over 2 pi r^4."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=2.0)
    walls = Walls.of([ball], [faint()], 0.02)
    assert walls.way_sd[0] == pytest.approx(2 * 0.02 / 2.0, rel=0.05)
    assert walls.volume_sd[0] == pytest.approx(3 * 0.02 / 2.0, rel=0.01)


def test_a_shell_is_off_by_its_wall_and_not_by_its_breadth() -> None:
    outer, inner = (trimesh.creation.icosphere(subdivisions=4, radius=r) for r in (2.0, 1.9))
    inner.invert()
    shell = trimesh.util.concatenate([outer, inner])
    walls = Walls.of([shell], [faint()], 0.01)
    assert walls.volume_sd[0] == pytest.approx(2 * 0.01 / 0.1, rel=0.02)
    assert 0.1 < walls.way_sd[0] < 0.2


def test_what_no_ray_meets_is_off_as_its_volume_is_and_nothing_by_more_than_its_way() -> None:
    beside = trimesh.creation.box((1, 1, 1)).apply_translation((50, 0, 0))
    foil = trimesh.creation.box((6, 0.01, 6))
    walls = Walls.of([beside, foil, trimesh.Trimesh()], [faint()], 0.02)
    assert walls.way_sd[0] == walls.volume_sd[0] == pytest.approx(0.12)
    assert walls.way_sd.tolist()[1:] == [MOST, 0.0]


@pytest.mark.parametrize(
    "mesh",
    [
        trimesh.creation.box((1, 2, 3)),
        trimesh.creation.cylinder(1.0, 2.0, sections=24),
        trimesh.creation.icosphere(subdivisions=3),
    ],
    ids=["box", "cylinder", "ball"],
)
@pytest.mark.parametrize("distance_cm", [0.05, -0.05])
def test_every_face_moves_by_the_distance(mesh: trimesh.Trimesh, distance_cm: float) -> None:
    moved = offset(mesh, distance_cm)
    apart = np.einsum("fvi,fi->fv", moved.triangles - mesh.triangles, mesh.face_normals)
    np.testing.assert_allclose(apart, distance_cm, atol=0.02 * abs(distance_cm))


def test_faces_without_a_normal_move_nothing_far() -> None:
    box = trimesh.creation.box((1, 1, 1))
    needle = trimesh.Trimesh(
        [*box.vertices, (0, 0, 0)], [*box.faces, (8, 8, 8)], process=False, validate=False
    )
    moved = offset(needle, 0.1)
    assert np.isfinite(moved.vertices).all()
    assert np.abs(moved.vertices - needle.vertices).max() < 0.31


def tin(true_wall_cm: float = 0.1) -> list[Solid]:
    """A tin of ABS in whose wall hardly any mesh is right."""
    outer = trimesh.creation.cylinder(2.0, 5.0, sections=64)
    inner = trimesh.creation.cylinder(2.0 - true_wall_cm, 5.0 - 2 * true_wall_cm, sections=64)
    inner.invert()
    return [Solid("wall", trimesh.util.concatenate([outer, inner]), "abs", 1.05)]


def test_a_wall_meshed_too_thin_keeps_its_labels_density_where_surfaces_may_be_off() -> None:
    """By its mesh it would have to be denser by the third that the mesh lacks."""
    capture = captured(tin(), size=96)
    thin = tin(0.075)[0].annotated
    meshed = replace(capture, parts=(thin,))
    believed, told = (
        judge(solved(replace(meshed, mesh_sd_cm=sd_cm), pose=False)).parts[0]
        for sd_cm in (0.0, 0.02)
    )
    assert abs(told.density_g_cm3 - 1.05) < 0.05
    assert abs(told.density_g_cm3 - 1.05) < abs(believed.density_g_cm3 - 1.05)
    assert abs(told.density_g_cm3 - 1.05) < 2 * told.sd_g_cm3


def test_exact_surfaces_change_nothing() -> None:
    capture = captured(tin(), size=64)
    scene = solved(capture, pose=False).scene
    assert not scene.walls.way_sd.any()
    assert scene.batches.tolist() == [0]
