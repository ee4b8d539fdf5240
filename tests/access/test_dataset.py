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
from xden1k.access.geometry import project
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
    "inertia_g_cm2": (torch.float32, (3, 3)),
    "weighed_mass_g": (torch.float32, ()),
    "part_density_sd": (torch.float32, (3,)),
    "part_apparent_density": (torch.float32, (3,)),
    "part_lac": (torch.float32, (3,)),
    "part_color_rgb": (torch.float32, (3, 3)),
    **{
        f"xray_{view}_{name}": (torch.float32, shape)
        for view in ("pa", "lat")
        for name, shape in {
            "source": (4,),
            "pixel00_cm": (3,),
            "column_step_cm": (3,),
            "row_step_cm": (3,),
            "projection": (3, 4),
        }.items()
    },
    **{f"xray_{view}_valid": (torch.bool, (24, 20)) for view in ("pa", "lat")},
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
    tensors = {name: value for name, value in sample.items() if isinstance(value, torch.Tensor)}
    assert {name: (each.dtype, tuple(each.shape)) for name, each in tensors.items()} == SHAPES
    assert {name: sample[name] for name in FIELDS if name not in tensors} == {
        "object_id": "bar-0001",
        "category": "bar",
        "source": "phantom",
        "flags": [],
        "part_names": ["plastic", "steel"],
        "part_materials": ["polypropylene", "steel"],
        "part_density_source": ["truth", "truth"],
        "part_flags": [[], []],
    }


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
    assert torch.equal(sample["xray_pa_valid"], sample["xray_pa"] > 0)
    for view in bar.views:
        seen = project(sample["mesh_vertices"], sample[f"xray_{view.name}_projection"])
        corners = np.concatenate([part.mesh.vertices for part in bar.parts])
        np.testing.assert_allclose(seen, view.geometry.project(corners)[:, :2], atol=1e-4)
    inertia = bar.mass_properties.inertia_g_cm2
    np.testing.assert_allclose(sample["inertia_g_cm2"], inertia, rtol=1e-5, atol=1e-4)
    assert sample["weighed_mass_g"].item() == 71.5
    np.testing.assert_allclose(sample["part_lac"][1:], [part.lac_per_cm for part in bar.parts])
    grid = sample["density"].double()
    np.testing.assert_allclose(grid.sum() * sample["voxel_size_cm"].double() ** 3, 72, rtol=1e-3)


def test_density_of_which_only_attenuation_is_known_is_not_a_number(folder: Path) -> None:
    sample = XDen1K(folder, "val")[0]
    assert sample["density"].isnan().all()
    assert sample["part_density"].isnan().tolist() == [False, True]
    assert sample["mass_g"].isnan()
    assert sample["inertia_g_cm2"].isnan().all()
    assert sample["weighed_mass_g"].isnan()
    assert sample["apparent_density"].max() == 2.5


def test_only_the_fields_asked_for_are_read(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dataset = XDen1K(folder, "test", fields=["xray_pa", "part_density"])
    asked = []
    row = dataset.folder.row
    monkeypatch.setattr(dataset.folder, "row", lambda *args: asked.append(args) or row(*args))
    assert dataset[-1].keys() == {"xray_pa", "part_density"}
    assert asked == [("hollow-0001", ["xray_pa", "xray_pa_shape", "part_density_g_cm3"])]
    XDen1K(folder, "test", fields=["xray_pa_valid"])[0]
    geometry = XDen1K(folder, "test", fields="xray_pa_projection")
    monkeypatch.setattr(geometry.folder, "row", lambda *args: asked.append(args) or row(*args))
    assert geometry[0].keys() == {"xray_pa_projection"}
    assert asked[-1] == ("bar-0002", ["meta_json"])


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


def test_a_batch_must_have_the_same_fields_and_may_have_to_have_one_size(folder: Path) -> None:
    dataset = XDen1K(folder, "test")
    samples = [dataset[i] for i in range(3)]
    with pytest.raises(DataError, match=r"xray_pa has different sizes in one batch, \[\(24, 20\)"):
        collate(samples, one_size=True)
    assert collate(samples[:2], one_size=True)["xray_pa_source"].shape == (2, 4)
    with pytest.raises(DataError, match=r"samples 0 and 1 of a batch differ .*\['mass_g'\]"):
        collate([samples[0], {name: samples[1][name] for name in FIELDS if name != "mass_g"}])


def test_one_name_is_a_field_and_not_its_letters(folder: Path) -> None:
    assert XDen1K(folder, fields="density")[0].keys() == {"density"}
    with pytest.raises(DataError, match=r"unknown fields \['densty'\]; did you mean density"):
        XDen1K(folder, fields="densty")


def test_categories_choose_objects(folder: Path) -> None:
    assert XDen1K(folder, "test", categories="bar").ids == ("bar-0002",)
    assert XDen1K(folder, "test", categories=["bar", "hollow"]).ids == ("bar-0002", "hollow-0001")
    with pytest.raises(DataError, match=r"no category 'holow' among 4; did you mean hollow\?"):
        XDen1K(folder, "test", categories=["bar", "holow"])
    with pytest.raises(DataError, match=r"split 'train' has no object of \['hollow'\]"):
        XDen1K(folder, categories="hollow")


def test_a_transform_gives_what_is_handed_out(folder: Path) -> None:
    dataset = XDen1K(folder, "test", "mass_g", transform=lambda sample: sample["mass_g"] * 2)
    assert dataset[0].item() == pytest.approx(144)
    assert dataset.__getitems__([0, 0]) == [dataset[0], dataset[0]]


def test_a_dataset_says_what_it_is(folder: Path) -> None:
    assert repr(XDen1K(folder, "test")) == f"XDen1K('{folder}', 'test'): 3 objects"
    some = XDen1K(folder, fields="mass_g", categories="bar")
    expected = f"XDen1K('{folder}', 'train', fields=('mass_g',), categories=('bar',)): 1 objects"
    assert repr(some) == expected


def test_an_index_is_a_number_or_the_message_says_what_to_do(folder: Path) -> None:
    dataset = XDen1K(folder, "test", "object_id")
    assert dataset[np.int64(1)] == dataset[torch.tensor(1)] == dataset[-2]
    for index, hint in (
        (slice(0, 2), r"Subset\(dataset, range\(len\(dataset\)\)\[a:b\]\)"),
        ("bar-0002", r"dataset\[dataset\.ids\.index\('bar-0002'\)\]"),
        ([0, 1], r"dataset\.__getitems__"),
        (1.0, "Subset"),
    ):
        with pytest.raises(DataError, match=hint):
            dataset[index]


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
    with pytest.raises(IndexError, match=r"no sample -?\d+: XDen1K\(.*\): \d objects"):
        XDen1K(folder, "val")[1]


def test_the_folder_is_found_by_the_environment(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDEN1K_ROOT", str(folder))
    assert len(XDen1K(split="test")) == 3


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One object with radiographs, two without."""
    out = tmp_path_factory.mktemp("published") / "folder"
    objects = [
        phantoms.published_object("bar-0001", phantoms.BAR, category="bar"),
        phantoms.box_object("cube-0001", phantoms.CUBE, category="cube"),
        phantoms.published_object("cube-0002", phantoms.CUBE, category="cube"),
    ]
    write_folder(objects, out, version="1.0.0", builder="test")
    return out


def test_a_sample_without_radiographs_has_every_field_but_theirs(published: Path) -> None:
    without, whole, _ = XDen1K(published, "test")
    assert tuple(whole) == FIELDS
    assert set(FIELDS) - without.keys() == {name for name in FIELDS if name.startswith("xray_")}
    assert tuple(XDen1K(published, "test", ["density", "mass_g"])[0]) == ("density", "mass_g")


def test_radiographs_that_there_are_none_of_are_refused_with_the_count(published: Path) -> None:
    with pytest.raises(DataError, match=r"2 of 3 objects .* no radiographs, and so no xray_pa:"):
        XDen1K(published, "test", ["mass_g", "xray_pa"])
    with pytest.raises(DataError, match=r"1 of 2 objects .* so no xray_lat_projection"):
        XDen1K(published, "test", "xray_lat_projection", categories="cube")


def test_a_batch_has_none_where_an_object_has_no_radiographs(published: Path) -> None:
    samples = list(XDen1K(published, "test"))
    batch = collate(samples)
    assert batch["density"].shape == (3, 64, 64, 64)
    assert [one is None for one in batch["xray_pa"]] == [True, False, True]
    assert batch["xray_lat_projection"][1].shape == (3, 4)
    assert "xray_pa" not in collate([samples[0], samples[2]])
    with pytest.raises(DataError, match="xray_pa is in 1 of the 3 samples of one batch"):
        collate(samples, one_size=True)
