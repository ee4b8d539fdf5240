"""A twin's files and its truth tell the same of an object."""

from __future__ import annotations

import json
from pathlib import Path

import nibabel
import numpy as np
import pytest
import trimesh

from xden1k.errors import DataError
from xden1k.values.physics import apparent_density_g_cm3
from xden_builder.phantoms import plan_objects
from xden_builder.published.twin import (
    VARIANTS,
    draw_conventions,
    truth_path,
    write_twin,
)
from xden_builder.published.twin import writer as twin_writer
from xden_builder.published.twin.conventions import signed_permutations
from xden_builder.published.twin.pose import LONGEST, pose_of

TWIN = Path(__file__).parents[1] / "data" / "twin-tiny"
TRUTH = json.loads(truth_path(TWIN).read_text())
NUMBERS = sorted(TRUTH["objects"])


def box_of_volume(number: str) -> np.ndarray:
    """Lowest and highest corner of what attenuates, in indices of voxels."""
    values = np.asarray(nibabel.load(TWIN / "dataset" / number / "optimized_lac.nii.gz").dataobj)
    filled = np.argwhere(values > 0)
    return np.stack([filled.min(axis=0) - 0.5, filled.max(axis=0) + 0.5])


def box_of_mesh(number: str) -> np.ndarray:
    return np.asarray(trimesh.load_scene(TWIN / "dataset" / number / "mesh.glb").bounds)


@pytest.mark.parametrize("number", NUMBERS)
def test_truth_places_mesh_and_volume_on_each_other(number: str) -> None:
    truth = TRUTH["objects"][number]
    to_volume = np.array(truth["volume_matrix"]) @ np.linalg.inv(truth["mesh_matrix"])
    corners = box_of_mesh(number) @ to_volume[:3, :3].T + to_volume[:3, 3]
    placed = np.sort(corners, axis=0)
    if truth["defects"]["open_bottom"]:  # which the mesh does not show
        np.testing.assert_array_less(box_of_volume(number)[0] - 2.0, placed[0])
    else:
        np.testing.assert_allclose(placed, box_of_volume(number), atol=2.0)


def test_the_longest_side_of_a_published_mesh_is_two() -> None:
    whole = [n for n in NUMBERS if not TRUTH["objects"][n]["defects"]["open_bottom"]]
    longest = [np.ptp(box_of_mesh(number), axis=0).max() for number in whole]
    np.testing.assert_allclose(longest, LONGEST, atol=0.05)


def test_size_is_off_by_its_noise_and_rounding_alone() -> None:
    metadata = json.loads((TWIN / "dataset" / "metadata.json").read_text())
    order = TRUTH["release"]["size_axes"]
    for number, truth in TRUTH["objects"].items():
        extents = np.array(truth["extents_cm"])[order]
        np.testing.assert_allclose(metadata[number]["size"], extents, rtol=0.02, atol=0.005)


def test_a_table_has_the_density_of_the_published_rule() -> None:
    for file in TWIN.glob("dataset/*/part_lac_density.json"):
        for part in json.loads(file.read_text()).values():
            assert part["Density"] == apparent_density_g_cm3(part["LAC"])


def test_the_tiny_twin_shows_every_flaw_and_stays_small() -> None:
    defects = [truth["defects"] for truth in TRUTH["objects"].values()]
    for flaw in ("open_bottom", "flipped", "inner_faces", "by_material", "no_table"):
        assert any(each[flaw] for each in defects), flaw
    assert sum(each.stat().st_size for each in TWIN.parent.rglob("*") if each.is_file()) < 300_000


@pytest.mark.parametrize("variant", VARIANTS)
def test_only_the_mirrored_release_is_mirrored(variant: str) -> None:
    handed = [round(np.linalg.det(draw_conventions(variant, seed).axes)) for seed in range(5)]
    assert set(handed) == {-1 if variant == "B" else 1}


@pytest.mark.parametrize("determinant", [1, -1])
def test_signed_permutations_keep_the_lengths_of_axes(determinant: int) -> None:
    every = signed_permutations(determinant)
    assert len({each.tobytes() for each in every}) == 24
    for axes in every:
        np.testing.assert_array_equal(axes @ axes.T, np.eye(3))


def test_a_stretched_object_fills_the_volume_along_each_axis() -> None:
    (plan,) = plan_objects(1, 0, ["hammer"])
    conventions = draw_conventions("B", 0)
    bounds = np.array([[-1.0, -4.0, -9.0], [1.0, 4.0, 9.0]])
    pose = pose_of(bounds, plan, conventions)
    sides = np.abs(pose.volume[:3, :3] @ (bounds[1] - bounds[0]))
    np.testing.assert_allclose(sides, conventions.voxels * (1 - 2 * conventions.padding))


def test_a_filled_folder_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("kept")
    with pytest.raises(DataError, match="expected a folder that is empty"):
        write_twin(tmp_path, 1, 0, "tiny")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_categories_come_again_only_when_all_have_come() -> None:
    names = [plan.category.name for plan in twin_writer._plans(9, 3, "tiny")]
    assert len(set(names[:6])) == 6
    assert names[:3] == names[6:]


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["A", "B"])
def test_the_same_arguments_give_the_same_release(variant: str, tmp_path: Path) -> None:
    for name in ("one", "other"):
        write_twin(tmp_path / name, 1, 5, variant)
    files = sorted(p.relative_to(tmp_path / "one") for p in (tmp_path / "one").rglob("*.*"))
    assert len(files) >= 5
    for file in files:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "other" / file).read_bytes()
