"""Rebuilding from meshes in another frame: the same object, as sure as its pose is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.builder.poly_scenes import captured, tool
from tests.builder.registration_scenes import THERE, elsewhere, found
from xden1k.values.types import DensityObject
from xden_builder.capture import Capture
from xden_builder.fit.density import PartDensity
from xden_builder.fit.spread import spread
from xden_builder.physics.source import Tube
from xden_builder.reconstruct.clues import find_clues
from xden_builder.reconstruct.object import reconstruct
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.registration import capture as registration_capture
from xden_builder.registration.capture import registered

FACTOR = 1.3
"""Density in a pose that explains the images as well, over that in the best."""


@pytest.fixture(scope="module")
def near() -> Capture:
    return captured(tool(), size=64)


@pytest.fixture
def unknown(near: Capture, monkeypatch: pytest.MonkeyPatch) -> Capture:
    """The same with meshes in another frame, which an ambiguous search brings back."""
    answer = found(THERE, len(near.parts), "pose_ambiguous", density_factor=FACTOR)
    monkeypatch.setattr(registration_capture, "register", lambda capture, order: answer)
    return elsewhere(near)


def monochromatic(capture: Capture) -> Capture:
    return replace(capture, tube=Tube(energy_kev=60.0))


def densities(obj: DensityObject) -> np.ndarray:
    return np.array([part.density_g_cm3 for part in obj.parts])


def deviations(obj: DensityObject) -> np.ndarray:
    return np.array([part.density_sd_g_cm3 for part in obj.parts])


def test_a_capture_in_the_scanners_frame_is_left_as_it_is(near: Capture) -> None:
    assert registered(near).capture is near
    assert registered(near).registration is None


def test_meshes_of_another_frame_and_scale_end_where_they_were(
    near: Capture, unknown: Capture
) -> None:
    there = registered(unknown).capture
    assert (there.pose, there.mesh_scale) == ("near", "unknown")
    for part, other in zip(near.parts, there.parts, strict=True):
        np.testing.assert_allclose(part.mesh.vertices, other.mesh.vertices, atol=1e-9)
    assert registered(there).capture is there


@pytest.mark.parametrize(
    "source", [monochromatic, pytest.param(lambda capture: capture, marks=pytest.mark.slow)]
)
def test_meshes_of_another_frame_give_the_same_object_less_sure_by_the_poses_spread(
    near: Capture, unknown: Capture, source
) -> None:
    known, there = reconstruct(source(near)), reconstruct(source(unknown))
    np.testing.assert_allclose(densities(there), densities(known), rtol=1e-5)
    spread_g_cm3 = (FACTOR - 1) * densities(known)
    np.testing.assert_allclose(
        deviations(there), np.hypot(deviations(known), spread_g_cm3), rtol=1e-4
    )
    assert all("uncertain" in part.flags for part in there.parts)
    one, other = (obj.meta["uncertainty"]["mass_sd_g"] for obj in (known, there))
    assert other == pytest.approx(np.hypot(one, (FACTOR - 1) * known.mass_g), rel=1e-4)
    assert set(there.flags) - set(known.flags) == {"pose_ambiguous"}
    assert there.meta["registration"]["translation_cm"] == THERE.translation_cm.tolist()
    assert "registration" not in known.meta


@pytest.mark.slow
def test_meshes_of_another_frame_say_the_same_of_the_beam(near: Capture, unknown: Capture) -> None:
    one, other = (find_clues(capture, BuildSettings()) for capture in (near, unknown))
    assert [clue.name for clue in one] == [clue.name for clue in other]
    for clue, its in zip(one, other, strict=True):
        np.testing.assert_allclose(clue.log_ratio, its.log_ratio, atol=1e-5)


def test_densities_that_move_together_make_the_mass_as_unsure_as_they_are() -> None:
    parts = [PartDensity(d, 0.03 * d, "xray", ()) for d in (1.0, 2.0)]
    wider, covariance = spread(parts, np.diag([0.03**2, 0.06**2]), np.array([0.04, 0.04]), 0.06)
    assert [part.sd_g_cm3 for part in wider] == pytest.approx([0.05, 0.1])
    assert all(part.flags == () for part in wider)
    volumes_cm3 = np.array([1.0, 1.0])
    together = volumes_cm3 @ covariance @ volumes_cm3
    assert together == pytest.approx(0.03**2 + 0.06**2 + (0.04 * 3.0) ** 2)


@pytest.mark.parametrize(("most", "flags"), [(0.06, ("uncertain",)), (0.1, ())])
def test_a_density_that_other_poses_make_too_unsure_is_uncertain_by_the_fits_own_share(most, flags):
    parts = [PartDensity(1.0, 0.05, "xray", ())]
    (wider,), _ = spread(parts, np.eye(1), np.array([0.07]), most)
    assert wider.sd_g_cm3 == pytest.approx(0.086, abs=1e-4)
    assert wider.flags == flags


def test_densities_that_no_other_pose_changes_keep_their_deviations_and_flags() -> None:
    parts = [PartDensity(1.0, 0.5, "prior", ("hidden",))]
    wider, covariance = spread(parts, np.eye(1), np.zeros(1), 0.06)
    assert list(wider) == parts
    assert covariance == 1
