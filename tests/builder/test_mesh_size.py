"""Sizes: meshes that are a little too large or small get the size that their shadows show."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.builder.poly_scenes import box, captured, cylinder, geometries, of_pitch, tool
from xden1k.rays import path_lengths
from xden1k.values.types import DensityObject
from xden1k.values.views import ViewGeometry
from xden_builder.audit.object import audit_object
from xden_builder.capture import Capture
from xden_builder.capture.space import divide
from xden_builder.phantoms import write_captures
from xden_builder.phantoms.posing import Posing
from xden_builder.physics.source import Tube
from xden_builder.poly.line import fit_poly, sampled
from xden_builder.poly.model.frames import Pose, nearer
from xden_builder.poly.model.poses import Poses
from xden_builder.poly.model.size import SIZE_SDS, Size
from xden_builder.poly.pyramid import Level
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.target import Target, window
from xden_builder.reconstruct import object as reconstruction
from xden_builder.registration.placement import RigidPlacement
from xden_builder.registration.size import find_size

ABOUT_CM = np.array([0.3, -0.2, 1.0])
FOUND = 0.001
"""By which a size may be off, beside what is expected of meshes draws back."""
DRAWN = {"known": 0.4, "near": 0.15}
"""Which share of a size that is, for an object as small as this one."""


def handed_over(capture: Capture, factor: float, told: str = "near") -> Capture:
    """The capture with meshes that have to be enlarged so many times."""
    shrink = RigidPlacement(np.eye(3), (1 - 1 / factor) * ABOUT_CM, 1 / factor)
    return replace(capture, parts=shrink.of_parts(capture.parts), mesh_scale=told)


def size_of(capture: Capture) -> Size:
    return sampled(capture, divide(capture.parts)).size


@pytest.fixture(scope="module")
def scanned() -> Capture:
    return captured(tool(), size=160)


@settings(max_examples=20, deadline=None)
@given(st.floats(0.8, 1.25), st.sampled_from(["pa", "lat"]))
def test_a_scanner_that_is_nearer_sees_of_meshes_what_larger_ones_show(factor, view):
    geometry = geometries(size=24, width_cm=3.0)[view]
    meshes = [box((0.5, 0.9, 0.4)), cylinder(0.3, 1.1, (0.2, 0.1, 0.3))]
    larger = Size(factor, 0.0, ABOUT_CM)
    ours = path_lengths(meshes, [1, 0], nearer(geometry, factor, ABOUT_CM))
    there = path_lengths([larger.enlarged(mesh) for mesh in meshes], [1, 0], geometry)
    np.testing.assert_array_equal(ours.pixels, there.pixels)
    np.testing.assert_allclose(factor * ours.lengths_cm, there.lengths_cm, atol=2e-6)


@pytest.mark.parametrize("told", ["known", "near"])
@pytest.mark.parametrize("factor", [0.994, 1.0, 1.012])
def test_meshes_too_large_or_small_get_the_size_of_the_object(scanned, factor, told) -> None:
    size = size_of(handed_over(scanned, factor, told))
    assert size.factor == pytest.approx(factor, abs=FOUND + DRAWN[told] * abs(factor - 1))
    assert 0.001 < size.sd < 0.7 * SIZE_SDS[told]


def test_a_size_makes_up_for_no_wrong_units(scanned: Capture) -> None:
    size = size_of(handed_over(scanned, 1.3, "known"))
    assert abs(np.log(size.factor)) < 3.01 * SIZE_SDS["known"]


def test_meshes_that_are_believed_keep_their_size(scanned: Capture) -> None:
    capture = handed_over(scanned, 1.01)
    size = sampled(capture, divide(capture.parts), PolySettings(size=False)).size
    assert (size.factor, size.sd) == (1.0, SIZE_SDS["near"])


def parallel(geometry: ViewGeometry) -> ViewGeometry:
    """The same panel where the object stands, before a beam that does not spread."""
    assert geometry.source_cm is not None
    middle = geometry.pixel_centres_cm(*(np.array([(n - 1) / 2]) for n in geometry.shape))[0]
    way = middle - geometry.source_cm
    shrink = np.linalg.norm(geometry.source_cm) / np.linalg.norm(way)
    return ViewGeometry(
        beam="parallel",
        shape=geometry.shape,
        pixel00_cm=shrink * (geometry.pixel00_cm - middle) + middle,
        column_step_cm=shrink * geometry.column_step_cm,
        row_step_cm=shrink * geometry.row_step_cm,
        source_cm=None,
        direction=way / np.linalg.norm(way),
    )


@pytest.mark.parametrize("beam", ["cone", "parallel"])
def test_slopes_by_a_shift_along_the_beam_are_those_of_the_images(beam) -> None:
    """The slope that others tell is that of a difference wide enough to be seen."""
    told = geometries(size=96, width_cm=3.2)["lat"]
    told = told if beam == "cone" else parallel(told)
    capture = captured(tool(), size=96)
    scene = sampled(capture, divide(capture.parts), PolySettings(pose=False)).guess
    beams = [replace(scene.scene.outlines.beams[1], geometry=told)]
    target = Target(
        [replace(capture.views[1], geometry=told)],
        [scene.scene.saturated[1]],
        [(1.0, 0.05)],
        beams,
        scene.scene.space.regions,
        scene.outline_stand_ins.mac_cm2_g,
    )
    x, y, z = target.centre_cm.tolist()
    poses = Poses((False,), Pose(centre_cm=(x, y, z)), size_sd=0.01)
    level = Level.of(target, poses, [window(told, target.points_cm, 4)], 4)
    unknowns = target.start(scene.density_g_cm3, np.zeros(poses.count))
    _, (slopes,) = level.residuals_and_slopes(unknowns)
    along = poses.sight(0, told, np.zeros(poses.count))
    along = along / np.linalg.norm(along)
    way, far = np.zeros(len(unknowns)), 2.0
    way[-poses.count :][poses.shifts(0)] = along
    (ahead,), (behind,) = (level.residuals(unknowns + sign * far * way) for sign in (1, -1))
    seen, told_by_others = (ahead - behind) / (2 * far), slopes @ way
    if beam == "parallel":
        np.testing.assert_allclose(told_by_others, 0, atol=1e-9 * np.abs(slopes).max())
        np.testing.assert_allclose(seen, 0, atol=1e-9 * np.abs(slopes).max())
    else:
        assert np.linalg.norm(told_by_others - seen) < 0.25 * np.linalg.norm(seen)


def test_a_view_that_was_turned_by_hand_tells_little_of_the_size(scanned: Capture) -> None:
    """Each view has its own way to the source then, told by how far off it may be laid alone."""
    both = size_of(handed_over(scanned, 1.006, "known"))
    turned = size_of(replace(handed_over(scanned, 1.006, "known"), turned=frozenset({"lat"})))
    assert both.sd < 0.3 * SIZE_SDS["known"] < 0.6 * turned.sd
    assert abs(both.factor - 1.006) < abs(turned.factor - 1.006) < turned.sd


def test_the_size_needs_no_source_to_be_known(scanned: Capture) -> None:
    capture = replace(handed_over(scanned, 1.01), tube=None)
    assert find_size(capture, divide(capture.parts)).factor == pytest.approx(1.01, abs=3 * FOUND)


def mass_g(capture: Capture, choice: PolySettings) -> float:
    space = divide(capture.parts)
    fit = fit_poly(capture, space, choice)
    volumes_cm3 = space.moved(fit.size.enlarged).volumes_cm3
    return float(volumes_cm3 @ fit.solution.density_g_cm3)


def test_a_size_found_rights_the_mass_that_wrong_meshes_give(scanned: Capture) -> None:
    true_g, capture = mass_g(scanned, PolySettings()), handed_over(scanned, 1.012)
    off = abs(mass_g(capture, PolySettings()) / true_g - 1)
    assert off < 0.006
    assert off < 0.4 * abs(mass_g(capture, PolySettings(size=False)) / true_g - 1)


def test_a_weighed_mass_holds_at_the_size_that_is_found(scanned: Capture) -> None:
    capture = handed_over(scanned, 1.01)
    told_g = 1.02 * mass_g(capture, PolySettings())
    weighed = replace(capture, weighed_mass_g=told_g)
    assert mass_g(weighed, PolySettings()) == pytest.approx(told_g, rel=0.01)


def test_what_meshes_are_enlarged_about_stays_where_it_is() -> None:
    size = Size(1.2, 0.001, ABOUT_CM)
    np.testing.assert_allclose(size.applied(ABOUT_CM[None])[0], ABOUT_CM)
    mesh = box((1.0, 2.0, 3.0))
    np.testing.assert_allclose(size.enlarged(mesh).extents, 1.2 * mesh.extents)


def test_a_size_comes_back_from_json() -> None:
    size = Size(1.004, 0.0021, ABOUT_CM)
    kept = Size.from_dict(json.loads(json.dumps(size.to_dict())))
    assert (kept.factor, kept.sd, kept.centre_cm.tolist()) == (1.004, 0.0021, ABOUT_CM.tolist())


def volume_cm3(obj: DensityObject) -> float:
    return sum(float(part.mesh.volume) for part in obj.parts)


def test_a_rebuilt_object_has_its_size_and_says_how_it_was_found(scanned: Capture) -> None:
    capture = handed_over(scanned, 1.01)
    rebuilt = reconstruction.reconstruct(capture)
    size = Size.from_dict(rebuilt.meta["mesh_size"])
    assert size.factor == pytest.approx(1.01, abs=2 * FOUND)
    volumes_cm3 = divide(capture.parts).volumes_cm3
    assert volume_cm3(rebuilt) == pytest.approx(size.factor**3 * volumes_cm3.sum())
    field = rebuilt.density
    assert field is not None
    assert field.density_g_cm3.sum() * field.voxel_size_cm**3 == pytest.approx(
        rebuilt.mass_g, rel=0.01
    )
    # what is stored explains the images as well as what was fitted
    audit = audit_object(rebuilt, capture)
    assert audit.good
    kept = rebuilt.meta["reprojection"]
    for view in audit.views:
        assert view.transmission_mae == pytest.approx(
            kept[view.name]["transmission_mae"], rel=0.02, abs=1e-4
        )


@pytest.mark.parametrize(("factor", "told"), [(1.05, "known"), (1.06, "near"), (1.0, "known")])
def test_a_size_that_would_have_to_be_larger_than_it_may_is_said(
    scanned: Capture, factor: float, told: str
) -> None:
    rebuilt = reconstruction.reconstruct(handed_over(scanned, factor, told))
    assert ("size_at_bound" in rebuilt.flags) == (factor > 1)


@pytest.mark.parametrize("pitch", [1.01, 1.0])
def test_a_pitch_that_is_wrong_in_one_view_is_flagged(scanned: Capture, pitch: float) -> None:
    pa, lat = scanned.views
    told = replace(scanned, views=(pa, replace(lat, geometry=of_pitch(lat.geometry, pitch))))
    rebuilt = reconstruction.reconstruct(handed_over(told, 1.0, "near"))
    assert ("views_disagree" in rebuilt.flags) == (pitch > 1)


def test_without_a_spectrum_the_size_is_sought_where_it_is_asked_for_alone(scanned) -> None:
    light = replace(scanned, tube=Tube(energy_kev=60.0))
    true, sized = (reconstruction.reconstruct(each) for each in (light, handed_over(light, 1.01)))
    assert "mesh_size" not in true.meta
    assert sized.meta["mesh_size"]["factor"] == pytest.approx(1.01, abs=3 * FOUND)
    assert volume_cm3(sized) == pytest.approx(volume_cm3(true), rel=9 * FOUND)


def test_simulated_captures_say_that_their_size_is_sought(tmp_path) -> None:
    posing = Posing(mesh_scale="near")
    write_captures(tmp_path / "in", 1, 5, size=48, posing=posing, categories=["mug"])
    header, row = (tmp_path / "in" / "objects.csv").read_text().splitlines()
    assert dict(zip(header.split(","), row.split(","), strict=True))["mesh_scale"] == "near"
