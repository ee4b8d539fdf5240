"""Hulls cover what they are made of, are kept by its content, and their faults are measured."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from xden_bench.manip import hulls as made
from xden_bench.manip.hulls import contact_error_cm, content_key, hulls_of, volume_error
from xden_bench.manip.protocol import load_manip_protocol
from xden_bench.manip.shape import shape_of

RULES = replace(load_manip_protocol().hulls, max_hulls=8)


def ell() -> trimesh.Trimesh:
    """An L of 8 cm³, whose hull has 14."""
    boxes = [
        trimesh.creation.box(bounds=bounds)
        for bounds in ([[0, 0, 0], [4, 1, 1]], [[0, 1, 0], [1, 5, 1]])
    ]
    return trimesh.boolean.union(boxes, engine="manifold")


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("hulls")


def test_the_pieces_of_an_ell_fill_it_and_its_one_hull_does_not(cache: Path) -> None:
    pieces = hulls_of(ell(), RULES, cache)
    assert volume_error(pieces, 8.0) < 0.15
    assert volume_error([ell().convex_hull], 8.0) == pytest.approx(0.75)


def test_hulls_are_made_once_and_read_as_they_were(cache: Path, monkeypatch) -> None:
    first = hulls_of(ell(), RULES, cache)
    monkeypatch.setattr(made, "_decomposed", None)  # may not be called again
    again = hulls_of(ell(), RULES, cache)
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)
        np.testing.assert_array_equal(one.faces, other.faces)


def test_another_mesh_or_another_rule_is_another_key() -> None:
    mesh, moved = ell(), ell()
    moved.vertices[0] += 1e-9
    keys = [content_key(mesh, RULES), content_key(moved, RULES)]
    keys.append(content_key(mesh, replace(RULES, max_hulls=9)))
    assert len({*keys, content_key(ell(), RULES)}) == 3


def test_a_point_is_as_wrong_as_the_union_is_far_off() -> None:
    boxes = [
        trimesh.creation.box(bounds=[[0, 0, 0], [2, 2, 2]]),
        trimesh.creation.box(bounds=[[2, 0, 0], [4, 2, 2]]),
    ]
    points = np.array([[0, 1, 1], [1, 1, 2], [4.3, 1, 1], [1, 1, 1.8]])
    np.testing.assert_allclose(contact_error_cm(boxes, points), [0, 0, 0.3, 0.2], atol=1e-12)


def test_the_longest_axis_is_that_of_the_shape_not_of_the_mass() -> None:
    light = trimesh.creation.box(bounds=[[0, 0, 0], [9, 1, 1]])
    heavy = trimesh.creation.box(bounds=[[9, -1, 0], [10, 2, 1]])
    shape = shape_of([light, heavy])
    assert abs(shape.long_axis[0]) > 0.99
    assert shape.volume_cm3 == pytest.approx(12, rel=1e-4)
    assert shape.along_cm(shape.centroid_cm) == 0
    assert shape.along_cm(shape.centroid_cm + 2 * shape.long_axis) == pytest.approx(2)
