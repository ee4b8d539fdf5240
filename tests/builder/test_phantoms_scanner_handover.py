"""What the simulated annotation desk hands over: meshes moved, simplified, still solid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from xden_builder.phantoms import (
    Plan,
    Scanner,
)
from xden_builder.phantoms.scanner.handover import MeshError, draw_mesh_error


def test_mesh_errors_have_the_sizes_asked_for() -> None:
    scanner = Scanner.realistic()
    errors = [scanner.mesh_error(Plan(0, 0, number)) for number in range(400)]
    angles = np.linalg.norm([error.rotation_deg for error in errors], axis=1)
    shifts = np.linalg.norm([error.shift_cm for error in errors], axis=1)
    assert np.sqrt((angles**2).mean()) == pytest.approx(1.0, rel=0.1)
    assert np.sqrt((shifts**2).mean()) == pytest.approx(0.1, rel=0.1)
    assert np.std([error.scale for error in errors]) == pytest.approx(0.005, rel=0.15)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 1000))
def test_moved_mesh_is_the_same_shape_elsewhere(seed: int) -> None:
    error = draw_mesh_error(np.random.default_rng(seed), 30.0, 2.0, 0.1, 0.0)
    mesh = trimesh.creation.box((1.0, 2.0, 3.0))
    moved = error.applied(mesh)
    assert moved.is_volume
    assert float(moved.volume) == pytest.approx(6.0 * error.scale**3)
    np.testing.assert_allclose(moved.center_mass, error.shift_cm, atol=1e-9)
    matrix = error.matrix
    np.testing.assert_allclose(moved.vertices, mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3])


def test_simplified_mesh_is_closed_lighter_and_near() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=5, radius=2.0)
    simple = MeshError((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, 0.01).applied(sphere)
    assert simple.is_volume
    assert len(simple.faces) < 0.5 * len(sphere.faces)
    assert np.abs(np.linalg.norm(simple.vertices, axis=1) - 2.0).max() < 0.011
    assert float(simple.volume) == pytest.approx(float(sphere.volume), rel=0.02)


def test_foil_is_not_simplified_away() -> None:
    foil = trimesh.creation.cylinder(radius=1.0, height=0.005, sections=64)
    error = MeshError((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, 0.02)
    np.testing.assert_array_equal(error.applied(foil).faces, foil.faces)


def test_surface_that_would_be_no_solid_is_not_simplified(monkeypatch: pytest.MonkeyPatch) -> None:
    case, cell = trimesh.creation.box((2.0, 2.0, 2.0)), trimesh.creation.box((1.0, 1.0, 1.9))
    cell.invert()
    whole = trimesh.util.concatenate([case, cell])
    poking = trimesh.util.concatenate([case, cell.copy().apply_translation((0.0, 0.0, 5.0))])
    simplified = "xden_builder.phantoms.scanner.handover.simplified"
    monkeypatch.setattr(simplified, lambda mesh, tolerance_cm: poking)
    moved = MeshError((0.0, 0.0, 5.0), (0.1, 0.0, 0.0), 1.01, 0.01).applied(whole)
    assert float(moved.volume) == pytest.approx(6.1 * 1.01**3)
    np.testing.assert_allclose(moved.bounds[:, 2], [-1.01, 1.01])


def test_a_warp_moves_all_parts_alike_by_what_is_asked_for_and_leaves_them_solid() -> None:
    scanner = replace(Scanner(), mesh_warp_cm=0.02)
    error = scanner.mesh_error(Plan(0, 0, 0))
    shell, core = (trimesh.creation.box((size, size, size)) for size in (4.0, 3.0))
    warped = [error.applied(mesh) for mesh in (shell, core)]
    assert all(mesh.is_volume for mesh in warped)
    off = trimesh.proximity.signed_distance(shell, warped[0].vertices)
    assert 0.01 < off.std() < 0.03
    # the core goes with the shell: what lies half a centimetre below its faces stays there
    gap = trimesh.proximity.signed_distance(warped[0], warped[1].vertices)
    assert np.abs(gap - 0.5).max() < 0.04
    at = np.random.default_rng(0).uniform(-50, 50, (4000, 3))
    np.testing.assert_allclose(error.warp(at).std(axis=0), 0.02, rtol=0.15)
    near = error.warp(at + np.array([0.01, 0.0, 0.0])) - error.warp(at)
    assert np.abs(near).max() < 1e-3  # smooth
    assert (scanner.mesh_error(Plan(0, 0, 1)).warp(at) != error.warp(at)).all()


def test_without_mesh_error_the_mesh_stays_itself() -> None:
    mesh = trimesh.creation.box((1.0, 1.0, 1.0))
    assert Scanner().mesh_error(Plan(0, 0, 0)).applied(mesh) is mesh
