"""The method surface-net: what is learned from pictures, and what is put behind a surface."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from tests.baselines.painted import BROWN, GREY, painted
from tests.phantoms import Box
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.predictor import Budget, Examples, Predictor, SampleView, Storable, takes_budget
from xden1k.values.types import DensityObject
from xden_baselines.surface.inference import named
from xden_baselines.surface.lessons import UNKNOWN, lessons
from xden_baselines.surface.matter import DEPTHS_CM, Matter, Seen, counted
from xden_baselines.surface.network import STRIDE, PixelNetwork, as_input
from xden_baselines.surface.predictor import SurfaceNet
from xden_baselines.surface.settings import Settings
from xden_baselines.surface.training import train
from xden_baselines.surface.voting import GaussianPropertySurfaceNet, NetworkVoter
from xden_baselines.views.cameras import Rig
from xden_baselines.views.source import RenderedPhantoms

PICTURES = RenderedPhantoms(Rig(elevations_deg=(-30.0, 30.0), per_ring=2, size_px=64))
OAK, STEEL = 0.7, 7.8
WALL_CM = 0.6
COLORS = {"handle": BROWN, "head": GREY}
NAMES = ("steel", "wood_oak")


def mallet(object_id: str, split: str, *, size: float = 1.0) -> DensityObject:
    """A solid handle of oak below a hollow head of steel, its walls 0.6 cm."""
    low, high = np.array([-2.0, -2, 3]) * size, np.array([3.0, 3, 8]) * size
    hole = tuple(low + WALL_CM), tuple(high - WALL_CM)
    boxes = (
        Box(
            "handle",
            (-size, -size, -2 * size),
            (2 * size, 2 * size, 3 * size),
            OAK,
            material="wood_oak",
        ),
        Box("head", tuple(low), tuple(high), STEEL, hole, material="steel"),
    )
    return painted(object_id, boxes, COLORS, split=split, category="mallet")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    root = tmp_path_factory.mktemp("surface") / "dataset"
    objects = [
        *(mallet(f"mallet-{n:04d}", "train", size=0.9 + 0.05 * n) for n in range(4)),
        mallet("mallet-0100", "test", size=1.02),
        mallet("mallet-0200", "val", size=2.2),
    ]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return open_folder(root)


@pytest.fixture(scope="module")
def fitted(folder: DatasetFolder) -> SurfaceNet:
    method = SurfaceNet(learning_rate=1e-2, batch=2)
    method.fit(examples(folder), seed=0, budget=Budget(epochs=4))
    return method


def examples(folder: DatasetFolder) -> Examples:
    return Examples(folder, "train", SurfaceNet.reads, "density", PICTURES)


def view(folder: DatasetFolder, object_id: str = "mallet-0100") -> SampleView:
    return SampleView(folder, object_id, SurfaceNet.reads, PICTURES)


def test_a_method_that_knows_colours_fills_solid_parts_and_leaves_hollow_ones_empty(
    folder: DatasetFolder, fitted: SurfaceNet
) -> None:
    sample = view(folder)
    field = fitted.predict(sample).density_g_cm3
    truth = folder.object(sample.object_id)
    inside = sample.envelope == 1
    labels = truth.labels[1::2, 1::2, 1::2]
    assert np.median(field[inside & (labels == 1)]) == pytest.approx(OAK, rel=0.05)
    assert np.median(field[inside & (labels == 2)]) == pytest.approx(STEEL, rel=0.05)
    assert np.median(field[inside & (labels == 0)]) == 0  # the cavity, which nobody sees


def test_what_was_saved_predicts_the_same_bytes(
    folder: DatasetFolder, fitted: SurfaceNet, tmp_path: Path
) -> None:
    fitted.save(tmp_path)
    again = SurfaceNet()
    again.load(tmp_path)
    sample = view(folder)
    one, other = (method.predict(sample).density_g_cm3 for method in (fitted, again))
    np.testing.assert_array_equal(one, other)
    assert again.notes == fitted.notes
    assert "material right on" in again.notes


def test_the_method_can_be_trained_with_a_budget_and_stored() -> None:
    method = SurfaceNet()
    assert isinstance(method, Predictor)
    assert isinstance(method, Storable)
    assert takes_budget(method)


def test_the_same_seed_gives_the_same_weights(folder: DatasetFolder) -> None:
    rng = np.random.default_rng(0)
    objects = [tuple(lessons(one, NAMES, 1, rng)) for one in examples(folder)]

    def weights(seed: int) -> torch.Tensor:
        settings = Settings(epochs=1, batch=3)
        return train(objects, NAMES, settings, seed=seed)[0].head.weight

    assert torch.equal(weights(1), weights(1))
    assert not torch.equal(weights(1), weights(2))


@pytest.mark.parametrize("damage", ["matter.npz", "model.safetensors", "training.json"])
def test_a_damaged_fit_is_named(fitted: SurfaceNet, tmp_path: Path, damage: str) -> None:
    fitted.save(tmp_path)
    (tmp_path / damage).write_bytes(b"no")
    with pytest.raises(DataError, match=str(tmp_path)):
        SurfaceNet().load(tmp_path)


def test_a_setting_out_of_range_is_refused() -> None:
    with pytest.raises(DataError, match="views must be positive"):
        SurfaceNet(views=0)
    with pytest.raises(DataError, match="held_out must lie"):
        SurfaceNet(held_out=1.0)


def test_a_lesson_says_what_each_pixel_shows(folder: DatasetFolder) -> None:
    example = next(iter(examples(folder)))
    for lesson in lessons(example, NAMES, 4, np.random.default_rng(0)):
        seen = lesson.picture[STRIDE // 2 :: STRIDE, STRIDE // 2 :: STRIDE]
        steel, oak = lesson.materials == 0, lesson.materials == 1
        assert (seen[steel][:, 0] <= seen[steel][:, 2]).all()  # grey
        assert (seen[oak][:, 0] > seen[oak][:, 2]).all()  # brown
        assert (seen[lesson.materials == UNKNOWN] == 255).all()


def test_a_material_that_is_not_on_the_list_is_not_learned(folder: DatasetFolder) -> None:
    example = next(iter(examples(folder)))
    shown = {
        int(one)
        for lesson in lessons(example, ("steel",), 4, np.random.default_rng(0))
        for one in np.unique(lesson.materials)
    }
    assert shown == {0, UNKNOWN}


def test_pictures_of_any_size_get_an_answer_for_each_block() -> None:
    network = PixelNetwork(materials=["steel", "wood"])
    colors, masks = torch.rand(1, 40, 52, 3), torch.ones(1, 40, 52)
    with torch.inference_mode():
        assert network(as_input(colors, masks)).shape == (1, 2, 64 // STRIDE, 64 // STRIDE)


def test_colours_off_the_object_change_nothing() -> None:
    masks = torch.zeros(1, 32, 32)
    masks[:, 8:20, 8:20] = 1
    colors = torch.rand(1, 32, 32, 3)
    other = torch.where(masks[..., None] > 0, colors, torch.rand(1, 32, 32, 3))
    torch.testing.assert_close(as_input(colors, masks), as_input(other, masks))


def surface_of(sample: SampleView) -> Seen:
    """All of the object is of the only material."""
    surface = sample.envelope > 0
    return Seen(surface, np.ones((int(surface.sum()), 1)))


def test_what_lies_behind_a_surface_is_what_was_counted_there(folder: DatasetFolder) -> None:
    sample = view(folder)
    matter = counted([(sample, surface_of(sample), 3 * sample.envelope)], 1)
    field = matter.median_g_cm3(sample, surface_of(sample))
    np.testing.assert_allclose(field, 3 * sample.envelope, rtol=1e-6)


def test_a_small_object_counts_as_much_as_a_large_one(folder: DatasetFolder) -> None:
    small, large = view(folder), view(folder, "mallet-0200")
    both = [(one, surface_of(one), one.envelope * k) for one, k in ((small, 1.0), (large, 5.0))]
    depth = DEPTHS_CM.index(0.8)
    of_both, of_small = (counted(some, 1).counts[0, depth] for some in (both, both[:1]))
    assert of_both.argmax() == of_small.argmax()  # of the voxels there it has one in five


def test_counts_that_do_not_fit_are_refused() -> None:
    depths, classes = len(DEPTHS_CM) + 1, 64
    with pytest.raises(DataError, match="expected counts"):
        Matter(np.ones((2, depths, 3)), np.ones(3))
    with pytest.raises(DataError, match="add up to 1"):
        Matter(np.ones((2, depths, classes)), np.ones(classes))
    with pytest.raises(DataError, match="no training object"):
        counted([], 2)


@pytest.fixture(scope="module")
def voting(folder: DatasetFolder, fitted: SurfaceNet, tmp_path_factory: pytest.TempPathFactory):
    kept = tmp_path_factory.mktemp("kept")
    fitted.save(kept)
    method = GaussianPropertySurfaceNet(network=str(kept))
    method.fit(examples(folder), seed=0)
    return method


def test_the_network_names_regions_and_the_vote_fills_them_solid(
    folder: DatasetFolder, voting: GaussianPropertySurfaceNet
) -> None:
    assert isinstance(voting, Predictor)
    assert takes_budget(voting)
    sample = view(folder)
    density = voting.predict(sample).density_g_cm3
    x, _, z = np.moveaxis(np.indices(density.shape), 0, -1)[sample.envelope == 1].T
    found = density[sample.envelope == 1]
    head = sample.origin_cm[2] + z * sample.voxel_size_cm > 4.0
    handle = sample.origin_cm[2] + z * sample.voxel_size_cm < 2.0
    assert np.median(found[head]) == pytest.approx(STEEL, rel=0.05)  # hollow, and filled
    assert np.median(found[handle]) == pytest.approx(OAK, rel=0.2)
    assert len(x) == len(found)


def test_a_region_is_what_the_network_says_of_most_of_it(
    folder: DatasetFolder, fitted: SurfaceNet
) -> None:
    pictures = view(folder).pictures
    regions = pictures.masks[0].astype(np.int32)  # the whole object is one
    (answer,) = NetworkVoter(fitted.network).vote("mallet-0100", pictures.colors[0], regions)
    said = next(iter(named(fitted.network, pictures.take([0]), 1, "cpu")))
    mean = said[pictures.masks[0]].mean(axis=0)
    assert answer.material == mean.argmax()
    assert answer.confidence == pytest.approx(mean.max(), rel=1e-5)


def test_a_vote_by_the_network_is_taken_up_from_its_folder(
    folder: DatasetFolder, voting: GaussianPropertySurfaceNet, tmp_path: Path
) -> None:
    assert isinstance(voting, Storable)
    voting.save(tmp_path)
    loaded = GaussianPropertySurfaceNet()
    loaded.load(tmp_path)
    sample = view(folder)
    expected = voting.predict(sample).density_g_cm3
    np.testing.assert_array_equal(loaded.predict(sample).density_g_cm3, expected)
    assert loaded.notes == voting.notes
    assert "GaussianProperty without" in voting.notes
    assert "materials, trained on the training split; colour regions for masks" in voting.notes
    (tmp_path / "materials.json").write_text("{}")
    with pytest.raises(DataError, match=r"materials\.json: no fit of such a method"):
        GaussianPropertySurfaceNet().load(tmp_path)


def test_other_weights_in_the_same_folder_are_another_method(
    fitted: SurfaceNet, tmp_path: Path
) -> None:
    fitted.save(tmp_path)
    method = GaussianPropertySurfaceNet(network=str(tmp_path))
    before = method.fingerprint
    assert before != GaussianPropertySurfaceNet().fingerprint
    other = SurfaceNet()
    other._network = PixelNetwork(materials=NAMES)
    other._matter, other._report = fitted._matter, fitted._report
    other.save(tmp_path)
    assert method.fingerprint != before
    with pytest.raises(DataError, match="nowhere: no checkpoint there"):
        _ = GaussianPropertySurfaceNet(network="nowhere").fingerprint


def test_a_network_of_other_materials_is_refused(
    folder: DatasetFolder, fitted: SurfaceNet, tmp_path: Path
) -> None:
    other = SurfaceNet()
    other._network = PixelNetwork(materials=("steel", "glass"))
    other._matter, other._report = fitted._matter, fitted._report
    other.save(tmp_path)
    with pytest.raises(DataError, match="expected a network of the training split's 2 materials"):
        GaussianPropertySurfaceNet(network=str(tmp_path)).fit(examples(folder), seed=0)
