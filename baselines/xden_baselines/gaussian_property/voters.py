"""Who says what a region is made of: a classifier of looks, or a chat model that is shown tiles."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from xden1k.errors import DataError
from xden_baselines.chat.asking import RETRIES, ask
from xden_baselines.chat.candidates import Picture
from xden_baselines.chat.endpoint import ChatModel
from xden_baselines.chat.request import ChatRequest, png
from xden_baselines.gaussian_property.appearance import Centroids, looks
from xden_baselines.gaussian_property.library import ClosedList
from xden_baselines.gaussian_property.regions import Segmentation
from xden_baselines.gaussian_property.tiles import three_tiles

__all__ = ["Answer", "ChatVoter", "LooksVoter", "Voter", "parse_answer"]

_PROMPT = """The picture has three tiles. Left: an object. Middle: the same picture with one part \
of the object painted red. Right: that part alone, enlarged.
Step by step, decide what the part is, and which one material of this list it mainly consists of: \
{names}.
Answer with nothing but one line in this form, the last figure from 0 to 1:
short caption of the part, material, how sure you are"""


@dataclass(frozen=True, slots=True)
class Answer:
    """What one region of one view is made of.

    Parameters
    ----------
    material
        Index into the closed list.
    confidence
        From 0 to 1.
    fallback
        Whether a substitute answered.
    """

    material: int
    confidence: float
    fallback: bool = False


@runtime_checkable
class Voter(Protocol):
    """Says what the regions of a picture are made of."""

    @property
    def source(self) -> str:
        """Who it is, as a row says it."""
        ...

    def vote(
        self, object_id: str, picture: Picture, segmentation: Segmentation
    ) -> tuple[Answer, ...]:
        """Answer for each region, from the first."""
        ...


@dataclass(frozen=True, slots=True)
class LooksVoter:
    """Takes the training material that most likely looks like that.

    Parameters
    ----------
    centroids
        What was learned.
    """

    centroids: Centroids

    source = "classifier of colours fitted on the training split"

    def vote(
        self, object_id: str, picture: Picture, segmentation: Segmentation
    ) -> tuple[Answer, ...]:
        """Answer for each region, from the first."""
        chosen, confidence = self.centroids.classify(looks(picture, segmentation))
        return tuple(map(Answer, chosen.tolist(), confidence.tolist()))


@dataclass(frozen=True, slots=True)
class ChatVoter:
    """Asks a chat model about each region; where no answer makes sense, another voter stands in.

    Parameters
    ----------
    model
        Who is asked.
    materials
        What it may choose from.
    fallback
        Who stands in.
    retries
        Further questions after an answer that makes no sense.
    """

    model: ChatModel
    materials: ClosedList
    fallback: Voter
    retries: int = RETRIES

    @property
    def source(self) -> str:
        """The model, and who stands in for it."""
        return f"{self.model.source}; if it fails, {self.fallback.source}"

    def vote(
        self, object_id: str, picture: Picture, segmentation: Segmentation
    ) -> tuple[Answer, ...]:
        """Answer for each region, from the first.

        Raises
        ------
        ChatError
            If no answer comes at all.
        """
        others = self.fallback.vote(object_id, picture, segmentation)
        asked = (
            self._ask(object_id, three_tiles(picture, segmentation == number))
            for number in range(1, len(others) + 1)
        )
        return tuple(
            answer or Answer(other.material, other.confidence, fallback=True)
            for answer, other in zip(asked, others, strict=True)
        )

    def _ask(self, object_id: str, tiles: Picture) -> Answer | None:
        text = _PROMPT.format(names=", ".join(map(_spoken, self.materials.names)))
        request = ChatRequest("part-material/1", object_id, text, (png(tiles),))
        return ask(
            self.model,
            request,
            lambda line: parse_answer(line, self.materials),
            retries=self.retries,
        )


def parse_answer(text: str, materials: ClosedList) -> Answer:
    """Read ``a wooden handle, with a hole, wood oak, 0.8``: from the right, captions hold commas.

    Raises
    ------
    DataError
        If it is no such line, or the material is not of the list.

    Examples
    --------
    >>> parse_answer("a blade, shiny, Steel, 90%", ClosedList(("wood_oak", "steel"), (1, 1)))
    Answer(material=1, confidence=0.9, fallback=False)
    """
    fields = [field.strip() for field in text.strip().rsplit(",", 2)]
    found = re.fullmatch(r"(\d+(?:\.\d*)?|\.\d+)\s*(%?)\.?", fields[-1])
    if len(fields) < 3 or "\n" in text.strip() or found is None:
        raise DataError(f"expected 'caption, material, confidence', got {text.strip()[:60]!r}")
    confidence = float(found[1]) / (100 if found[2] else 1)
    if confidence > 1:
        raise DataError(f"expected a confidence from 0 to 1, got {fields[-1]!r}")
    names = [_spoken(name) for name in materials.names]
    name = _spoken(fields[1].lower())
    if name not in names:
        raise DataError(f"expected a material of {names}, got {fields[1][:60]!r}")
    return Answer(names.index(name), confidence)


def _spoken(name: str) -> str:
    return " ".join(name.replace("_", " ").split())
