"""The dataset for torch."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from tests import phantoms
from xden1k.access.dataset import FIELDS, XDen1K, collate
from xden1k.errors import DataError, MissingObjectError
from xden1k.folder import write_folder

SHAPES = {
    "density": (torch.float32, (64, 64, 64)),
    "apparent_density": (torch.float32, (64, 64, 64)),
    "occupancy": (torch.float32, (64, 64, 64)),
    "envelope": (torch.float32, (64, 64, 64)),
    "labels": (torch.uint8, (128, 128, 128)),
    "xray_pa": (torch.float32, (24, 20)),
    "xray_lat": (torch.float32, (24, 20)),
    "part_density": (torch.float32, (3,)),
    "mesh_vertices": (torch.float32, (16, 3)),
    "mesh_faces": (torch.int32, (24, 3)),
    "face_part": (torch.uint8, (24,)),
    "grid_origin_cm": (torch.float32, (3,)),
    "voxel_size_cm": (torch.float32, ()),
    "mass_g": (torch.float32, ()),
    "com_cm": (torch.float32, (3,)),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("dataset") / "folder"
    write_folder(phantoms.objects(), out, version="1.0.0", builder="test")
    return out


def test_a_sample_has_every_field_in_its_type_and_shape(folder: Path) -> None:
    dataset = XDen1K(folder)
    sample = dataset[dataset.ids.index("bar-0001")]
    assert tuple(sample) == FIELDS
    assert (sample["object_id"], sample["category"]) == ("bar-0001", "bar")
    assert {name: (sample[name].dtype, tuple(sample[name].shape)) for name in SHAPES} == SHAPES


def test_a_sample_holds_the_objects_values(folder: Path) -> None:
    (bar,) = (obj for obj in phantoms.objects() if obj.object_id == "bar-0002")
    dataset = XDen1K(folder, "test")
    sample = dataset[0]
    assert sample["part_density"].tolist() == [0, 1, 8]
    assert sample["mass_g"].item() == pytest.approx(72)
    np.testing.assert_allclose(sample["com_cm"], [25 / 18, 1, 2], atol=1e-6)
    np.testing.assert_allclose(sample["occupancy"], bar.occupancy, atol=0.51 / 255)
    np.testing.assert_array_equal(sample["labels"], bar.labels)
    measured = bar.views[0]
    assert ((sample["xray_pa"].numpy() > 0) == measured.valid).all()
    np.testing.assert_allclose(sample["xray_pa"], measured.transmission, atol=1e-5)
    grid = sample["density"].double()
    np.testing.assert_allclose(grid.sum() * sample["voxel_size_cm"].double() ** 3, 72, rtol=1e-3)


def test_density_of_which_only_attenuation_is_known_is_not_a_number(folder: Path) -> None:
    sample = XDen1K(folder, "val")[0]
    assert sample["density"].isnan().all()
    assert sample["part_density"].isnan().tolist() == [False, True]
    assert sample["mass_g"].isnan()
    assert sample["apparent_density"].max() == 2.5


def test_only_the_fields_asked_for_are_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = XDen1K(folder, "test", fields=["xray_pa", "part_density"])
    asked = []
    row = dataset.folder.row
    monkeypatch.setattr(dataset.folder, "row", lambda *args: asked.append(args) or row(*args))
    assert dataset[-1].keys() == {"xray_pa", "part_density"}
    assert asked == [("hollow-0001", ["xray_pa", "xray_pa_shape", "part_density_g_cm3"])]


def test_samples_may_be_changed_in_place(folder: Path) -> None:
    dataset = XDen1K(folder, "test", fields=["density", "labels", "mesh_vertices"])
    for value in dataset[0].values():
        value += 1
    assert dataset[0]["density"].min() == 0


def test_a_batch_stacks_grids_and_lists_what_differs_in_size(folder: Path) -> None:
    dataset = XDen1K(folder, "test")
    batch = collate([dataset[i] for i in range(3)])
    assert batch["object_id"] == ["bar-0002", "filled-0001", "hollow-0001"]
    assert batch["density"].shape == (3, 64, 64, 64)
    assert batch["mass_g"].shape == (3,)
    assert [len(density) for density in batch["part_density"]] == [3, 3, 2]
    assert [tuple(image.shape) for image in batch["xray_pa"]] == [(24, 20), (24, 20), (16, 30)]
    assert collate([dataset[0], dataset[1]])["xray_lat"].shape == (2, 24, 20)
    assert collate([]) == {}


@pytest.mark.parametrize("start", ["fork", pytest.param("spawn", marks=pytest.mark.slow)])
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_workers_see_what_this_process_sees(folder: Path, start: str) -> None:
    dataset = XDen1K(folder, "test", fields=["object_id", "density", "xray_pa"])
    here = [dataset[i] for i in range(3)]
    loader = DataLoader(
        dataset, batch_size=1, num_workers=2, collate_fn=collate, multiprocessing_context=start
    )
    for mine, theirs in zip(here, loader, strict=True):
        assert theirs["object_id"] == [mine["object_id"]]
        assert torch.equal(theirs["density"][0], mine["density"])
        assert torch.equal(theirs["xray_pa"][0], mine["xray_pa"])


def test_a_pickled_dataset_has_no_open_file(folder: Path) -> None:
    dataset = XDen1K(folder, "test")
    dataset[0]
    data = pickle.dumps(dataset)
    assert len(data) < 5000
    assert pickle.loads(data)[0]["object_id"] == "bar-0002"  # noqa: S301


def test_objects_come_with_views_and_split_meshes(folder: Path) -> None:
    obj = XDen1K(folder).object("filled-0001")
    assert [part.name for part in obj.parts] == ["shell", "core"]
    assert all(part.mesh.is_watertight for part in obj.parts)
    assert obj.mass_g == pytest.approx(phantoms.exact_mass_g(phantoms.FILLED))
    assert [view.name for view in obj.views] == ["pa", "lat"]
    with pytest.raises(MissingObjectError, match="did you mean filled-0001"):
        XDen1K(folder).object("filled-1")


def test_unknown_fields_and_splits_are_named(folder: Path) -> None:
    with pytest.raises(DataError, match=r"unknown fields \['depth'\]; there are \['object_id'"):
        XDen1K(folder, fields=["depth"])
    with pytest.raises(DataError, match="no split 'dev'"):
        XDen1K(folder, "dev")
    with pytest.raises(IndexError):
        XDen1K(folder, "val")[1]


def test_the_folder_is_found_by_the_environment(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDEN1K_ROOT", str(folder))
    assert len(XDen1K(split="test")) == 3
