"""The methods gaussian-property, -weighted and -parts, from pictures to densities."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.baselines.chat_stub import Reply, stub_endpoint
from tests.baselines.painted import BROWN, GREY, RED, painted
from tests.phantoms import Box
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.predictor import Examples, Fingerprinted, Predictor, SampleView, Storable
from xden1k.values.modality import Modality, ModalityError
from xden1k.values.types import DensityObject
from xden_baselines.chat.endpoint import ChatError
from xden_baselines.gaussian_property.predictor import (
    GaussianProperty,
    GaussianPropertyParts,
    GaussianPropertyWeighted,
)
from xden_baselines.views.cameras import Rig
from xden_baselines.views.pictures import Pictures
from xden_baselines.views.source import RenderedPhantoms

ALL = [GaussianProperty, GaussianPropertyWeighted, GaussianPropertyParts]
MOSTLY_ONE = [
    GaussianPropertyWeighted,
    pytest.param(GaussianProperty, marks=pytest.mark.slow),
    pytest.param(GaussianPropertyParts, marks=pytest.mark.slow),
]
RIG = Rig(elevations_deg=(-30.0, 30.0), per_ring=3, size_px=96)
COLORS = {"handle": BROWN, "head": GREY, "core": RED}
OAK, STEEL = 0.75, 7.825
"""Middles of the library's ranges."""
Change = Callable[[Pictures], Pictures]


def hammer(object_id: str, split: str, *, size: float = 1.0, head: float = 2.0) -> DensityObject:
    """A wooden handle below a steel head that hides a core."""

    def corner(*values: float) -> tuple[float, float, float]:
        return tuple(size * value for value in values)

    core = corner(0.2, 0.2, 3.2), corner(0.8, 0.8, 3.8)
    boxes = (
        Box("handle", corner(0, 0, 0), corner(1, 1, 3), 0.7, material="wood_oak"),
        Box("head", corner(-0.5, 0, 3), corner(head, 1, 4), 7.8, core, material="steel"),
        Box("core", *core, 0.05, material="foam_eps"),
    )
    return painted(object_id, boxes, COLORS, split=split, category="hammer")


@dataclass(frozen=True)
class Changed:
    """The renderer's pictures, changed."""

    change: Change | None = None

    description = "test"

    def __call__(self, folder: DatasetFolder, object_id: str) -> Pictures:
        pictures = RenderedPhantoms(RIG)(folder, object_id)
        return self.change(pictures) if self.change else pictures


def reordered(obj: DensityObject, object_id: str) -> DensityObject:
    """The same object, its parts in another order."""
    order = [2, 0, 1]
    labels = np.array([0, *(1 + np.argsort(order))], dtype=np.uint8)[obj.labels]
    parts = tuple(obj.parts[part] for part in order)
    return replace(obj, object_id=object_id, parts=parts, labels=labels)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    root = tmp_path_factory.mktemp("gaussian_property") / "dataset"
    test = hammer("hammer-0003", "test", head=1.8)
    objects = [
        hammer("hammer-0001", "train"),
        hammer("hammer-0002", "train", head=1.5),
        test,
        reordered(test, "hammer-0004"),
        hammer("hammer-0005", "test", head=1.8, size=2.0),
    ]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return open_folder(root)


@pytest.fixture(autouse=True)
def _no_chat_model(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("MODE", "BASE_URL", "MODEL", "API_KEY", "CASSETTE", "FALLBACK", "IN_FLIGHT"):
        monkeypatch.delenv(f"XDEN_VLM_{name}", raising=False)


def fitted(folder: DatasetFolder, kind: type = GaussianProperty) -> Any:
    predictor = kind()
    predictor.fit(Examples(folder, "train", predictor.reads, pictures_of=Changed()), seed=0)
    return predictor


@pytest.fixture(scope="module")
def learned(folder: DatasetFolder) -> dict[type, Any]:
    return {kind: fitted(folder, kind) for kind in ALL}


def sample(
    folder: DatasetFolder,
    kind: type = GaussianProperty,
    object_id: str = "hammer-0003",
    change: Change | None = None,
) -> SampleView:
    return SampleView(folder, object_id, kind.reads, Changed(change))


def at(view: SampleView, x: float, y: float, z: float) -> tuple[int, ...]:
    """Index of the voxel at a place in cm."""
    place = (np.array([x, y, z]) - view.origin_cm) / view.voxel_size_cm
    return tuple(np.rint(place).astype(int).tolist())


def test_all_are_predictors_that_say_who_answers(learned: dict[type, Any]) -> None:
    for predictor in learned.values():
        assert isinstance(predictor, Predictor)
        assert isinstance(predictor, Storable)
        assert isinstance(predictor, Fingerprinted)
        assert not predictor.external_data
        assert predictor.notes.startswith("classifier of colours fitted on the training split; ")


def test_regions_take_their_material_and_insides_that_of_the_nearest(
    folder: DatasetFolder, learned: dict[type, Any]
) -> None:
    view = sample(folder)
    density = learned[GaussianProperty].predict(view).density_g_cm3
    assert density[at(view, 0.5, 0.5, 1)] == pytest.approx(OAK)
    assert density[at(view, 1.5, 0.5, 3.5)] == pytest.approx(STEEL)
    # the core is inside the outer surface, where nothing tells it from the steel around it
    assert density[at(view, 0.5, 0.5, 3.5)] == pytest.approx(STEEL)
    assert not density[view.envelope == 0].any()


def test_true_parts_take_their_material_and_a_hidden_one_that_of_its_neighbour(
    folder: DatasetFolder, learned: dict[type, Any]
) -> None:
    view = sample(folder, GaussianPropertyParts)
    density = learned[GaussianPropertyParts].predict(view).density_g_cm3
    assert density == pytest.approx([0, OAK, STEEL, STEEL])


def test_masses_of_parts_add_up(folder: DatasetFolder, learned: dict[type, Any]) -> None:
    parts = learned[GaussianPropertyParts].predict(sample(folder, GaussianPropertyParts))
    # 3 cm³ of oak; the head with its core is 2.3 cm³
    assert parts.mass_native_g == pytest.approx(3 * OAK + 2.3 * STEEL, rel=1e-6)
    view = sample(folder)
    field = learned[GaussianProperty].predict(view)
    volume = view.voxel_size_cm**3
    assert field.mass_native_g == pytest.approx(field.density_g_cm3.sum() * volume, rel=1e-5)
    assert field.mass_native_g == pytest.approx(parts.mass_native_g, rel=0.05)


def test_only_the_weighted_vote_gives_a_deviation(
    folder: DatasetFolder, learned: dict[type, Any]
) -> None:
    weighted = learned[GaussianPropertyWeighted].predict(sample(folder))
    view = sample(folder)
    steel, oak = at(view, 1.5, 0.5, 3.5), at(view, 0.5, 0.5, 1)
    assert weighted.density_sd_g_cm3[steel] > 0
    # pulled towards the training split's mean
    assert OAK < weighted.density_g_cm3[oak] < weighted.density_g_cm3[steel] < STEEL
    for kind in (GaussianProperty, GaussianPropertyParts):
        assert learned[kind].predict(sample(folder, kind)).density_sd_g_cm3 is None


@pytest.mark.parametrize("kind", MOSTLY_ONE)
def test_the_order_of_views_and_of_parts_changes_nothing(
    folder: DatasetFolder, learned: dict[type, Any], kind: type
) -> None:
    plain = learned[kind].predict(sample(folder, kind))
    turned = sample(folder, kind, change=lambda pictures: pictures.take([3, 1, 5, 0, 4, 2]))
    np.testing.assert_array_equal(plain.density_g_cm3, learned[kind].predict(turned).density_g_cm3)
    parts = learned[kind].predict(sample(folder, kind, "hammer-0004")).density_g_cm3
    expected = plain.density_g_cm3
    if kind is GaussianPropertyParts:
        expected = expected[[0, 3, 1, 2]]
    np.testing.assert_array_equal(expected, parts)


def test_twice_the_size_is_eight_times_the_mass(
    folder: DatasetFolder, learned: dict[type, Any]
) -> None:
    for kind in ALL:
        one = learned[kind].predict(sample(folder, kind))
        other = learned[kind].predict(sample(folder, kind, "hammer-0005"))
        assert other.mass_native_g == pytest.approx(8 * one.mass_native_g, rel=1e-3)


def test_other_colours_give_other_densities(
    folder: DatasetFolder, learned: dict[type, Any]
) -> None:
    def grey(pictures: Pictures) -> Pictures:
        light = pictures.colors.max(axis=-1, keepdims=True)
        colors = np.where(pictures.masks[..., None], light, pictures.colors)
        return replace(pictures, colors=np.repeat(colors[..., :1], 3, axis=-1))

    predictor = learned[GaussianProperty]
    plain, painted_grey = (predictor.predict(sample(folder, change=one)) for one in (None, grey))
    # the oaken handle, 3 of 5.3 cm³, is taken for steel
    assert painted_grey.mass_native_g > 2 * plain.mass_native_g


@pytest.mark.parametrize("missing", [Modality.RGB, Modality.GEOMETRY])
def test_what_is_not_declared_is_refused(
    folder: DatasetFolder, learned: dict[type, Any], missing: Modality
) -> None:
    reads = GaussianProperty.reads & ~missing
    with pytest.raises(ModalityError, match=f"needs the modality {missing.name}"):
        learned[GaussianProperty].predict(SampleView(folder, "hammer-0003", reads, Changed()))


@pytest.mark.parametrize("kind", [GaussianProperty, GaussianPropertyParts])
def test_an_object_on_no_picture_is_an_error(
    folder: DatasetFolder, learned: dict[type, Any], kind: type
) -> None:
    def empty(pictures: Pictures) -> Pictures:
        nothing = np.zeros_like(pictures.masks)
        far = np.full_like(pictures.distance_cm, np.inf)
        return replace(pictures, masks=nothing, distance_cm=far)

    with pytest.raises(DataError, match="hammer-0003: no view shows any of its"):
        learned[kind].predict(sample(folder, kind, change=empty))


@pytest.mark.parametrize("kind", MOSTLY_ONE)
def test_a_fit_that_was_kept_predicts_the_same_to_the_bit(
    folder: DatasetFolder, learned: dict[type, Any], kind: type, tmp_path: Path
) -> None:
    learned[kind].save(tmp_path)
    other = kind()
    other.load(tmp_path)
    one, two = (each.predict(sample(folder, kind)) for each in (learned[kind], other))
    np.testing.assert_array_equal(one.density_g_cm3, two.density_g_cm3)
    assert fitted(folder, kind).predict(sample(folder, kind)).mass_native_g == one.mass_native_g


@pytest.mark.parametrize(
    "change",
    [
        lambda values: values.pop("names"),
        lambda values: values.update(materials=[0]),
        lambda values: values.update(spread="wide"),
        lambda values: values.update(sizes=[]),
    ],
)
def test_a_folder_without_a_fit_is_refused(
    learned: dict[type, Any], tmp_path: Path, change: Callable[[dict], Any]
) -> None:
    with pytest.raises(DataError, match=r"materials\.json: no fit of such a method"):
        GaussianProperty().load(tmp_path)
    learned[GaussianProperty].save(tmp_path)
    file = tmp_path / "materials.json"
    values = json.loads(file.read_text())
    change(values)
    file.write_text(json.dumps(values))
    with pytest.raises(DataError, match=r"materials\.json: no fit of such a method"):
        GaussianProperty().load(tmp_path)


def test_apparent_densities_cannot_be_learned(folder: DatasetFolder) -> None:
    apparent = Examples(folder, "train", GaussianProperty.reads, "apparent_density", Changed())
    with pytest.raises(DataError, match="expected the target 'density', got 'apparent_density'"):
        GaussianProperty().fit(apparent, seed=0)


def chat(monkeypatch: pytest.MonkeyPatch, mode: str, cassette: Path, base_url: str) -> None:
    values = {"MODE": mode, "CASSETTE": str(cassette), "BASE_URL": base_url, "MODEL": "qwen"}
    for name, value in values.items():
        monkeypatch.setenv(f"XDEN_VLM_{name}", value)


def test_a_replay_gives_the_recorded_prediction_to_the_bit_and_a_miss_fails(
    folder: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cassette = tmp_path / "answers.jsonl"
    # the first region gets nothing sensible in four tries, all others are oak
    script = [*[Reply("hm")] * 4, Reply("a thing, wood oak, 0.9")]
    with stub_endpoint(script) as stub:
        chat(monkeypatch, "record", cassette, stub.base_url)
        recorder = fitted(folder)
        recorded = recorder.predict(sample(folder))
        recorder._model.close()
    assert recorder.external_data
    assert recorded.fallbacks == 1
    assert recorded.model.startswith("qwen at 127.0.0.1:")
    chat(monkeypatch, "replay", cassette, "")
    replayer = fitted(folder)
    replayed = replayer.predict(sample(folder))
    np.testing.assert_array_equal(recorded.density_g_cm3, replayed.density_g_cm3)
    assert replayed.fallbacks == 1
    assert replayed.model.startswith("qwen, replay:")
    assert replayer.notes.startswith("qwen, replay:")
    with pytest.raises(ChatError, match=r"hammer-0005: .*no answer of qwen to the prompt part-mat"):
        replayer.predict(sample(folder, object_id="hammer-0005", change=mirrored))


def mirrored(pictures: Pictures) -> Pictures:
    """Pictures that no cassette has: one pixel differs."""
    colors = pictures.colors.copy()
    colors[:, 0, 0] = 0
    return replace(pictures, colors=colors)


def test_other_recorded_answers_are_another_method(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fingerprints = {GaussianProperty().fingerprint}
    for text in ("a", "b"):
        cassette = tmp_path / text
        cassette.write_text(json.dumps({"key": "k", "text": text}) + "\n")
        chat(monkeypatch, "replay", cassette, "")
        fingerprints.add(GaussianProperty().fingerprint)
    chat(monkeypatch, "live", cassette, "http://127.0.0.1:1/v1")
    fingerprints.add(GaussianProperty().fingerprint)
    assert len(fingerprints) == 4


def test_what_is_asked_ahead_is_not_asked_again(
    folder: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with stub_endpoint([Reply("a thing, wood oak, 0.9")]) as stub:
        chat(monkeypatch, "record", tmp_path / "answers.jsonl", stub.base_url)
        monkeypatch.setenv("XDEN_VLM_IN_FLIGHT", "8")
        recorder = fitted(folder)
        recorder.ask_ahead(iter([sample(folder), sample(folder, object_id="hammer-0005")]))
        asked = len(stub.requests)
        found = recorder.predict(sample(folder))
        recorder._model.close()
    assert asked == len(stub.requests) >= found.answers > 0
    assert found.fallbacks == 0


def test_without_a_fallback_a_run_ends_where_no_answer_makes_sense(
    folder: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with stub_endpoint([Reply("hm")]) as stub:
        chat(monkeypatch, "record", tmp_path / "answers.jsonl", stub.base_url)
        monkeypatch.setenv("XDEN_VLM_FALLBACK", "none")
        method = fitted(folder)
        with pytest.raises(ChatError, match=r"hammer-0003: part-material/2: no answer of 4 made"):
            method.predict(sample(folder))
        method._model.close()
    assert "if it fails" not in method.notes
