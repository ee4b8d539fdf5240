"""Solids of the vocabulary against their formulas."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from manifold3d import Manifold

from xden1k.errors import DataError
from xden_builder.phantoms import shapes, skins
from xden_builder.phantoms.pieces import Piece, disjoint, moved
from xden_builder.phantoms.scanner.handover import draw_mesh_error

RADII = st.floats(0.02, 15.0)


def close(volume: float, expected: float) -> bool:
    """Equal but for the polygons that stand for circles."""
    return abs(volume - expected) <= 0.02 * expected


@given(RADII)
def test_circles_stray_by_the_tolerance_at_most(radius: float) -> None:
    corners = shapes.segments(radius)
    assert corners % 4 == 0
    assert radius * (1 - math.cos(math.pi / corners)) <= 1.001 * shapes.CHORD_TOLERANCE_CM


def test_polygon_takes_points_in_either_sense() -> None:
    square = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]
    assert shapes.polygon(square).area() == pytest.approx(4.0)
    assert shapes.polygon(square[::-1]).area() == pytest.approx(4.0)


def test_fillet_rounds_corners_but_leaves_the_axis_alone() -> None:
    rounded = shapes.lathe(shapes.outline([(0, 0), (2, 0), (2, 3), (0, 3)], 0.5))
    assert rounded.volume() < shapes.cylinder(2.0, 0.0, 3.0).volume()
    low, high = rounded.bounding_box()[2::3]
    assert (low, high) == pytest.approx((0.0, 3.0))  # flat where it meets the axis
    assert rounded.slice(0.01).area() > math.pi * 1.3**2


def test_inset_leaves_an_even_wall() -> None:
    cavity = shapes.inset(shapes.outline([(0, 0), (2, 0), (2, 3), (0, 3)]), 0.25)
    assert cavity.bounds() == pytest.approx((-1.75, 0.25, 1.75, 2.75))


@pytest.mark.parametrize(
    ("make", "expected"),
    [
        (lambda: shapes.cylinder(1.5, -1.0, 2.0), math.pi * 1.5**2 * 3),
        (lambda: shapes.cylinder(2.0, 0.0, 3.0, 1.0), math.pi * 7),
        (lambda: shapes.tube(2.0, 1.0, 0.0, 4.0), math.pi * 3 * 4),
        (lambda: shapes.sphere(2.0), 4 / 3 * math.pi * 8),
        (lambda: shapes.capsule(1.0, 0.0, 5.0), math.pi * 3 + 4 / 3 * math.pi),
        (lambda: shapes.box((1.0, 2.0, 3.0)), 6.0),
        (lambda: shapes.lathe(shapes.outline([(1, 0), (2, 0), (2, 3), (1, 3)])), math.pi * 9),
        (
            lambda: shapes.slab(shapes.rounded_rectangle(4.0, 2.0, 0.5), 0.0, 1.0),
            8 - 0.25 * (4 - math.pi),
        ),
        (lambda: shapes.slab(shapes.regular_polygon(6, 2.0), 0.0, 1.0), 2 * math.sqrt(3)),
        (lambda: skins.loft([(0.0, 1.0, 2.0), (3.0, 1.0, 2.0)]), math.pi * 2 * 3),
    ],
)
def test_volume_of_a_plain_solid(make: Callable[[], Manifold], expected: float) -> None:
    assert close(make().volume(), expected)


def test_rounded_box_fills_its_size_and_no_more() -> None:
    block = shapes.rounded_box((3.0, 2.0, 1.0), 0.2, (1.0, 0.0, 0.0))
    assert block.bounding_box() == pytest.approx((-0.5, -1.0, -0.5, 2.5, 1.0, 0.5))
    assert 0.9 * 6.0 < block.volume() < 6.0


def test_rounded_rims_stay_inside_the_sharp_slab() -> None:
    section = shapes.rounded_rectangle(4.0, 3.0, 0.5)
    sharp, soft = shapes.slab(section, 0.0, 1.0), shapes.slab(section, 0.0, 1.0, 0.3)
    assert (soft - sharp).volume() < 1e-9
    assert soft.bounding_box() == pytest.approx(sharp.bounding_box())


def test_ring_has_the_volume_of_pappus() -> None:
    angles = 2 * np.pi * np.arange(100) / 100
    path = 3.0 * np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    ring = skins.pipe(path, 0.5, closed=True)
    assert ring.genus() == 1
    assert close(ring.volume(), 2 * math.pi * 3.0 * math.pi * 0.25)


def test_straight_pipe_is_an_oval_cylinder() -> None:
    path = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.0, 0.0, 4.0]])
    assert close(skins.pipe(path, 1.0, 0.5).volume(), math.pi * 0.5 * 4)


def test_spring_fills_its_heights_with_a_wire_of_the_right_volume() -> None:
    coil = skins.spring(1.0, 0.1, 0.0, 5.0, turns=8)
    low, high = coil.bounding_box()[2::3]
    assert low == pytest.approx(0.0, abs=0.03)
    assert high == pytest.approx(5.0, abs=0.03)
    length = math.hypot(8 * 2 * math.pi * 0.9, 4.8)
    dodecagon = 12 / 2 * math.sin(math.pi / 6) * 0.01
    assert 0.95 < coil.volume() / (length * dodecagon) < 1.0  # 14 straight pieces a turn


def test_smooth_path_starts_and_ends_where_it_should() -> None:
    corners = [(0.0, 0.0, 0.0), (1.0, 0.0, 2.0), (3.0, 0.0, 2.5)]
    path = skins.smooth_path(corners, 9)
    assert path.shape == (9, 3)
    np.testing.assert_allclose(path[[0, -1]], [corners[0], corners[-1]], atol=1e-12)


def test_skin_that_bounds_nothing_is_refused() -> None:
    with pytest.raises(DataError, match="must bound a solid"):
        skins.skin(np.zeros((2, 4, 3)))


@given(st.floats(0.2, 1.0), st.floats(0.1, 0.3))
def test_thread_lies_between_root_and_crest(major: float, depth: float) -> None:
    rod = shapes.thread(major, (1 - depth) * major, 0.4 * major, 0.0, 4 * major)
    root = math.pi * ((1 - depth) * major) ** 2 * 4 * major
    assert 0.9 * root < rod.volume() < math.pi * major**2 * 4 * major
    assert rod.bounding_box()[5] == pytest.approx(4 * major)


def test_turning_over_maps_the_axes_as_said() -> None:
    rod = shapes.box((1.0, 2.0, 6.0), (0.5, 1.0, 3.0))  # from the origin along +x, +y, +z
    assert shapes.along_x(rod).bounding_box() == pytest.approx((0, 0, -1, 6, 2, 0))
    assert shapes.along_y(rod).bounding_box() == pytest.approx((0, 0, -2, 1, 6, 0))
    plate = shapes.polygon([(0, 0), (3, 0), (3, 1), (0, 1)])
    assert shapes.upright(plate, 2.0).bounding_box() == pytest.approx((0, -1, 0, 3, 1, 1))
    assert shapes.upright_across(plate, 2.0).bounding_box() == pytest.approx((-1, 0, 0, 1, 3, 1))


def test_mesh_keeps_cavities_and_drops_crumbs() -> None:
    hollow = shapes.box((3.0, 3.0, 3.0)) - shapes.box((1.0, 1.0, 1.0))
    crumb = shapes.box((0.01, 0.01, 0.01), (5.0, 0.0, 0.0))
    mesh = shapes.to_mesh(hollow + crumb)
    assert mesh.is_volume
    assert float(mesh.volume) == pytest.approx(26.0)
    assert mesh.bounds[1][0] == pytest.approx(1.5)


def test_splinters_are_the_solids_and_left_out_of_what_is_handed_over() -> None:
    hollow = shapes.box((3.0, 3.0, 3.0)) - shapes.box((1.0, 1.0, 1.0))
    splinter = shapes.box((3.0, 0.03, 0.02), (5.0, 0.0, 0.0))
    mesh = shapes.to_mesh(hollow + splinter)
    assert mesh.bounds[1][0] == pytest.approx(6.5)
    whole = shapes.without_splinters(mesh)
    assert whole.is_volume
    assert float(whole.volume) == pytest.approx(26.0)
    assert whole.bounds[1][0] == pytest.approx(1.5)
    assert shapes.without_splinters(whole) is whole
    moved = draw_mesh_error(np.random.default_rng(0), 1.0, 0.1, 0.0, 0.0).applied(mesh)
    assert float(moved.volume) == pytest.approx(26.0)


def test_earlier_pieces_own_what_they_share() -> None:
    screw, block = shapes.cylinder(0.5, 0.0, 3.0), shapes.box((2.0, 2.0, 2.0))
    cut = disjoint([Piece("screw", "screw", screw), Piece("block", "block", block)])
    assert cut[0].solid.volume() == screw.volume()
    assert (cut[0].solid ^ cut[1].solid).volume() == pytest.approx(0.0, abs=1e-9)
    assert cut[1].solid.volume() == pytest.approx(8.0 - screw.volume() / 3)


def test_piece_without_anything_left_is_refused() -> None:
    box = shapes.box((1.0, 1.0, 1.0))
    with pytest.raises(DataError, match="part inner lies wholly inside stronger parts"):
        disjoint([Piece("outer", "a", box), Piece("inner", "b", box.scale((0.5, 0.5, 0.5)))])


def test_moving_pieces_leaves_names_and_roles() -> None:
    (there,) = moved(
        [Piece("rod", "shaft", shapes.box((1, 1, 1)))], lambda solid: solid.translate((2, 0, 0))
    )
    assert (there.name, there.role) == ("rod", "shaft")
    assert there.solid.bounding_box()[0] == pytest.approx(1.5)
