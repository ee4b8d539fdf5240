"""The methods ``nerf2physics-style`` and ``nerf2physics-style-thickness``.

After Zhai et al., Physical Property Understanding from Language-Embedded Feature Fields, CVPR
2024, with the given mesh in place of a NeRF.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from xden1k.errors import DataError
from xden1k.predictor import Examples, Prediction, SampleView
from xden1k.values.modality import Modality
from xden_baselines.chat.asking import at_once
from xden_baselines.chat.candidates import Candidate, MaterialProposer, Picture
from xden_baselines.chat.prior import PriorProposer
from xden_baselines.chat.proposer import ChatProposer
from xden_baselines.chat.settings import chat_settings, open_chat
from xden_baselines.chat.zero_shot import (
    is_zero_shot,
    lacking,
    zero_shot_chat,
    zero_shot_name,
)
from xden_baselines.features.encoder import PatchEncoder, cosines
from xden_baselines.features.fitted import FittedEncoder, fit_encoder
from xden_baselines.features.fusion import fused_features
from xden_baselines.features.settings import (
    HOW_TO_NAME_CLIP,
    clip_folder,
    clip_sha256,
    clip_source,
    open_clip,
)
from xden_baselines.materials import check_target
from xden_baselines.nerf2physics.kernel import mixture
from xden_baselines.nerf2physics.prior import Proposals, tabulate
from xden_baselines.nerf2physics.surface import SurfaceCloud, surface_cloud
from xden_baselines.nerf2physics.volume import Rule, carved_mass_g, density_field, shell_mass_g
from xden_baselines.views.pictures import Pictures

__all__ = ["NeRF2Physics", "NeRF2PhysicsThickness", "described"]

PRIOR_FILE, SEED_FILE = "proposals.json", "seed.txt"
CAPTION_QUANTILE = 0.75
"""Of the mask areas, at the view that is described."""
ZERO_SHOT_RETRIES = 10
"""As often as the original asks again."""


class NeRF2Physics:
    """NeRF2Physics style, every object solid: patch features against candidate materials.

    Without CLIP's weights the encoder is fitted on the training split; without a chat model the
    candidates are the training split's, by category. Its row says so.

    Parameters
    ----------
    clip
        Folder with CLIP's weights; by default that of ``XDEN_CLIP``, empty if none.
    device
        Where CLIP runs, as torch names it: ``cpu``, ``cuda``. Nothing else has a use for one.
    zero_shot
        Whether it runs as the original does: with CLIP and a chat model, which captions a picture
        in place of the category; nothing is learned, and nobody answers in the model's place.

    Raises
    ------
    DataError
        If zero-shot lacks CLIP's weights or a chat model, or a device is named without weights.
    """

    name = "nerf2physics-style"
    version = "2"
    reads = Modality.GEOMETRY | Modality.RGB | Modality.CATEGORY
    trainable = True
    rule: Rule = "solid"
    _seed, _notes = 0, ""

    def __init__(
        self, *, clip: str | None = None, device: str = "cpu", zero_shot: bool = False
    ) -> None:
        self._clip, self._device = clip_folder(clip), device
        if device != "cpu" and not self._clip:
            raise DataError(f"{self.name}: CLIP alone runs on {device!r}: {HOW_TO_NAME_CLIP}")
        self._chat = chat_settings()
        if is_zero_shot(zero_shot):
            self._chat = zero_shot_chat(self.name, self._chat)
            if not self._clip:
                raise DataError(f"{self.name}: zero_shot needs CLIP: {HOW_TO_NAME_CLIP}")
            self.name = zero_shot_name(self.name)
            self.reads = self.reads & ~Modality.CATEGORY
            self.trainable = False
        self.external_data = bool(self._clip) or self._chat.mode != "off"

    @property
    def notes(self) -> str:
        """Which encoder saw the pictures, who proposed, the volume rule; what the original has."""
        how = self._notes
        if not self.trainable:
            sources = f"{clip_source(self._clip)}; {self._chat.source}"
            how = f"zero-shot; {sources}; volume rule {self.rule}"
        return f"{how}; {self._lacking}" if how else ""

    @property
    def _lacking(self) -> str:
        parts = {
            "its NeRF (the mesh is given)": True,
            "CLIP": not self._clip,
            "its chat model and captions": self._chat.mode == "off",
        }
        return lacking("NeRF2Physics", parts)

    @property
    def fingerprint(self) -> str:
        """The chat model's settings or recorded answers, the weights, and where they run."""
        said = [self._chat.fingerprint, clip_sha256(self._clip), self._device]
        return " ".join(filter(None, said))

    def fit(self, train: Examples, *, seed: int) -> None:
        """Survey the materials of the training split and, without CLIP, fit the encoder to it.

        Raises
        ------
        DataError
            If targets are no true densities, or no picture shows a part of known material.
        """
        prior = tabulate(PriorProposer(train), (example.sample.category for example in train))
        self._take_up(seed, prior, None if self._clip else fit_encoder(train, seed=seed))

    def save(self, folder: Path) -> None:
        """Write the encoder, the training split's proposals and the seed."""
        self._prior.save(folder / PRIOR_FILE)
        (folder / SEED_FILE).write_text(f"{self._seed}\n", encoding="utf-8")
        if isinstance(self._encoder, FittedEncoder):
            self._encoder.save(folder)

    def load(self, folder: Path) -> None:
        """Take up what :meth:`save` wrote.

        Raises
        ------
        DataError
            If the folder does not hold it.
        """
        try:
            seed = int((folder / SEED_FILE).read_text(encoding="utf-8"))
        except (OSError, ValueError) as err:
            raise DataError(f"{folder / SEED_FILE}: no seed: {err}") from err
        encoder = None if self._clip else FittedEncoder.load(folder)
        self._take_up(seed, Proposals.load(folder / PRIOR_FILE), encoder)

    def predict(self, sample: SampleView) -> Prediction:
        """Mix the candidates' densities at the surface, and fill the object from there.

        Raises
        ------
        DataError
            If no view shows any of the surface, or targets are no true densities.
        ChatError
            If a chat model is asked and does not answer.
        """
        check_target(sample)
        pictures: Pictures = sample.pictures
        before = self._proposer.fallbacks
        candidates = self._proposer.propose(*self._question(sample))
        cloud, shares = self._seen(sample, pictures, candidates)
        field = density_field(
            cloud,
            shares,
            candidates,
            rule=self.rule,
            envelope=sample.envelope,
            origin_cm=sample.origin_cm,
            voxel_size_cm=sample.voxel_size_cm,
        )
        if self.rule == "solid":
            mass_g = carved_mass_g(field, sample.voxel_size_cm)
        else:
            volume_cm3 = float(sample.envelope.sum(dtype=np.float64)) * sample.voxel_size_cm**3
            mass_g = shell_mass_g(cloud, shares, candidates, volume_cm3=volume_cm3)
        fallbacks = self._proposer.fallbacks - before
        asked = int(self._chat.mode != "off")
        return Prediction(
            field,
            mass_native_g=mass_g,
            answers=asked,
            fallbacks=fallbacks,
            device=self._device if self._clip else "cpu",
        )

    def ask_ahead(self, samples: Iterator[SampleView]) -> None:
        """Have the chat model's answers about all samples recorded, many at the same time."""
        if self._chat.mode == "record" and self._chat.in_flight > 1:
            propose, questions = self._proposer.propose, map(self._question, samples)
            at_once(lambda asked: propose(*asked), questions, self._chat.in_flight)

    def _question(self, sample: SampleView) -> tuple[str, str, Picture]:
        """Return what is told of an object; no category where the model is to say what it is."""
        known = Modality.CATEGORY in self.reads
        return sample.object_id, sample.category if known else "", described(sample.pictures)

    def _seen(
        self, sample: SampleView, pictures: Pictures, candidates: Sequence[Candidate]
    ) -> tuple[SurfaceCloud, Float[np.ndarray, "points materials"]]:
        """Surface points that a view shows, and how much of each candidate they are."""
        cloud = surface_cloud(sample.outer_mesh, seed=self._seed)
        features, views = fused_features(
            cloud.points_cm, pictures, self._encoder, tolerance_cm=cloud.cell_cm
        )
        seen = views > 0
        if not seen.any():
            raise DataError(f"{sample.object_id}: no view shows a point with its whole patch")
        texts = self._encoder.texts([one.name for one in candidates])
        return cloud.take(seen), mixture(cosines(features[seen], texts))

    def _take_up(self, seed: int, prior: Proposals, fitted: FittedEncoder | None) -> None:
        self._seed, self._prior = seed, prior
        chat = open_chat(self._chat)
        other = prior if self._chat.fallback == "train" else None
        self._proposer = prior if chat is None else ChatProposer(chat, other)
        self._encoder = fitted or open_clip(self._clip, self._device)
        sources = f"{self._encoder.source}; {self._proposer.source}"
        self._notes = f"{sources}; volume rule {self.rule}"

    @cached_property
    def _proposer(self) -> MaterialProposer:
        """The chat model alone, unless something was learned: zero-shot."""
        chat = open_chat(self._chat)
        assert chat is not None
        return ChatProposer(chat, None, form="caption", retries=ZERO_SHOT_RETRIES)

    @cached_property
    def _encoder(self) -> PatchEncoder:
        """CLIP, unless an encoder was fitted."""
        return open_clip(self._clip, self._device)


class NeRF2PhysicsThickness(NeRF2Physics):
    """NeRF2Physics style, every object a shell: only the candidates' thickness is filled."""

    name = "nerf2physics-style-thickness"
    rule: Rule = "thickness"


def described(pictures: Pictures) -> Picture:
    """Return the view that is described: the one at the 75th percentile of mask area."""
    areas = pictures.masks.sum(axis=(1, 2))
    order = np.argsort(areas, kind="stable")
    view: int = order[int(CAPTION_QUANTILE * len(order))]
    return np.asarray(pictures.colors[view])
