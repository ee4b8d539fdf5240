"""Real scanned meshes of weighed objects: volumes by mesh and by voxels give the listed masses."""

import csv

import pytest
import trimesh

from xden1k.rays import density_grid, object_cube, part_fractions
from xden1k.values.mass import mass_of_grid, mass_of_meshes

CM = {"m": 100.0, "mm": 0.1, "cm": 1.0}


def test_listed_masses_follow_from_meshes_and_from_voxels(shared_data):
    folder = shared_data / "weighed"
    with (folder / "weighed.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert rows
    for row in rows:
        mesh = trimesh.load_mesh(folder / row["file"]).apply_scale(CM[row["mesh_units"]])
        density, mass_g = float(row["mean_density_g_cm3"]), float(row["mass_g"])
        exact = mass_of_meshes([mesh], [density])
        assert exact.mass_g == pytest.approx(mass_g, rel=2e-3), row["object_id"]
        grid, _ = object_cube([mesh])
        filled = density_grid(part_fractions([mesh], [0], grid), [density], grid)
        found = mass_of_grid(filled, grid.origin_cm, grid.voxel_size_cm)
        assert found.mass_g == pytest.approx(exact.mass_g, rel=1e-3), row["object_id"]
        # a voxel's mass counts at its centre, which shifts plates of two or three voxels
        assert found.com_cm == pytest.approx(exact.com_cm, abs=0.1 * grid.voxel_size_cm)
