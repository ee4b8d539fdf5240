"""The oracles and the rows of the X-rays alone: values in closed form, and what they may see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from tests.phantoms import APPARENT, BAR, CUBE, FILLED, HOLLOW, Box, box_object, published_object
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.predictor import Examples, Prediction, Predictor, SampleView, Storable
from xden1k.values.materials import MaterialLibrary, families, load_materials
from xden1k.values.modality import Modality, ModalityError
from xden1k.values.physics import PAPER_MAC_CM2_G
from xden1k.values.types import DensityField, DensityObject
from xden_baselines import materials
from xden_baselines.materials import density_range_g_cm3
from xden_baselines.references import (
    MOST_G_CM3,
    LabelNominal,
    PartOracle,
    PublishedLac017,
    TrueMassUniform,
    XrayMean,
    XrayUniform,
    shadow_lac_per_cm,
)
from xden_baselines.xray import back_projected_lac_per_cm

ORACLES = [TrueMassUniform, PartOracle, LabelNominal]
XRAY = [XrayUniform, XrayMean]
ONE_OF_EACH = [TrueMassUniform, XrayMean, pytest.param(XrayUniform, marks=pytest.mark.slow)]
SHAPE = (96, 96)


def folder_of(objects: Sequence[DensityObject], root: Path) -> DatasetFolder:
    write_folder(objects, root, version="0.1.0", builder="tests")
    return open_folder(root)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    objects = [
        box_object("bar-0001", BAR, split="test", shape=SHAPE),
        box_object("cube-0001", CUBE, split="train", shape=SHAPE),
        box_object("cube-0002", CUBE, split="test", shape=SHAPE),
        box_object("filled-0001", FILLED, split="train", shape=SHAPE),
        box_object("hollow-0001", HOLLOW, split="train", shape=SHAPE),
    ]
    return folder_of(objects, tmp_path_factory.mktemp("references") / "dataset")


@cache
def fitted(kind: type, folder: DatasetFolder) -> Predictor:
    predictor: Predictor = kind()
    if predictor.trainable:
        predictor.fit(Examples(folder, "train", predictor.reads), seed=0)
    return predictor


def predicted(predictor: Predictor, folder: DatasetFolder, object_id: str) -> np.ndarray:
    found = predictor.predict(SampleView(folder, object_id, predictor.reads))
    return found.density_g_cm3 if isinstance(found, Prediction) else found


@pytest.mark.parametrize("kind", [*ORACLES, *XRAY])
def test_each_is_a_predictor_and_oracles_say_that_they_are(
    folder: DatasetFolder, kind: type
) -> None:
    predictor = fitted(kind, folder)
    assert isinstance(predictor, Predictor)
    told = Modality.TRUTH | Modality.MATERIALS
    assert bool(told & predictor.reads) == (kind in ORACLES)


@pytest.mark.parametrize(
    ("kind", "modality"),
    [(kind, one) for kind in [*ORACLES, *XRAY] for one in kind.reads if one != Modality.PARTS],
)
def test_every_declared_modality_is_read_and_no_other(
    folder: DatasetFolder, kind: type, modality: Modality
) -> None:
    predictor = fitted(kind, folder)
    predicted(predictor, folder, "bar-0001")
    with pytest.raises(ModalityError, match=f"needs the modality {modality.name}"):
        predictor.predict(SampleView(folder, "bar-0001", predictor.reads & ~modality))


def test_the_true_mass_spread_evenly_is_the_true_mass(folder: DatasetFolder) -> None:
    sample = SampleView(folder, "bar-0001", TrueMassUniform.reads)
    grid = TrueMassUniform().predict(sample)
    assert grid.sum() * sample.voxel_size_cm**3 == pytest.approx(72, rel=2e-3)
    np.testing.assert_allclose(grid[sample.envelope == 1], 4.5, rtol=5e-3)


def test_the_part_oracle_knows_the_parts(folder: DatasetFolder) -> None:
    assert predicted(PartOracle(), folder, "bar-0001").tolist() == [0.0, 1.0, 8.0]


def test_oracles_answer_in_the_target_that_is_asked_for(folder: DatasetFolder) -> None:
    def asked(kind: type) -> np.ndarray:
        sample = SampleView(folder, "bar-0001", kind.reads, target="apparent_density")
        return np.asarray(kind().predict(sample))

    assert asked(PartOracle).tolist() == [0.0, APPARENT, 8 * APPARENT]
    assert asked(TrueMassUniform).max() == pytest.approx(4.5 * APPARENT, rel=5e-3)
    with pytest.raises(DataError, match="knows true densities, not apparent ones"):
        asked(LabelNominal)


def test_the_release_is_answered_by_what_it_says_and_by_nothing_else(
    folder: DatasetFolder, tmp_path: Path
) -> None:
    reads = PublishedLac017.reads
    published = folder_of([published_object("x", BAR)], tmp_path / "d")
    found = PublishedLac017().predict(SampleView(published, "x", reads))
    assert found.tolist() == [0.0, APPARENT, 8 * APPARENT]
    with pytest.raises(DataError, match=r"bar-0001 must be .* 'published', it is of 'phantom'"):
        PublishedLac017().predict(SampleView(folder, "bar-0001", reads))
    with pytest.raises(DataError, match="is the apparent density"):
        PublishedLac017().predict(SampleView(published, "x", reads, target="apparent_density"))


def test_the_release_is_an_oracle_and_declares_it() -> None:
    assert isinstance(PublishedLac017(), Predictor)
    assert PublishedLac017.reads.inputs == ("parts", "truth")


def test_a_label_stands_for_what_the_table_calls_usual(folder: DatasetFolder) -> None:
    library = load_materials()
    nominal = [library[name].density_nominal_g_cm3 for name in ("polypropylene", "steel")]
    found = LabelNominal().predict(SampleView(folder, "bar-0001", LabelNominal.reads))
    np.testing.assert_allclose(found.density_g_cm3, [0, *nominal])
    assert found.remark == ""


def test_the_label_of_a_family_is_remarked(tmp_path: Path) -> None:
    boxes = (replace(BAR[0], material="metal"), BAR[1])
    metals = [one for one in load_materials().bases.values() if one.family == "metal"]
    folder = folder_of([box_object("x", boxes)], tmp_path / "d")
    found = LabelNominal().predict(SampleView(folder, "x", LabelNominal.reads))
    expected = np.median([one.density_nominal_g_cm3 for one in metals])
    assert found.density_g_cm3[1] == pytest.approx(expected)
    assert found.remark == "the median of a family stands for its members"


def test_grades_in_the_library_widen_no_familys_range(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {family: density_range_g_cm3(family) for family in families()}
    bases = MaterialLibrary(tuple(load_materials().bases.values()))
    monkeypatch.setattr(materials, "load_materials", lambda: bases)
    assert found == {family: density_range_g_cm3(family) for family in families()}


def test_a_part_without_label_is_named(folder: DatasetFolder) -> None:
    with pytest.raises(DataError, match="hollow-0001: the material table has no"):
        predicted(LabelNominal(), folder, "hollow-0001")


def test_an_unknown_density_is_refused(tmp_path: Path) -> None:
    folder = folder_of([box_object("x", BAR, density_known=False)], tmp_path / "d")
    with pytest.raises(DataError, match="x has no known density"):
        predicted(TrueMassUniform(), folder, "x")
    with pytest.raises(DataError, match="x: a part has no known density"):
        predicted(PartOracle(), folder, "x")


def test_the_shadow_of_a_homogeneous_body_gives_its_attenuation_off_centre_too(
    tmp_path: Path,
) -> None:
    # close to the source, where the near face is magnified 1.5 times as much as the far one
    deep = (Box("cube", (-6, -20, -6), (6, 20, 6), 0.2),)
    folder = folder_of([box_object("x", deep, shape=(256, 256))], tmp_path / "d")
    sample = SampleView(folder, "x", XrayUniform.reads)
    expected = 0.2 * APPARENT * PAPER_MAC_CM2_G
    assert shadow_lac_per_cm(sample, sample.views[0]) == pytest.approx(expected, rel=0.02)


def test_the_rays_alone_find_a_homogeneous_body(folder: DatasetFolder) -> None:
    for kind in XRAY:
        grid = predicted(fitted(kind, folder), folder, "cube-0002")
        sample = SampleView(folder, "cube-0002", Modality.GEOMETRY)
        deep = ndimage.binary_erosion(sample.envelope == 1, iterations=4)
        np.testing.assert_allclose(grid[deep], 2.0, rtol=0.06)
        assert not grid[sample.envelope == 0].any()


def test_the_rays_alone_tell_steel_from_plastic(folder: DatasetFolder) -> None:
    grid = predicted(fitted(XrayMean, folder), folder, "bar-0001")
    inside = SampleView(folder, "bar-0001", Modality.GEOMETRY).envelope == 1
    middle = inside & (np.arange(64) > 20)[None, None, :] & (np.arange(64) < 44)[None, None, :]
    columns = np.flatnonzero(middle.any(axis=(1, 2)))
    light, heavy = columns[: len(columns) // 3], columns[-len(columns) // 3 :]
    assert grid[heavy][middle[heavy]].mean() > 1.5 * grid[light][middle[light]].mean()


def test_no_voxel_is_denser_than_matter_is(folder: DatasetFolder) -> None:
    method = fitted(XrayMean, folder)
    method._factor *= 1e5
    view = SampleView(folder, "bar-0001", method.reads)
    most = [method.predict(replace(view, target=each)).max() for each in MOST_G_CM3]
    assert most == list(MOST_G_CM3.values())


def test_a_plate_thinner_than_half_a_voxel_is_seen_through_its_face(tmp_path: Path) -> None:
    ruler = (Box("ruler", (-8, -0.05, -2), (8, 0.05, 2), 1.0),)
    folder = folder_of([box_object("x", ruler, shape=SHAPE)], tmp_path / "d")
    assert folder.row("x", ["voxel_size_cm"])["voxel_size_cm"] > 0.2
    sample = SampleView(folder, "x", XrayMean.reads)
    lac = back_projected_lac_per_cm(sample)[0][sample.envelope > 0]
    assert np.median(lac) == pytest.approx(APPARENT * PAPER_MAC_CM2_G, rel=0.1)


@pytest.mark.parametrize("kind", XRAY)
def test_other_radiographs_give_another_prediction(tmp_path: Path, kind: type) -> None:
    obj = box_object("x", CUBE, split="train", shape=SHAPE)
    clear = tuple(replace(view, transmission=view.transmission**0.5) for view in obj.views)
    known = folder_of([obj], tmp_path / "known")
    other = folder_of([replace(obj, views=clear)], tmp_path / "other")
    method = fitted(kind, known)
    half = predicted(method, other, "x").sum() / predicted(method, known, "x").sum()
    assert half == pytest.approx(0.5, rel=0.01)


@pytest.mark.parametrize("kind", ONE_OF_EACH)
def test_the_order_of_the_parts_changes_nothing(tmp_path: Path, kind: type) -> None:
    obj = box_object("x", BAR, split="train", shape=SHAPE)
    turned = box_object("x", BAR[::-1], split="train", shape=SHAPE)
    one, other = folder_of([obj], tmp_path / "one"), folder_of([turned], tmp_path / "other")
    np.testing.assert_allclose(
        predicted(fitted(kind, one), one, "x"),
        predicted(fitted(kind, other), other, "x"),
        rtol=1e-4,
        atol=1e-6,
    )


@pytest.mark.parametrize("kind", [PartOracle, LabelNominal])
def test_part_densities_follow_their_parts(tmp_path: Path, kind: type) -> None:
    one = folder_of([box_object("x", BAR)], tmp_path / "one")
    other = folder_of([box_object("x", BAR[::-1])], tmp_path / "other")
    values, turned = (predicted(kind(), place, "x") for place in (one, other))
    np.testing.assert_array_equal(values[1:], turned[:0:-1])


def grown(box: Box, factor: float) -> Box:
    low, high = (tuple(factor * value for value in corner) for corner in (box.low, box.high))
    return replace(box, low=low, high=high)


@pytest.mark.parametrize("kind", ONE_OF_EACH)
def test_twice_as_large_is_as_dense_and_eight_times_as_heavy(tmp_path: Path, kind: type) -> None:
    light = (BAR[0], replace(BAR[1], density_g_cm3=2.0))
    objects = [
        box_object(f"x-{factor}", [grown(box, factor) for box in light], split="train", shape=SHAPE)
        for factor in (1, 2)
    ]
    folder = folder_of(objects, tmp_path / "d")
    method = fitted(kind, folder)
    fields = [
        DensityField(predicted(method, folder, obj.object_id), obj.origin_cm, obj.voxel_size_cm)
        for obj in objects
    ]
    assert fields[1].density_g_cm3.mean() == pytest.approx(fields[0].density_g_cm3.mean(), rel=0.02)
    assert fields[1].mass_g == pytest.approx(8 * fields[0].mass_g, rel=0.02)
    np.testing.assert_allclose(fields[1].com_cm, 2 * fields[0].com_cm, rtol=0.02)


@pytest.mark.parametrize("kind", XRAY)
def test_what_was_learned_is_kept_to_the_bit(
    folder: DatasetFolder, tmp_path: Path, kind: type
) -> None:
    method, again = fitted(kind, folder), kind()
    assert isinstance(method, Storable)
    method.save(tmp_path)
    again.load(tmp_path)
    assert again.notes == method.notes
    np.testing.assert_array_equal(
        predicted(method, folder, "bar-0001"), predicted(again, folder, "bar-0001")
    )
