"""The methods ``gaussian-property-style``, ``-weighted`` and ``-parts``.

After Xu et al., GaussianProperty: Integrating Physical Properties to 3D Gaussians with LMMs,
arXiv:2412.11258: its text, for the published code lifts nothing to 3D. The given geometry stands
in for the reconstruction, :mod:`.regions` for Segment Anything, and for GPT-4V the chat model that
is configured, or else a classifier fitted on the training split.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np

from xden1k.errors import DataError
from xden1k.predictor import Examples, Prediction, SampleView
from xden1k.values.arrays import Grid
from xden1k.values.modality import Modality
from xden_baselines.chat.asking import at_once
from xden_baselines.chat.endpoint import ChatModel
from xden_baselines.chat.request import ChatRequest
from xden_baselines.chat.settings import chat_settings, open_chat
from xden_baselines.chat.zero_shot import (
    is_zero_shot,
    lacking,
    zero_shot_chat,
    zero_shot_name,
)
from xden_baselines.gaussian_property.appearance import Centroids, fit_centroids
from xden_baselines.gaussian_property.library import ClosedList, closed_list, published_list
from xden_baselines.gaussian_property.lifting import (
    Judged,
    chosen_views,
    judge,
    vote_of_parts,
    vote_of_points,
    with_hidden,
)
from xden_baselines.gaussian_property.regions import (
    Segmentation,
    color_regions,
    kept_regions,
    part_numbers,
)
from xden_baselines.gaussian_property.voters import ChatVoter, LooksVoter, Voter
from xden_baselines.gaussian_property.voting import (
    Ballots,
    expected_density_g_cm3,
    middle_density_g_cm3,
    winners,
)
from xden_baselines.geometry import SKIN, near_surface, nearest_filled, voxel_centres_cm
from xden_baselines.materials import check_target
from xden_baselines.views.pictures import Pictures

__all__ = ["GaussianProperty", "GaussianPropertyParts", "GaussianPropertyWeighted"]

FILE = "materials.json"


class _Voting(ABC):
    """What the three have in common: a closed list, centroids of looks, and who answers.

    Parameters
    ----------
    zero_shot
        Whether it runs as the original does: a chat model chooses from the original's own list;
        nothing is learned, and nobody answers in the model's place: a region without an answer that
        makes sense has no vote.

    Raises
    ------
    DataError
        If zero-shot lacks a chat model.
    """

    name: str
    version = "2"
    trainable = True
    masks: str
    _notes = ""

    def __init__(self, *, zero_shot: bool = False) -> None:
        self._chat = chat_settings()
        if is_zero_shot(zero_shot):
            self._chat = zero_shot_chat(self.name, self._chat)
            self.name = zero_shot_name(self.name)
            self.trainable = False
        self.external_data = self._chat.mode != "off"

    @property
    def notes(self) -> str:
        """Who answers, about what, from how long a list; what the original has and this lacks."""
        how = self._notes
        if not self.trainable:
            list_of = f"the {len(self._materials)} materials of the original's paper"
            how = f"zero-shot; {self._chat.source}; {self.masks}; {list_of}"
        return f"{how}; {self._lacking}" if how else ""

    @property
    def _lacking(self) -> str:
        parts = {
            "3D Gaussians (the mesh is given)": True,
            "Segment Anything": True,
            "its vision model": self._chat.mode == "off",
        }
        return lacking("GaussianProperty", parts)

    @property
    def fingerprint(self) -> str:
        """The chat model's settings, or its recorded answers."""
        return self._chat.fingerprint

    def fit(self, train: Examples, *, seed: int) -> None:
        """List the materials of the training split, and learn what they look like.

        Raises
        ------
        DataError
            If targets are no true densities, or no picture shows a part of known material.
        """
        materials = closed_list(train)
        self._take_up(materials, fit_centroids(train, materials, seed=seed))

    def save(self, folder: Path) -> None:
        """Write the list of materials and the centroids."""
        centroids = self._centroids
        values = {
            "names": self._materials.names,
            "objects": self._materials.objects,
            "places": centroids.places.tolist(),
            "materials": centroids.materials.tolist(),
            "sizes": centroids.sizes.tolist(),
            "deviation": centroids.deviation.tolist(),
            "spread": centroids.spread,
        }
        (folder / FILE).write_text(json.dumps(values, indent=1) + "\n", encoding="utf-8")

    def load(self, folder: Path) -> None:
        """Take up what :meth:`save` wrote.

        Raises
        ------
        DataError
            If the folder does not hold it.
        """
        try:
            values = json.loads((folder / FILE).read_text(encoding="utf-8"))
            materials = ClosedList(tuple(values["names"]), tuple(values["objects"]))
            centroids = Centroids(
                np.array(values["places"], dtype=np.float64),
                np.array(values["materials"], dtype=np.int64),
                np.array(values["sizes"], dtype=np.int64),
                np.array(values["deviation"], dtype=np.float64),
                float(values["spread"]),
            )
        except (OSError, ValueError, TypeError, KeyError) as err:
            raise DataError(f"{folder / FILE}: no fit of such a method: {err}") from err
        self._take_up(materials, centroids)

    def _take_up(self, materials: ClosedList, centroids: Centroids) -> None:
        self._materials, self._centroids = materials, centroids
        own = LooksVoter(centroids)
        other = own if self._chat.fallback == "train" else None
        self._voter = self._chat_voter(self._model, other) if self._model else own
        self._notes = f"{self._voter.source}; {self.masks}; {len(materials)} materials"

    def _chat_voter(self, model: ChatModel, fallback: Voter | None) -> ChatVoter:
        return ChatVoter(
            model,
            self._materials,
            fallback,
            in_flight=self._chat.in_flight,
            may_be_silent=not self.trainable,
        )

    @cached_property
    def _materials(self) -> ClosedList:
        """The original's list, unless one was learned: zero-shot."""
        return published_list()

    @cached_property
    def _voter(self) -> Voter:
        """The chat model alone, unless a classifier was fitted: zero-shot."""
        assert self._model is not None
        return self._chat_voter(self._model, None)

    @cached_property
    def _model(self) -> ChatModel | None:
        return open_chat(self._chat)

    def ask_ahead(self, samples: Iterator[SampleView]) -> None:
        """Have the chat model's answers about all samples recorded, many at the same time."""
        voter, chat = self._voter, self._chat
        if isinstance(voter, ChatVoter) and chat.mode == "record" and chat.in_flight > 1:
            at_once(voter.ask, self._requests(voter, samples), chat.in_flight)

    def _requests(self, voter: ChatVoter, samples: Iterator[SampleView]) -> Iterator[ChatRequest]:
        for sample in samples:
            pictures, cuts = self._cut(sample)
            for view, cut in enumerate(cuts):
                yield from voter.requests(sample.object_id, pictures.colors[view], cut)

    @abstractmethod
    def _cut(self, sample: SampleView) -> tuple[Pictures, Sequence[Segmentation]]:
        """Return views of an object, and the regions of each that are asked about."""

    def _told(
        self, density: np.ndarray, mass_g: float, judged: Sequence[Judged], sd: Grid | None = None
    ) -> Prediction:
        return Prediction(
            density,
            sd,
            mass_native_g=mass_g,
            model=self._model.source if self._model else "",
            answers=sum(len(one.answers) for one in judged) if self._model else 0,
            fallbacks=sum(answer.fallback for one in judged for answer in one.answers),
            unanswered=sum(answer.silent for one in judged for answer in one.answers),
        )


class GaussianProperty(_Voting):
    """GaussianProperty style: a material for each colour region of ten views, then a vote in 3D.

    Without a chat model a classifier fitted on the training split answers. Its row says so.
    """

    name = "gaussian-property-style"
    reads = Modality.GEOMETRY | Modality.RGB
    masks = "colour regions for masks"
    weighted = False

    def predict(self, sample: SampleView) -> Prediction:
        """Let the views vote on the voxels at the surface; the others follow the nearest of them.

        Raises
        ------
        DataError
            If no view shows any of the object, or targets are no true densities.
        ChatError
            If a chat model is asked and does not answer.
        """
        check_target(sample)
        pictures, cuts = self._cut(sample)
        judged = judge(sample.object_id, pictures, cuts, self._voter)
        surface, ballots = self._ballots(sample, pictures, judged)
        mean, sd = self._filled(surface, ballots, sample.envelope)
        mass_g = float(mean.sum(dtype=np.float64)) * sample.voxel_size_cm**3
        return self._told(mean, mass_g, judged, sd if self.weighted else None)

    def _cut(self, sample: SampleView) -> tuple[Pictures, Sequence[Segmentation]]:
        pictures = chosen_views(sample.pictures)
        pairs = zip(pictures.colors, pictures.masks, strict=True)
        return pictures, [color_regions(*pair) for pair in pairs]

    def _ballots(
        self, sample: SampleView, pictures: Pictures, judged: Sequence[Judged]
    ) -> tuple[np.ndarray, Ballots]:
        """Voxels at the surface that got a vote, as a mask, and their votes in C order."""
        surface = near_surface(sample)
        ballots = vote_of_points(
            voxel_centres_cm(sample, surface),
            pictures,
            judged,
            self._materials,
            tolerance_cm=SKIN * sample.voxel_size_cm,
            weighted=self.weighted,
        )
        voted = ballots.any(axis=1)
        if not voted.any():
            raise DataError(
                f"{sample.object_id}: no view shows any of its surface, or none got an answer"
            )
        surface[surface] = voted
        return surface, ballots[voted]

    def _filled(self, surface: np.ndarray, ballots: Ballots, envelope: Grid) -> tuple[Grid, Grid]:
        """Density and its deviation, voxel means, each voxel after the nearest that voted."""
        if self.weighted:
            mean, sd = expected_density_g_cm3(ballots, self._materials)
        else:
            mean = middle_density_g_cm3(winners(ballots), self._materials)
            sd = np.zeros(len(mean))
        grids = np.zeros((2, *surface.shape), dtype=np.float32)
        grids[:, surface] = mean, sd
        density, deviation = nearest_filled(grids, surface) * envelope
        return density, deviation


class GaussianPropertyWeighted(GaussianProperty):
    """GaussianProperty style, votes weighted by confidence: mean and deviation of the counts."""

    name = "gaussian-property-style-weighted"
    weighted = True


class GaussianPropertyParts(_Voting):
    """GaussianProperty style with the true parts for masks: each takes the material voted for.

    A part that no view shows takes the material of the parts nearest to it.
    """

    name = "gaussian-property-style-parts"
    reads = Modality.GEOMETRY | Modality.RGB | Modality.PARTS
    masks = "true parts for masks"

    def predict(self, sample: SampleView) -> Prediction:
        """Let the views vote on the parts they show.

        Raises
        ------
        DataError
            If no view shows any of the object, or targets are no true densities.
        ChatError
            If a chat model is asked and does not answer.
        """
        check_target(sample)
        pictures, found = self._found(sample)
        meshes = sample.part_meshes
        judged = judge(sample.object_id, pictures, [cut for cut, _ in found], self._voter)
        shown = [kept.astype(np.int64) - 1 for _, kept in found]
        ballots = vote_of_parts(len(meshes), shown, judged, self._materials)
        if not ballots.any():
            raise DataError(
                f"{sample.object_id}: no view shows any of its parts, or none got an answer"
            )
        chosen = winners(with_hidden(ballots, meshes))
        density = middle_density_g_cm3(chosen, self._materials)
        mass_g = float(
            sum(value * mesh.volume for value, mesh in zip(density, meshes, strict=True))
        )
        return self._told(np.concatenate([[0.0], density]).astype(np.float32), mass_g, judged)

    def _cut(self, sample: SampleView) -> tuple[Pictures, Sequence[Segmentation]]:
        pictures, found = self._found(sample)
        return pictures, [cut for cut, _ in found]

    def _found(self, sample: SampleView) -> tuple[Pictures, list[tuple[Segmentation, np.ndarray]]]:
        """Return views of an object, the parts in each, and the number that each of these has."""
        pictures = chosen_views(sample.pictures)
        numbers = part_numbers(sample.part_meshes, pictures.cameras)
        return pictures, [
            kept_regions(number, mask & (number > 0))
            for number, mask in zip(numbers, pictures.masks, strict=True)
        ]
