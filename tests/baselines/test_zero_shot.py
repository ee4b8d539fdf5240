"""Zero-shot mode: outside models alone, nothing from the training split, nobody who stands in."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.baselines.chat_stub import Reply, Stub, stub_endpoint
from tests.baselines.painted import BROWN, GREY, painted
from tests.phantoms import Box
from xden1k.errors import DataError, XDenError
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.predictions import open_predictions
from xden1k.predictor import Predictor, SampleView
from xden1k.values.modality import Modality
from xden1k.values.types import DensityObject
from xden_baselines.chat.zero_shot import is_zero_shot
from xden_baselines.gaussian_property.predictor import GaussianProperty, GaussianPropertyWeighted
from xden_baselines.nerf2physics import predictor as nerf2physics
from xden_baselines.nerf2physics.predictor import NeRF2Physics, NeRF2PhysicsThickness
from xden_baselines.views.cameras import Rig
from xden_baselines.views.source import RenderedPhantoms
from xden_bench.methods.running import Options, run_predictor

RENDERED = RenderedPhantoms(Rig(elevations_deg=(-30.0, 30.0), per_ring=2, size_px=96))
DENSITIES = "(steel: 7800-7900 kg/m^3);(oak wood: 600-800 kg/m^3)"
THICKNESSES = "(oak wood: 1-2 cm);(steel: 0.5-1 cm)"


class Looking:
    """Stands for CLIP: a grey patch is steel, a brown one wood."""

    source, width, stride_px = "CLIP of tests", 2, 4

    def patches(self, picture: np.ndarray, mask: np.ndarray, pixels: np.ndarray) -> np.ndarray:
        red, _, blue = picture[pixels[:, 0], pixels[:, 1]].astype(np.float32).T
        brown = red > 1.5 * blue
        return np.stack([~brown, brown], axis=1).astype(np.float32)

    def texts(self, names: Sequence[str]) -> np.ndarray:
        return np.array([["steel" in name, "wood" in name] for name in names], dtype=np.float32)


def mallet(object_id: str, category: str, split: str) -> DensityObject:
    boxes = (
        Box("handle", (0, 0, 0), (1, 1, 3), 0.7, material="wood_oak"),
        Box("head", (-0.5, 0, 3), (1.8, 1, 4), 7.8, material="steel"),
    )
    colors = {"handle": BROWN, "head": GREY}
    return painted(object_id, boxes, colors, split=split, category=category)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> DatasetFolder:
    """A dataset without a training split: there is nothing to learn from."""
    root = tmp_path_factory.mktemp("zero_shot") / "dataset"
    objects = [mallet("mallet-0001", "mallet", "test"), mallet("mallet-0002", "kettle", "val")]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return open_folder(root)


@pytest.fixture(autouse=True)
def _clip(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDEN_CLIP", str(tmp_path))
    monkeypatch.setattr(nerf2physics, "open_clip", lambda *_: Looking())
    monkeypatch.setattr(nerf2physics, "clip_sha256", lambda folder: "0")
    monkeypatch.setattr(nerf2physics, "clip_source", lambda folder: Looking.source)


def answered(request: dict[str, Any]) -> Reply:
    """What a good model says."""
    *before, last = request["messages"]
    text = last["content"][0]["text"]
    if "three tiles" in text:
        return Reply("a part, steel, 0.9")
    if "Describe the object" in text:
        return Reply("A mallet with a wooden handle and a metal head.")
    return Reply(THICKNESSES if len(before) > 1 else DENSITIES)


def chat(monkeypatch: pytest.MonkeyPatch, mode: str, cassette: Path, base_url: str = "") -> None:
    values = {"MODE": mode, "CASSETTE": str(cassette), "BASE_URL": base_url, "MODEL": "qwen"}
    for name, value in values.items():
        monkeypatch.setenv(f"XDEN_VLM_{name}", value)


def run(predictor: Predictor, folder: DatasetFolder, out: Path, split: str = "test") -> np.ndarray:
    """The density of the only object of a split."""
    run_predictor(predictor, folder, split, out, Options(pictures=RENDERED))
    with open_predictions(out) as found:
        (object_id,) = found.ids
        return found.read(object_id)


def recorded(
    kind: type, folder: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[np.ndarray, Stub]:
    with stub_endpoint(answered) as stub:
        chat(monkeypatch, "record", tmp_path / "answers.jsonl", stub.base_url)
        predictor = kind(zero_shot=True)
        found = run(predictor, folder, tmp_path / "recorded.npz")
        del predictor  # and with it the cassette's lock
        return found, stub


@pytest.mark.parametrize(
    ("kind", "name", "reads"),
    [
        (NeRF2Physics, "nerf2physics-zero-shot", "mesh rgb"),
        (NeRF2PhysicsThickness, "nerf2physics-zero-shot-thickness", "mesh rgb"),
        (GaussianProperty, "gaussian-property-zero-shot", "mesh rgb"),
        (GaussianPropertyWeighted, "gaussian-property-zero-shot-weighted", "mesh rgb"),
    ],
)
def test_it_has_a_name_of_its_own_learns_nothing_and_is_told_no_category(
    kind: type, name: str, reads: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chat(monkeypatch, "live", tmp_path / "answers.jsonl", "http://127.0.0.1:1/v1")
    predictor = kind(zero_shot=True)
    assert predictor.name == name
    assert predictor.reads == Modality.GEOMETRY | Modality.RGB
    assert " ".join(predictor.reads.inputs) == reads
    assert (predictor.trainable, predictor.external_data) == (False, True)
    assert "fallback none" in predictor.fingerprint


def test_looking_at_a_method_does_not_keep_others_from_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A run loads its method in two processes, and only one records."""
    chat(monkeypatch, "record", tmp_path / "answers.jsonl", "http://127.0.0.1:1/v1")
    for kind in (NeRF2Physics, GaussianProperty):
        predictor = kind(zero_shot=True)
        assert isinstance(predictor, Predictor)
        assert predictor.notes.startswith("zero-shot; ")
        assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "kind", [NeRF2Physics, pytest.param(GaussianProperty, marks=pytest.mark.slow)]
)
def test_a_recorded_run_replays_offline_to_the_bit(
    kind: type, folder: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, _ = recorded(kind, folder, tmp_path, monkeypatch)
    chat(monkeypatch, "replay", tmp_path / "answers.jsonl")
    again = run(kind(zero_shot=True), folder, tmp_path / "replayed.npz")
    assert again.tobytes() == first.tobytes()
    with open_predictions(tmp_path / "replayed.npz") as found:
        meta = found.meta
    assert meta.method == zero_shot(kind)
    assert meta.training_data == ()
    assert meta.external_data
    assert "zero-shot; " in meta.notes
    assert "qwen, replay:" in meta.notes
    assert "fallback" not in meta.notes


def zero_shot(kind: Any) -> str:
    return kind.name.replace("-style", "-zero-shot")


@pytest.mark.slow
def test_the_models_own_caption_and_materials_decide(
    folder: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    density, stub = recorded(NeRF2Physics, folder, tmp_path, monkeypatch)
    assert len(stub.requests) == 3
    # what the category is called changes nothing: it is not asked about, and nothing new is
    chat(monkeypatch, "replay", tmp_path / "answers.jsonl")
    other = run(NeRF2Physics(zero_shot=True), folder, tmp_path / "other.npz", "val")
    assert other.tobytes() == density.tobytes()
    view = SampleView(folder, "mallet-0001", NeRF2Physics.reads, RENDERED)
    heights = view.origin_cm[2] + view.voxel_size_cm * np.arange(64)
    full = view.envelope == 1
    head, handle = heights > 3.3, heights < 2.7
    # softmax at 0.1: 7.85 and 0.7, each with e^-10 of the other
    assert np.median(density[:, :, head][full[:, :, head]]) == pytest.approx(7.85, abs=0.01)
    assert np.median(density[:, :, handle][full[:, :, handle]]) == pytest.approx(0.7, abs=0.01)


def test_the_closed_list_is_the_originals(
    folder: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found, stub = recorded(GaussianProperty, folder, tmp_path, monkeypatch)
    asked = stub.requests[0]["messages"][-1]["content"][0]["text"]
    assert "wood, aluminium, steel, copper, plastic" in asked
    assert found.max() == pytest.approx(7.9)  # of 7.75 to 8.05


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        (NeRF2Physics, "mallet-0001: caption/1: no answer of 11 made sense"),
        (GaussianProperty, "mallet-0001: no view shows any of its surface, or none got an answer"),
    ],
)
def test_a_model_that_refuses_ends_the_run_and_nobody_answers_in_its_place(
    kind: type,
    message: str,
    folder: DatasetFolder,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out = tmp_path / "refused.npz"
    monkeypatch.setenv("XDEN_VLM_FALLBACK", "train")
    with stub_endpoint([Reply("I'm sorry, but I can't help with that.")]) as stub:
        chat(monkeypatch, "live", tmp_path / "answers.jsonl", stub.base_url)
        with pytest.raises(XDenError, match=message):
            run(kind(zero_shot=True), folder, out)
    assert not out.exists()


def test_a_part_without_an_answer_has_no_vote_and_is_counted(
    folder: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The original writes down that there is none, and takes the answers of the other views."""
    first: list[str] = []

    def answer(request: dict[str, Any]) -> Reply:
        shown = request["messages"][-1]["content"][1]["image_url"]["url"]
        first[:] = first or [shown]
        return Reply("a part, rubber, 0.9" if shown == first[0] else "a part, steel, 0.9")

    with stub_endpoint(answer) as stub:
        chat(monkeypatch, "live", tmp_path / "answers.jsonl", stub.base_url)
        found = run(GaussianProperty(zero_shot=True), folder, tmp_path / "preds.npz")
    assert found.max() == pytest.approx(7.9)
    with open_predictions(tmp_path / "preds.npz") as submission:
        notes = submission.meta.notes
    regions = len(stub.requests) - 3  # one of them was asked about four times
    assert f"; 1 of {regions} answers missing, on 1 objects" in notes
    assert "fallback" not in notes


def test_what_it_cannot_do_without_is_told_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for kind in (NeRF2Physics, GaussianProperty):
        with pytest.raises(DataError, match="zero_shot asks a chat model: set XDEN_VLM_MODE"):
            kind(zero_shot=True)
    with pytest.raises(DataError, match="zero_shot must be true or false, got 'yes'"):
        is_zero_shot("yes")
    chat(monkeypatch, "live", tmp_path / "answers.jsonl", "http://127.0.0.1:1/v1")
    with pytest.raises(
        DataError, match=r"zero_shot needs CLIP: name the folder of its weights by X"
    ):
        NeRF2Physics(clip="", zero_shot=True)


def test_apparent_densities_are_no_target_of_it(
    folder: DatasetFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    chat(monkeypatch, "live", tmp_path / "answers.jsonl", "http://127.0.0.1:1/v1")
    for kind in (NeRF2Physics, GaussianProperty):
        predictor = kind(zero_shot=True)
        sample = SampleView(folder, "mallet-0001", predictor.reads, RENDERED, "apparent_density")
        with pytest.raises(XDenError, match="expected the target 'density'"):
            predictor.predict(sample)
