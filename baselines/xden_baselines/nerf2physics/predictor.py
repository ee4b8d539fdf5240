"""The methods ``nerf2physics`` and ``nerf2physics-thickness``.

After Zhai et al., Physical Property Understanding from Language-Embedded Feature Fields, CVPR
2024, with the given mesh in place of a NeRF.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from xden1k.errors import DataError
from xden1k.modality import Modality
from xden1k.predictor import Examples, Prediction, SampleView
from xden_baselines.chat.candidates import MaterialProposer, Picture
from xden_baselines.chat.prior import PriorProposer
from xden_baselines.chat.proposer import ChatProposer
from xden_baselines.chat.settings import chat_settings, open_chat
from xden_baselines.features.encoder import PatchEncoder, cosines
from xden_baselines.features.fitted import fit_encoder
from xden_baselines.features.fusion import fused_features
from xden_baselines.nerf2physics.kernel import mixture
from xden_baselines.nerf2physics.surface import surface_cloud
from xden_baselines.nerf2physics.volume import Rule, carved_mass_g, density_field, shell_mass_g
from xden_baselines.views.pictures import Pictures

__all__ = ["NeRF2Physics", "NeRF2PhysicsThickness"]

CLIP_VARIABLE = "XDEN_CLIP"
"""Environment variable that names a folder with CLIP's weights."""
CAPTION_QUANTILE = 0.75
"""Of the mask areas, at the view that is described."""


class NeRF2Physics:
    """NeRF2Physics style, every object solid: patch features against candidate materials.

    Without CLIP's weights the encoder is fitted on the training split; without a chat model the
    candidates are the training split's, by category. Its row says so.

    Parameters
    ----------
    clip
        Folder with CLIP's weights; by default that of ``XDEN_CLIP``, empty if none.
    """

    name = "nerf2physics"
    version = "1"
    reads = Modality.GEOMETRY | Modality.RGB | Modality.CATEGORY
    trainable = True
    rule: Rule = "solid"

    def __init__(self, *, clip: str | None = None) -> None:
        self._clip = os.environ.get(CLIP_VARIABLE, "") if clip is None else clip
        self._chat = chat_settings()
        self.external_data = bool(self._clip) or self._chat.mode != "off"

    @property
    def notes(self) -> str:
        """What saw and what proposed."""
        return f"{self._encoder.source}; {self._proposer.source}; volume rule {self.rule}"

    def fit(self, train: Examples, *, seed: int) -> None:
        """Survey the materials of the training split and, without CLIP, fit the encoder to it."""
        self._seed = seed
        prior, chat = PriorProposer(train), open_chat(self._chat)
        self._proposer: MaterialProposer = prior if chat is None else ChatProposer(chat, prior)
        self._encoder: PatchEncoder = (
            _clip(Path(self._clip)) if self._clip else fit_encoder(train, seed=seed)
        )

    def predict(self, sample: SampleView) -> Prediction:
        """Mix the candidates' densities at the surface, and fill the object from there.

        Raises
        ------
        DataError
            If no view shows any of the surface.
        """
        pictures: Pictures = sample.pictures
        before = self._proposer.fallbacks
        candidates = self._proposer.propose(sample.object_id, sample.category, described(pictures))
        cloud = surface_cloud(sample.outer_mesh, seed=self._seed)
        features, views = fused_features(
            cloud.points_cm, pictures, self._encoder, tolerance_cm=cloud.cell_cm
        )
        if not views.any():
            raise DataError(f"{sample.object_id}: no view shows a point with its whole patch")
        seen, texts = views > 0, self._encoder.texts([one.name for one in candidates])
        cloud, shares = cloud.take(seen), mixture(cosines(features[seen], texts))
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
            volume = float(sample.envelope.sum(dtype=np.float64)) * sample.voxel_size_cm**3
            mass_g = shell_mass_g(cloud, shares, candidates, volume_cm3=volume)
        return Prediction(
            field,
            mass_native_g=mass_g,
            fallbacks=self._proposer.fallbacks - before,
        )


class NeRF2PhysicsThickness(NeRF2Physics):
    """NeRF2Physics style, every object a shell: only the candidates' thickness is filled."""

    name = "nerf2physics-thickness"
    rule: Rule = "thickness"


def described(pictures: Pictures) -> Picture:
    """Return the view that is described: the one at the 75th percentile of mask area."""
    areas = pictures.masks.sum(axis=(1, 2))
    order = np.argsort(areas, kind="stable")
    view: int = order[round(CAPTION_QUANTILE * (len(order) - 1))]
    return np.asarray(pictures.colors[view])


def _clip(folder: Path) -> PatchEncoder:
    from xden_baselines.features.clip import ClipEncoder

    return ClipEncoder(folder)
