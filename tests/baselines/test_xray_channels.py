"""Back-projection: what a voxel learns from the rays through it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scipy import ndimage

from tests.phantoms import CUBE, HOLLOW, box_object, geometry
from xden1k.errors import DataError
from xden1k.folder import open_folder, write_folder
from xden1k.predictor import SampleView
from xden1k.rays import path_lengths
from xden1k.values.modality import Modality
from xden1k.values.views import XRayView
from xden_baselines.geometry import nearest_filled
from xden_baselines.xray import back_projected_lac_per_cm, lac_along_rays_per_cm

READS = Modality.GEOMETRY | Modality.XRAY
EDGE_CM = 2.0
LAC = 0.3


def sample(root: Path, boxes: list) -> SampleView:
    obj = box_object("box-0001", boxes, shape=(96, 96), split="train")
    write_folder([obj], root / "dataset", version="0.1.0", builder="tests")
    return SampleView(open_folder(root / "dataset"), "box-0001", READS)


def slab_view(valid: np.ndarray | None = None) -> tuple[XRayView, trimesh.Trimesh]:
    """A homogeneous cube in a cone beam, 2 x 2 rays a pixel."""
    cube = trimesh.creation.box((EDGE_CM,) * 3)
    place = geometry("pa", (64, 64), 2.0)
    image = path_lengths([cube], [0], place, 2).image(np.array([LAC]))
    return XRayView("pa", image, np.ones_like(image, bool) if valid is None else valid, place), cube


def test_a_homogeneous_body_has_its_coefficient_in_every_voxel(tmp_path: Path) -> None:
    one = sample(tmp_path, CUBE)
    found = back_projected_lac_per_cm(one)
    expected = 2.0 * 1.25 * 0.17  # density, apparent over true, the paper's coefficient
    inside = one.envelope == 1
    core = ndimage.binary_erosion(inside, iterations=3)
    for grid in found:
        assert grid[core] == pytest.approx(expected, rel=5e-3)
        # at the silhouette the picture's one ray a pixel says less than the pixel's area
        assert grid[inside] == pytest.approx(expected, rel=0.2)
        assert not grid[one.envelope == 0].any()


def test_a_cavity_lowers_the_mean_along_the_rays_through_it(tmp_path: Path) -> None:
    one = sample(tmp_path, HOLLOW)
    pa, lat = back_projected_lac_per_cm(one)
    centre = one.envelope.shape[0] // 2
    assert pa[centre, 5, centre] < 0.8 * pa[5, centre, centre]
    assert lat[5, centre, centre] < 0.8 * lat[centre, 5, centre]


def test_dead_pixels_drop_out_of_the_mean_instead_of_looking_like_air() -> None:
    view, cube = slab_view()
    points = np.array([[0.1, 0.2, 0.3], [-0.3, 0.0, 0.4]])
    whole = lac_along_rays_per_cm(view, cube, points, 0.3)
    column, row, _ = view.geometry.project(points[:1])[0]
    valid = np.ones_like(view.valid)
    valid[int(row) - 1 : int(row) + 1, int(column)] = False
    dead = np.where(valid, view.transmission, 0).astype(np.float32)
    holed = lac_along_rays_per_cm(replace(view, transmission=dead, valid=valid), cube, points, 0.3)
    assert whole == pytest.approx(LAC, rel=1e-2)
    assert holed == pytest.approx(LAC, rel=1e-2)


def test_a_point_off_the_detector_or_beside_the_object_is_not_a_number() -> None:
    view, cube = slab_view()
    beside = np.array([[0.0, 0.0, 30.0], [1.6, 0.0, 0.0], [0.0, 0.0, 0.0]])
    assert np.isnan(lac_along_rays_per_cm(view, cube, beside, 0.1)).tolist() == [True, True, False]


def test_values_are_filled_from_the_nearest_known_voxel_in_every_channel() -> None:
    values = np.arange(2 * 27.0).reshape(2, 3, 3, 3)
    known = np.zeros((3, 3, 3), bool)
    known[0, 0, 0] = known[2, 2, 2] = True
    filled = nearest_filled(values, known)
    assert filled[:, 1, 0, 0].tolist() == [0.0, 27.0]
    assert filled[:, 2, 2, 1].tolist() == [26.0, 53.0]
    with pytest.raises(DataError, match="no known voxel"):
        nearest_filled(values, ~np.ones_like(known))
