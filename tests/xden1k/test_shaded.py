"""Outer surfaces drawn as the eye sees them: outlines and slopes in closed form."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from xden1k.pictures.shaded import LIGHT, MARGIN, shaded


def test_a_ball_is_a_disc_that_is_brightest_where_it_faces_the_light() -> None:
    size = 96
    ball = shaded(trimesh.creation.icosphere(subdivisions=4, radius=3.0), size)[..., 0]
    radius = size / MARGIN / 2
    assert (ball < 1).sum() == pytest.approx(np.pi * radius**2, rel=0.05)
    lit = ball * (ball < ball.max() + 1e-9) * (ball < 1)
    rows, columns = np.nonzero(lit > 0.98 * lit.max())
    place = (np.array([columns.mean(), rows.mean()]) - (size - 1) / 2) / radius
    np.testing.assert_allclose(place, LIGHT[:2] / np.linalg.norm(LIGHT), atol=0.12)


def test_a_flat_thing_is_seen_from_where_it_shows_most() -> None:
    flat = trimesh.creation.box((10, 0.2, 10))
    turned = flat.copy()
    turned.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 0, 1]))
    for mesh in (flat, turned):
        assert (shaded(mesh, 64)[..., 0] < 1).mean() > 0.4


def test_what_is_inside_is_not_drawn() -> None:
    whole = trimesh.creation.box((2, 2, 2))
    hollow = trimesh.util.concatenate([whole, trimesh.creation.box((1, 1, 1))])
    np.testing.assert_array_equal(shaded(hollow, 48), shaded(whole, 48))
