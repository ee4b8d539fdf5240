"""Part densities as grids."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from xden1k.access.hub import SAMPLE
from xden1k.errors import MissingExtraError
from xden1k.folder import open_folder
from xden1k.predictions import SubmissionMeta, write_predictions
from xden_bench.scoring.expand import grid_of_parts, part_shares, sd_grid_of_parts
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import score

DENSITIES = {
    "bar-0002": [0.0, 1.0, 8.0],
    "cube-0003": [0.0, 2.0],
    "filled-0001": [0.0, 1.0, 4.0],
    "hollow-0002": [0.0, 1.5],
}


def expanded(reference: Reference, object_id: str) -> np.ndarray:
    truth = reference.truth(object_id)
    densities = np.array(DENSITIES[object_id])
    meshes = reference.part_meshes(object_id)
    return grid_of_parts(densities, part_shares(meshes, truth.origin_cm, truth.voxel_size_cm))


@pytest.mark.parametrize("object_id", DENSITIES)
def test_a_face_is_placed_to_a_257th_of_a_voxel(reference: Reference, object_id: str) -> None:
    # at an edge two faces of either part meet in a voxel
    off = np.abs(expanded(reference, object_id) - reference.truth(object_id).density_g_cm3)
    assert off.max() < max(DENSITIES[object_id]) * 4 / 257


def truth_as_part_density(reference: Reference, out: Path, target: str) -> Path:
    meta = SubmissionMeta(
        method="truth",
        dataset_revision=reference.revision,
        config="default",
        split=reference.split,
        inputs=("mesh", "parts"),
        training_data=(),
        external_data=False,
        target=target,
    )
    column = f"part_{target}_g_cm3"
    rows = ((one, reference.folder.row(one, [column])[column]) for one in reference.ids)
    write_predictions(out, meta, ((one, np.array([0.0, *values])) for one, values in rows))
    return out


@pytest.mark.parametrize(
    ("split", "target"),
    [
        ("val", "density"),
        pytest.param("test", "apparent_density", marks=pytest.mark.slow),
        pytest.param("train", "density", marks=pytest.mark.slow),
        pytest.param("train", "apparent_density", marks=pytest.mark.slow),
    ],
)
def test_the_true_part_densities_score_zero_on_the_sample(
    tmp_path: Path, split: str, target: str
) -> None:
    reference = Reference(open_folder(SAMPLE), split)
    path = truth_as_part_density(reference, tmp_path / "truth.npz", target)
    scored = score(path, reference, load_protocol())
    # a step of float16 here and there, which is larger for apparent densities of metal
    assert scored.metrics["density_mae_g_cm3"].mean < 1e-5
    assert scored.metrics["mass_mape"].mean < 1e-5
    assert scored.metrics["com_l1_cm"].mean < 1e-5
    (warning,) = (str(one) for one in scored.warnings if one.code == "W504")
    assert f" {len(reference.ids)}: " in warning


def test_deviations_of_parts_add_as_independent_ones_where_parts_share_a_voxel() -> None:
    meshes = [trimesh.creation.box((1, 1, 1)) for _ in range(2)]
    for mesh, x in zip(meshes, (-0.5, 0.5), strict=True):
        mesh.apply_translation([x, 0, 0])
    # the face between them halves a layer of voxels
    shares = part_shares(meshes, np.full(3, -1.5), 0.3)
    both = sd_grid_of_parts(np.array([0.0, 0.3, 0.4]), shares)
    first = sd_grid_of_parts(np.array([0.0, 0.3, 0.0]), shares)
    second = sd_grid_of_parts(np.array([0.0, 0.0, 0.4]), shares)
    np.testing.assert_allclose(both**2, first**2 + second**2, atol=1e-7)
    assert both[5, 5, 5] == pytest.approx(np.hypot(0.15, 0.2), rel=0.01)
    assert both.max() == pytest.approx(0.4)
    # a single part's deviation is spread as its density is
    np.testing.assert_allclose(first, grid_of_parts(np.array([0.0, 0.3, 0.0]), shares), rtol=1e-3)


def test_without_the_extra_that_cuts_meshes_the_message_says_what_to_install(
    reference: Reference, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [name for name in sys.modules if name.startswith("xden1k.rays")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "numba", None)
    with pytest.raises(MissingExtraError, match=r"pip install .*\[build\]'"):
        expanded(reference, "bar-0002")
