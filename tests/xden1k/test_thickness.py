"""The thickness of plates, shells and rods by 2 V / A."""

from __future__ import annotations

import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st

from tests.phantoms import Box
from xden1k.values.thickness import plate_thickness_cm


def shell(wall_cm: float) -> trimesh.Trimesh:
    """Hollow cube of 4 cm."""
    inner = 2 - wall_cm
    return Box("wall", (-2,) * 3, (2,) * 3, hole=((-inner,) * 3, (inner,) * 3)).mesh


@given(wall_cm=st.floats(0.01, 0.2))
def test_of_a_shell_it_is_the_wall_as_both_its_surfaces_count(wall_cm: float):
    assert plate_thickness_cm(shell(wall_cm)) == pytest.approx(wall_cm, rel=0.01)


def test_of_a_rod_it_is_the_radius_and_of_a_cube_a_third_of_the_edge():
    rod = trimesh.creation.cylinder(radius=0.2, height=100, sections=200)
    assert plate_thickness_cm(rod) == pytest.approx(0.2, rel=0.01)
    assert plate_thickness_cm(trimesh.creation.box((3, 3, 3))) == pytest.approx(1)


@given(scale=st.floats(0.1, 10))
def test_it_grows_with_the_mesh(scale: float):
    larger = shell(0.1).apply_scale(scale)
    assert plate_thickness_cm(larger) == pytest.approx(scale * plate_thickness_cm(shell(0.1)))
