"""Views before which the object was turned by hand: their own pose, and how it is found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tests.builder.fit_scenes import FLAT
from tests.builder.poly_scenes import (
    TUBE,
    box,
    capture_of,
    composition,
    geometries,
    radiograph,
    tool,
)
from xden1k.errors import DataError
from xden1k.rays import disjoint_regions, ownership_order
from xden1k.values.views import XRayView
from xden_builder.physics.groups import energy_groups
from xden_builder.physics.source import Detector, Tube
from xden_builder.pipeline.check.outlines import contradictions, outline
from xden_builder.poly.model.beam import Heel, ViewBeam
from xden_builder.poly.model.frames import Pose, posed
from xden_builder.poly.model.poses import Poses
from xden_builder.poly.model.radiograph import GAIN
from xden_builder.poly.pose import refine_pose
from xden_builder.poly.pyramid import PIXEL_SD, Level
from xden_builder.poly.target import Target
from xden_builder.reconstruct.object import reconstruct

REST = Pose(centre_cm=(0.1, -0.2, 0.3))
TURN = Pose((0.05, -0.03, 0.06), (0.6, -0.9, 0.8))
"""By which an object may be off its word that was turned by hand: 5 degrees and 13 mm."""
further = st.lists(st.booleans(), max_size=3)


@settings(max_examples=25, deadline=None)
@given(further, st.integers(0, 2**32 - 1))
def test_every_unknown_moves_the_views_it_is_of_and_no_other(turned, seed):
    poses = Poses((False, *turned), REST)
    vector = np.random.default_rng(seed).normal(size=poses.count)
    at_rest = [poses.of(number, vector) for number in range(len(poses.turned))]
    for place in range(poses.count):
        moved = vector + np.eye(poses.count)[place]
        for number, before in enumerate(at_rest):
            changes = poses.of(number, moved) != before
            assert changes == (place in poses.places(number))
    shared = [n for n, own in enumerate(poses.turned) if not own]
    assert len({(at_rest[n].rotation_rad, at_rest[n].shift_cm) for n in shared}) == 1
    assert at_rest[0].row_shift_cm == 0


def level(turned, size=16):
    """A tilted box before a parallel beam, once for each view."""
    geometry = replace(
        FLAT,
        pixel00_cm=np.array([-3.75, -4.0, 3.75]),
        column_step_cm=np.array([0.5, 0.0, 0.0]),
        row_step_cm=np.array([0.0, 0.0, -0.5]),
        shape=(size, size),
    )
    every, groups = np.ones(geometry.shape, dtype=bool), energy_groups(TUBE, Detector("CsI"), 4)
    view = XRayView("pa", np.ones(geometry.shape, dtype=np.float32), every, geometry)
    count = len(turned)
    target = Target(
        [view] * count,
        [~every] * count,
        [GAIN] * count,
        [ViewBeam(groups, geometry, Heel())] * count,
        [box((2.0, 3.0, 2.6))],
        groups.mac_cm2_g(composition("pp"))[None],
    )
    windows = [(slice(None), slice(None))] * count
    return Level.of(target, Poses(turned, Pose()), windows, 1)


def test_derivatives_by_an_own_shift_are_those_by_moving_the_object_itself():
    found = replace(level((False, True)), turned=False)  # rays along the raster tell of slides
    poses, density = found.poses, np.array([0.9])
    unknowns = found.target.start(density, np.zeros(poses.count))
    pa, lat = found.residuals_and_slopes(unknowns)[1]
    assert not pa[:, -6:].any()  # what is lat's own
    assert not lat[:, 5:11].any()  # what is shared
    ray_cm = 0.5 / found.subrays[1]  # the image is told between the rays of a pixel
    ahead, behind = (moved_images(found, unknowns, sign * ray_cm) for sign in (1, -1))
    slope = (ahead[1] - behind[1]) / (2 * ray_cm * PIXEL_SD)
    assert slope.any()
    np.testing.assert_allclose(lat[:, -3], slope, atol=1e-6 * np.abs(slope).max())


def moved_images(found, unknowns, by_cm):
    """Images of both views after the meshes themselves moved along x."""
    meshes = [mesh.copy().apply_translation((by_cm, 0, 0)) for mesh in found.target.regions]
    return replace(found, target=replace(found.target, regions=meshes)).images(unknowns)


def test_a_lone_turned_view_has_the_derivatives_of_a_shared_one():
    own, shared = level((True,)), level((False,))
    density = np.array([0.9])
    (mine,), (theirs,) = (
        each.residuals_and_slopes(each.target.start(density, np.zeros(each.poses.count)))[1]
        for each in (own, shared)
    )
    np.testing.assert_allclose(mine[:, -6:], theirs[:, -6:], atol=1e-9)


def found_turn(size):
    """Show an object that was turned by hand before lat, and look for its pose from rest."""
    solids, scanner = tool(), geometries(size)
    views = [
        radiograph(solids, "pa", scanner["pa"]),
        replace(
            radiograph(solids, "lat", posed(scanner["lat"], TURN, shifted_rows=False)),
            geometry=scanner["lat"],
        ),
    ]
    groups = energy_groups(TUBE, Detector("CsI"), 8)
    meshes = [solid.mesh for solid in solids]
    return refine_pose(
        views,
        [np.zeros_like(view.valid) for view in views],
        [GAIN, GAIN],
        [ViewBeam(groups, view.geometry, Heel()) for view in views],
        disjoint_regions(meshes, ownership_order(meshes)),
        np.stack([groups.mac_cm2_g(composition(solid.material)) for solid in solids]),
        np.array([1.1 * solid.density_g_cm3 for solid in solids]),
        (False, True),
    )


def off_by(fit, number, true):
    """Degrees and cm by which the pose in a view is off."""
    pose, points = fit.poses.of(number, fit.unknowns), tool()[0].mesh.vertices
    turns = [Rotation.from_rotvec(each.rotation_rad) for each in (pose, true)]
    here, there = (
        turn.apply(points - each.centre_cm) + each.centre_cm + each.shift_cm
        for turn, each in zip(turns, (pose, true), strict=True)
    )
    apart = (turns[0] * turns[1].inv()).magnitude()
    return np.degrees(apart), np.linalg.norm(here - there, axis=1).max()


def test_a_turn_by_hand_is_found_on_coarse_images():
    degrees, cm = off_by(found_turn(64), 1, TURN)
    assert degrees < 2
    assert cm < 0.5  # along the beam the size of the shadow alone tells


@pytest.mark.slow
def test_a_turn_by_hand_is_found_and_the_shared_pose_stays():
    fit = found_turn(256)
    degrees, cm = off_by(fit, 1, TURN)
    assert degrees < 0.3
    assert cm < 0.2  # along the beam, where its deviation is 0.7
    degrees, cm = off_by(fit, 0, Pose())
    assert degrees < 0.3
    assert cm < 0.1
    kept = fit.to_dict(["pa", "lat"])
    assert Pose.from_dict(kept) == fit.poses.of(0, fit.unknowns)
    assert Pose.from_dict(kept["views"]["lat"]) == fit.poses.of(1, fit.unknowns)
    assert len(kept["views"]["lat"]["sd"]) == 6


# what cannot be told before the fit


def test_turned_views_need_the_spectrum_that_finds_their_pose():
    views = [radiograph(tool(), name, where) for name, where in geometries(32).items()]
    capture = capture_of(tool(), views, tube=Tube(energy_kev=80.0))
    with pytest.raises(DataError, match=r"views\.lat\.turned: expected a tube's kv .* got .* mono"):
        reconstruct(replace(capture, turned=frozenset({"lat"})))


def test_a_check_does_not_ask_a_turned_view_where_its_parts_are():
    pa, lat = (radiograph(tool(), name, where) for name, where in geometries(64).items())
    aside = posed(lat.geometry, Pose(shift_cm=(0.0, 6.0, 0.0)), shifted_rows=False)
    meshes = [solid.mesh for solid in tool()]
    seen = [outline(view, None, meshes)[0] for view in (pa, replace(lat, geometry=aside))]
    assert any("lies beside the parts" in said for said in contradictions(*seen))
    assert not [*contradictions(*seen, turned=True)]
