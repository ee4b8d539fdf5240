"""Sizes: meshes that are a per cent too large or small get the size that their shadows show."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.builder.poly_scenes import box, captured, cylinder, fitted, geometries, tool
from xden1k.rays import ownership_order, path_lengths
from xden_builder.capture import Capture
from xden_builder.phantoms import write_captures
from xden_builder.phantoms.posing import Posing
from xden_builder.physics.source import Tube
from xden_builder.poly.model.frames import nearer
from xden_builder.reconstruct import object as reconstruction
from xden_builder.registration.capture import registered
from xden_builder.registration.placement import RigidPlacement
from xden_builder.registration.size import Size, find_size

ABOUT_CM = np.array([0.3, -0.2, 1.0])
FOUND, DRAWN = 0.001, 0.2
"""By which a size may be off, and which share of it what is expected of meshes draws back."""


def handed_over(capture: Capture, factor: float) -> Capture:
    """The capture with meshes that have to be enlarged so many times."""
    shrink = RigidPlacement(np.eye(3), (1 - 1 / factor) * ABOUT_CM, 1 / factor)
    return replace(capture, parts=shrink.of_parts(capture.parts), mesh_scale="near")


def order_of(capture: Capture) -> list[int]:
    return list(ownership_order([part.mesh for part in capture.parts]))


@pytest.fixture(scope="module")
def scanned() -> Capture:
    return captured(tool(), size=256)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.8, 1.25), st.sampled_from(["pa", "lat"]))
def test_a_scanner_that_is_nearer_sees_of_meshes_what_larger_ones_show(factor, view):
    geometry = geometries(size=24, width_cm=3.0)[view]
    meshes = [box((0.5, 0.9, 0.4)), cylinder(0.3, 1.1, (0.2, 0.1, 0.3))]
    larger = Size(factor, 0.0, ABOUT_CM).placement
    ours = path_lengths(meshes, [1, 0], nearer(geometry, factor, ABOUT_CM))
    there = path_lengths([larger.moved(mesh) for mesh in meshes], [1, 0], geometry)
    np.testing.assert_array_equal(ours.pixels, there.pixels)
    np.testing.assert_allclose(factor * ours.lengths_cm, there.lengths_cm, atol=2e-6)


@pytest.mark.parametrize("factor", [0.988, 1.0, 1.008, 1.03])
def test_meshes_too_large_or_small_get_the_size_of_the_object(scanned: Capture, factor) -> None:
    capture = handed_over(scanned, factor)
    size = find_size(capture, order_of(capture))
    assert size.factor == pytest.approx(factor, abs=FOUND + DRAWN * abs(factor - 1))
    assert 0.001 < size.sd < 0.006


def test_the_size_needs_no_source_to_be_known(scanned: Capture) -> None:
    capture = replace(handed_over(scanned, 1.01), tube=None)
    assert find_size(capture, order_of(capture)).factor == pytest.approx(1.01, abs=5 * FOUND)


def test_a_size_found_rights_the_mass_that_wrong_meshes_give(scanned: Capture) -> None:
    def mass_g(capture: Capture) -> float:
        volumes_cm3 = np.array([part.mesh.volume for part in capture.parts])
        densities = [part.density_g_cm3 for part in fitted(capture).values()]
        return float(volumes_cm3 @ densities)

    true_g, capture = mass_g(scanned), handed_over(scanned, 1.012)
    as_handed_over = replace(capture, mesh_scale="known")
    off = abs(mass_g(registered(capture).capture) / true_g - 1)
    assert off < 0.006
    assert off < 0.4 * abs(mass_g(registered(as_handed_over).capture) / true_g - 1)


def test_meshes_whose_size_is_known_keep_it(scanned: Capture) -> None:
    there = registered(scanned)
    assert there.capture is scanned
    assert there.size is None


@given(st.floats(0.5, 2.0), st.integers(0, 2**32 - 1))
def test_a_size_is_given_where_the_meshes_were_placed(factor: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn = Rotation.random(rng=rng).as_matrix()
    there = RigidPlacement(turn, rng.normal(size=3), float(rng.uniform(0.5, 2.0)))
    size, points = Size(factor, 0.001, rng.normal(size=3)), rng.normal(size=(4, 3))
    expected = size.placement.apply(there.apply(points))
    np.testing.assert_allclose(size.after(there).apply(points), expected, atol=1e-9)
    np.testing.assert_allclose(
        size.after(None).apply(points), size.placement.apply(points), atol=1e-9
    )
    np.testing.assert_allclose(size.placement.apply(size.centre_cm[None])[0], size.centre_cm)


def test_a_size_comes_back_from_json() -> None:
    size = Size(1.004, 0.0021, ABOUT_CM)
    kept = Size.from_dict(json.loads(json.dumps(size.to_dict())))
    assert (kept.factor, kept.sd, kept.centre_cm.tolist()) == (1.004, 0.0021, ABOUT_CM.tolist())


def test_a_rebuilt_object_has_its_size_and_says_how_it_was_found(scanned: Capture) -> None:
    light = replace(scanned, tube=Tube(energy_kev=60.0))
    true, sized = (reconstruction.reconstruct(each) for each in (light, handed_over(light, 1.01)))
    assert "mesh_size" not in true.meta
    assert sized.meta["mesh_size"]["factor"] == pytest.approx(1.01, abs=5 * FOUND)
    volumes = [sum(float(part.mesh.volume) for part in obj.parts) for obj in (true, sized)]
    assert volumes[1] == pytest.approx(volumes[0], rel=15 * FOUND)


def test_simulated_captures_say_that_their_size_is_sought(tmp_path) -> None:
    posing = Posing(mesh_scale="near")
    write_captures(tmp_path / "in", 1, 5, size=48, posing=posing, categories=["mug"])
    header, row = (tmp_path / "in" / "objects.csv").read_text().splitlines()
    assert dict(zip(header.split(","), row.split(","), strict=True))["mesh_scale"] == "near"
