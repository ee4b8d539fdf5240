"""The figure of imported objects shows how far mesh and parts are apart."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from matplotlib.image import imread

from tests import phantoms
from tests.builder.releases import TWIN
from xden1k.folder import write_folder
from xden_builder.published.figure import distances_voxels, draw_imported
from xden_builder.published.reading.mesh import read_mesh
from xden_builder.published.register import UPRIGHT


def test_distances_are_of_the_faces_from_all_parts_together_in_voxels() -> None:
    sphere = trimesh.creation.icosphere(radius=1.0)
    half = sphere.triangles_center[:, 2] > 0
    parts = [sphere.submesh([half], append=True), sphere.submesh([~half], append=True)]
    np.testing.assert_allclose(distances_voxels(sphere, parts, 0.5), 0.0, atol=1e-7)
    grown = trimesh.Trimesh(1.25 * sphere.vertices, sphere.faces)
    np.testing.assert_allclose(distances_voxels(grown, parts, 0.5), 0.5, rtol=0.02)


@pytest.mark.slow
def test_what_was_imported_is_drawn_beside_what_was_published(tmp_path: Path) -> None:
    mesh, _ = read_mesh(TWIN / "dataset" / "1" / "mesh.glb")
    obj = phantoms.published_object("xden1k-0001", phantoms.BAR)
    affine = np.eye(4)
    affine[:3, :3] = UPRIGHT * np.ptp(mesh.bounds, axis=0).max() / 64
    told = {"cm_per_unit": 1.0, "volume_to_object_cm": affine.tolist()}
    meta = {"published": {"id": "1"}, "registration": told}
    write_folder([replace(obj, meta=meta)], tmp_path / "imported", version="0.0.0", builder="test")
    draw_imported(TWIN, tmp_path / "imported", ["xden1k-0001"], tmp_path / "figure.png")
    assert imread(tmp_path / "figure.png")[..., :3].std() > 0.05
