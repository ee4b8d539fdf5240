"""The methods nerf2physics and nerf2physics-thickness, from pictures to a density."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.baselines.painted import BROWN, GREY, painted
from tests.phantoms import Box
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.predictor import Examples, Fingerprinted, Prediction, Predictor, SampleView, Storable
from xden1k.values.modality import Modality, ModalityError
from xden1k.values.types import DensityObject
from xden_baselines.chat.candidates import Candidate
from xden_baselines.features.settings import clip_folder
from xden_baselines.nerf2physics.predictor import NeRF2Physics, NeRF2PhysicsThickness, described
from xden_baselines.nerf2physics.prior import Proposals
from xden_baselines.views.cameras import Rig
from xden_baselines.views.pictures import Pictures
from xden_baselines.views.source import RenderedPhantoms

RIG = Rig(elevations_deg=(-30.0, 30.0), per_ring=3, size_px=160)
COLORS = {"handle": BROWN, "head": GREY}
READS = NeRF2Physics.reads


def mallet(
    object_id: str, split: str, *, size: float = 1.0, head: float = 2.0, shift: float = 0.0
) -> DensityObject:
    """A wooden handle below a steel head."""

    def corner(*values: float) -> tuple[float, float, float]:
        return tuple(size * value + shift for value in values)

    boxes = (
        Box("handle", corner(0, 0, 0), corner(1, 1, 3), 0.7, material="wood_oak"),
        Box("head", corner(-0.5, 0, 3), corner(head, 1, 4), 7.8, material="steel"),
    )
    return painted(object_id, boxes, COLORS, split=split, category="mallet")


@dataclass(frozen=True)
class Turned:
    """The pictures of another source, changed."""

    description = "test"
    change: Any = None

    def __call__(self, folder: DatasetFolder, object_id: str) -> Pictures:
        pictures = RenderedPhantoms(RIG)(folder, object_id)
        return self.change(pictures) if self.change else pictures


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    root = tmp_path_factory.mktemp("nerf2physics") / "dataset"
    objects = [
        mallet("mallet-0001", "train"),
        mallet("mallet-0002", "train", head=1.5),
        mallet("mallet-0003", "test", head=1.8),
        mallet("mallet-0004", "test", head=1.8, size=2.0),
        mallet("mallet-0005", "test", head=1.8, shift=7.0),
    ]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return open_folder(root)


def fitted(folder: DatasetFolder, kind: type = NeRF2Physics) -> Any:
    predictor = kind(clip="")
    predictor.fit(Examples(folder, "train", READS, pictures_of=Turned()), seed=0)
    return predictor


@pytest.fixture(scope="module")
def solid(folder: DatasetFolder) -> Any:
    return fitted(folder)


def sample(folder: DatasetFolder, object_id: str = "mallet-0003", change: Any = None) -> SampleView:
    return SampleView(folder, object_id, READS, Turned(change))


def test_both_are_predictors_that_say_what_they_know(folder: DatasetFolder, solid: Any) -> None:
    for predictor in (solid, NeRF2PhysicsThickness(clip="")):
        assert isinstance(predictor, Predictor)
        assert isinstance(predictor, Storable)
        assert isinstance(predictor, Fingerprinted)
        assert not predictor.external_data
    assert solid.notes == (
        "fitted encoder; material prior of the training split; volume rule solid; NeRF2Physics "
        "without its NeRF (the mesh is given), CLIP, its chat model and captions"
    )


def test_a_density_lies_between_those_of_the_materials_and_follows_them(
    folder: DatasetFolder, solid: Any
) -> None:
    at = sample(folder)
    found = solid.predict(at)
    assert isinstance(found, Prediction)
    density = found.density_g_cm3
    assert density.dtype == np.float32
    assert density.shape == (64, 64, 64)
    assert not density[at.envelope == 0].any()
    heights = at.origin_cm[2] + at.voxel_size_cm * np.arange(64)
    full = at.envelope == 1
    handle = density[:, :, heights < 2.0][full[:, :, heights < 2.0]]
    head = density[:, :, heights > 3.5][full[:, :, heights > 3.5]]
    assert head.mean() > 6
    assert handle.mean() < 2
    assert found.mass_native_g == pytest.approx(0.6 * density.sum() * at.voxel_size_cm**3, rel=1e-4)


@pytest.mark.slow
def test_a_prediction_is_the_same_to_the_bit_when_run_again(
    folder: DatasetFolder, solid: Any
) -> None:
    one = solid.predict(sample(folder)).density_g_cm3
    solid.predict(sample(folder, "mallet-0004"))
    again = fitted(folder).predict(sample(folder)).density_g_cm3
    assert one.tobytes() == again.tobytes()


def test_what_was_learned_can_be_kept(folder: DatasetFolder, solid: Any, tmp_path: Path) -> None:
    solid.save(tmp_path)
    loaded = NeRF2Physics(clip="")
    loaded.load(tmp_path)
    one, other = (each.predict(sample(folder)) for each in (solid, loaded))
    assert one.density_g_cm3.tobytes() == other.density_g_cm3.tobytes()
    assert one.mass_native_g == other.mass_native_g
    assert loaded.notes == solid.notes
    (tmp_path / "seed.txt").write_text("none")
    with pytest.raises(DataError, match=r"seed\.txt: no seed"):
        loaded.load(tmp_path)


@pytest.mark.parametrize(
    "text",
    [
        "[]",
        '{"source": "x", "by_category": {}}',
        '{"source": "x", "by_category": {"": []}}',
        '{"source": "x", "by_category": {"": [{"name": "a"}]}}',
        '{"source": "x", "by_category": {"": [{"name": "a", "density_g_cm3": 1, '
        '"thickness_cm": [1, 2]}]}}',
    ],
)
def test_another_file_is_no_table_of_proposals(tmp_path: Path, text: str) -> None:
    path = tmp_path / "proposals.json"
    path.write_text(text)
    with pytest.raises(DataError, match=r"proposals\.json: no table of proposals"):
        Proposals.load(path)


def test_an_unseen_category_gets_the_candidates_of_all_objects() -> None:
    stone = Candidate("stone", density_g_cm3=(2.0, 3.0), thickness_cm=(1.0, 2.0))
    table = Proposals("x", {"": (stone,), "mallet": (stone, stone)})
    assert table.propose("kettle-0001", "kettle") == (stone,)


def test_the_order_of_views_does_not_change_the_density(folder: DatasetFolder, solid: Any) -> None:
    turned = sample(folder, change=lambda pictures: pictures.take([4, 0, 5, 2, 1, 3]))
    np.testing.assert_allclose(
        solid.predict(turned).density_g_cm3,
        solid.predict(sample(folder)).density_g_cm3,
        rtol=1e-5,
        atol=1e-6,
    )


def test_other_colours_give_another_density(folder: DatasetFolder, solid: Any) -> None:
    def swapped(pictures: Pictures) -> Pictures:
        """All grey, as the head is."""
        grey = np.where(pictures.masks[..., None], 140, pictures.colors).astype(np.uint8)
        return replace(pictures, colors=grey)

    one, other = solid.predict(sample(folder)), solid.predict(sample(folder, change=swapped))
    assert other.density_g_cm3.sum() > 1.2 * one.density_g_cm3.sum()


def test_an_object_twice_as_large_has_the_same_density_and_eight_times_the_mass(
    folder: DatasetFolder, solid: Any
) -> None:
    small, large = (solid.predict(sample(folder, f"mallet-000{number}")) for number in (3, 4))
    # equal up to points and pixels that rounding moves over an edge of a patch of 18 pixels
    difference = np.abs(small.density_g_cm3 - large.density_g_cm3)
    assert difference.mean() < 5e-3 * small.density_g_cm3.mean()
    assert large.mass_native_g == pytest.approx(8 * small.mass_native_g, rel=1e-3)


def test_where_an_object_stands_does_not_matter(folder: DatasetFolder, solid: Any) -> None:
    here, there = (solid.predict(sample(folder, f"mallet-000{number}")) for number in (3, 5))
    difference = np.abs(here.density_g_cm3 - there.density_g_cm3)
    assert difference.mean() < 1e-3 * here.density_g_cm3.mean()


def test_a_model_is_asked_with_a_picture_and_its_fallbacks_are_counted(
    folder: DatasetFolder,
) -> None:
    class Model:
        """Proposes one material, and says that another did."""

        source = "replay:0123"
        fallbacks = 3

        def propose(self, object_id: str, category: str, picture: Any) -> tuple[Candidate, ...]:
            self.asked = object_id, category, picture
            self.fallbacks += 1
            return (Candidate("stone", density_g_cm3=(2.0, 3.0), thickness_cm=(1.0, 2.0)),)

    predictor = fitted(folder)
    predictor._proposer = model = Model()
    at = sample(folder)
    found = predictor.predict(at)
    assert found.fallbacks == 1
    assert model.asked[:2] == ("mallet-0003", "mallet")
    np.testing.assert_array_equal(model.asked[2], described(at.pictures))
    np.testing.assert_allclose(found.density_g_cm3, 2.5 * at.envelope, rtol=1e-6)


def test_a_shell_is_the_solid_without_its_inside(folder: DatasetFolder, solid: Any) -> None:
    shell = fitted(folder, NeRF2PhysicsThickness)
    assert "volume rule thickness; NeRF2Physics without" in shell.notes
    thin = Candidate("steel", density_g_cm3=(7.8, 7.8), thickness_cm=(0.1, 0.1))
    shell._proposer = Proposals("test", {"": (thin,)})
    at = sample(folder)
    found = shell.predict(at)
    area = at.outer_mesh.area
    assert found.mass_native_g == pytest.approx(0.6 * 7.8 * 0.1 * area, rel=1e-3)
    # edges are counted once in the field, once for each face in the area
    mass = found.density_g_cm3.sum() * at.voxel_size_cm**3
    assert mass == pytest.approx(7.8 * 0.1 * area, rel=0.15)


@pytest.mark.parametrize("missing", [Modality.GEOMETRY, Modality.RGB, Modality.CATEGORY])
def test_it_needs_all_that_it_declares(
    folder: DatasetFolder, solid: Any, missing: Modality
) -> None:
    with pytest.raises(ModalityError, match=f"needs the modality {missing.name}"):
        solid.predict(SampleView(folder, "mallet-0003", READS & ~missing, Turned()))


def test_true_densities_are_all_it_learns(folder: DatasetFolder) -> None:
    train = Examples(folder, "train", READS, "apparent_density", Turned())
    with pytest.raises(DataError, match="expected the target 'density'"):
        NeRF2Physics(clip="").fit(train, seed=0)


def test_pictures_that_show_nothing_are_an_error(folder: DatasetFolder, solid: Any) -> None:
    def emptied(pictures: Pictures) -> Pictures:
        return replace(pictures, masks=np.zeros_like(pictures.masks))

    with pytest.raises(DataError, match="mallet-0003: no view shows a point"):
        solid.predict(sample(folder, change=emptied))


def test_the_described_view_is_the_one_at_three_quarters_of_mask_area(
    folder: DatasetFolder,
) -> None:
    pictures = Turned()(folder, "mallet-0003").take([0, 1, 2, 3, 4])
    areas = pictures.masks.sum(axis=(1, 2))
    chosen = described(pictures)
    (view,) = (v for v in range(5) if np.array_equal(chosen, pictures.colors[v]))
    assert (areas < areas[view]).sum() <= 3 <= (areas <= areas[view]).sum()
    assert (areas >= areas[view]).sum() >= 2


def test_weights_that_are_not_there_are_an_error(folder: DatasetFolder, tmp_path: Path) -> None:
    predictor = NeRF2Physics(clip=str(tmp_path))
    assert predictor.external_data
    with pytest.raises(DataError, match="of a CLIP is expected"):
        _ = predictor.fingerprint
    with pytest.raises(DataError, match="of a CLIP is expected"):
        predictor.fit(Examples(folder, "train", READS, pictures_of=Turned()), seed=0)


def test_a_folder_that_the_command_line_takes_for_a_number_is_refused() -> None:
    with pytest.raises(DataError, match=r"clip must be the name of a folder, got 7: write \./7"):
        clip_folder(7)


def test_a_device_is_named_for_clip_alone() -> None:
    with pytest.raises(DataError, match="CLIP alone runs on 'cuda': name the folder of its w"):
        NeRF2Physics(clip="", device="cuda")
