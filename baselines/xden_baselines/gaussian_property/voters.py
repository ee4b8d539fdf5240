"""Who says what a region is made of: a classifier of looks, or a chat model that is shown tiles."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from xden1k.errors import DataError
from xden1k.values.materials import load_materials
from xden_baselines.chat.asking import RETRIES, ask, at_once, unanswered
from xden_baselines.chat.candidates import Picture
from xden_baselines.chat.endpoint import ChatModel
from xden_baselines.chat.request import ChatRequest, png
from xden_baselines.chat.wording import answer_lines, bare
from xden_baselines.gaussian_property.appearance import Centroids, looks
from xden_baselines.gaussian_property.library import ClosedList
from xden_baselines.gaussian_property.regions import Segmentation
from xden_baselines.gaussian_property.tiles import three_tiles

__all__ = ["Answer", "ChatVoter", "LooksVoter", "Voter", "parse_answer"]

_PROMPT = """The picture has three tiles. Left: an object. Middle: the same picture, with one part \
of the object under a red mask. Right: that part alone, enlarged.
Go step by step. First say in a few words what the part is. Then decide what it is made of: where \
it is several things, what most of it is. Last, find that material in this list, and take no other \
word for it: {names}.
A program reads your answer: give nothing but one line in this form, without brackets, the last \
figure from 0 to 1:
short caption of the part, material, how sure you are"""

_CONFIDENCE = re.compile(
    r"(?:confidence:?\s*)?[~\u2248]?\s*(\d+(?:\.\d+)?|\.\d+)\s*(%?)", re.IGNORECASE
)
_BRACKETED = re.compile(r"\s*\(([\d.]+\s*%?)\)$")
"""A confidence in brackets behind the material."""
_LABELLED = re.compile(r"(material|confidence)\s*:\s*(\S.*)", re.IGNORECASE)
"""A line of an answer that gives each of its fields one."""
_LABEL = re.compile(r"(main )?material\s*:\s*", re.IGNORECASE)
"""Before the material of a line that has all fields."""
_NOT = frozenset({"not", "no", "non", "neither", "nor", "without", "unknown", "except"})
"""Words of what is no name."""


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
    silent
        Whether nobody did: then it is no vote.
    """

    material: int
    confidence: float
    fallback: bool = False
    silent: bool = False


SILENCE = Answer(material=0, confidence=0.0, silent=True)
"""Of a region about which no answer made sense."""


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
        Who stands in; None = nobody does.
    retries
        Further questions after an answer that makes no sense.
    in_flight
        Regions asked about at the same time.
    may_be_silent
        Whether a region goes without a vote where no answer makes sense and nobody stands in, as
        in the original; else the run ends there.
    """

    model: ChatModel
    materials: ClosedList
    fallback: Voter | None
    retries: int = RETRIES
    in_flight: int = 1
    may_be_silent: bool = False

    @property
    def source(self) -> str:
        """The model, and who stands in for it."""
        other = f"; if it fails, {self.fallback.source}" if self.fallback else ""
        return f"{self.model.source}{other}"

    def vote(
        self, object_id: str, picture: Picture, segmentation: Segmentation
    ) -> tuple[Answer, ...]:
        """Answer for each region, from the first.

        Raises
        ------
        ChatError
            If no answer comes at all, or none makes sense where one is needed.
        """
        requests = self.requests(object_id, picture, segmentation)
        asked = at_once(self.ask, requests, self.in_flight)
        if self.fallback is None or None not in asked:
            return tuple(answer or SILENCE for answer in asked)
        others = self.fallback.vote(object_id, picture, segmentation)
        return tuple(
            answer or Answer(other.material, other.confidence, fallback=True)
            for answer, other in zip(asked, others, strict=True)
        )

    def requests(
        self, object_id: str, picture: Picture, segmentation: Segmentation
    ) -> Iterator[ChatRequest]:
        """Give what is asked about each region, from the first."""
        text = _PROMPT.format(names=", ".join(map(_spoken, self.materials.names)))
        for number in range(1, int(segmentation.max()) + 1):
            tiles = three_tiles(picture, segmentation == number)
            yield ChatRequest("part-material/2", object_id, text, (png(tiles),))

    def ask(self, request: ChatRequest) -> Answer | None:
        """Ask about a region; None if no answer makes sense, and one may be missing or substituted.

        Raises
        ------
        ChatError
            If no answer comes at all, or none makes sense where one is needed.
        """

        def read(text: str) -> Answer:
            return parse_answer(text, self.materials)

        answer = ask(self.model, request, read, retries=self.retries)
        if answer is None and self.fallback is None and not self.may_be_silent:
            raise unanswered(request, self.retries)
        return answer


def parse_answer(text: str, materials: ClosedList) -> Answer:
    """Read ``a wooden handle, with a hole, wood oak, 0.8``: from the right, captions hold commas.

    The line may stand amid others, in brackets or a code fence, after thoughts; or material and
    confidence have a line each, ``Material: wood oak``. The words of a name may come in another
    order or be a part of it (``stainless steel``: the first of the list that has both), and it may
    be one that the material library also knows it by. It may say more than the only name of the
    list in it (``stainless steel`` where there is but ``steel``); of two that hold one another the
    longer counts. ``not steel`` is none.

    Raises
    ------
    DataError
        If there is no such line or more than one, or the material is not of the list.

    Examples
    --------
    >>> parse_answer("(a blade, shiny, **Steel**, 90%)", ClosedList(("wood_oak", "steel"), (1, 1)))
    Answer(material=1, confidence=0.9, fallback=False, silent=False)
    """
    lines = [bare(line) for line in answer_lines(text)]
    found = [fields for line in (*lines, _joined(lines)) if (fields := _fields(line))]
    if len(found) != 1:
        raise DataError(
            f"expected one line 'caption, material, confidence', got {text.strip()[:60]!r}"
        )
    name, number, percent = found[0]
    confidence = float(number) / (100 if percent else 1)
    if confidence > 1:
        raise DataError(f"expected a confidence from 0 to 1, got {number}{percent}")
    return Answer(_place(bare(_LABEL.sub("", name)), materials), confidence)


def _joined(lines: Sequence[str]) -> str:
    """Give what lines of their own say of material and confidence in one; else nothing."""
    said = [found.groups() for line in lines if (found := _LABELLED.fullmatch(line))]
    labels = [label.lower() for label, _ in said]
    return f"a part, {said[0][1]}, {said[1][1]}" if labels == ["material", "confidence"] else ""


def _fields(line: str) -> tuple[str, str, str] | None:
    """Material, figure and percent sign of a line that answers."""
    even = _BRACKETED.sub(r", \1", line.replace(";", ","))
    fields = [field.strip() for field in even.rsplit(",", 2)]
    figure = _CONFIDENCE.fullmatch(fields[-1])
    return None if len(fields) < 3 or figure is None else (fields[1], figure[1], figure[2])


def _place(name: str, materials: ClosedList) -> int:
    """Index of a material, however its words are put; of several that have them, the commonest."""
    library = load_materials()
    label = "_".join(name.lower().split())
    known = library[label].name if label in library.labels else name
    names = [_words(one) for one in materials.names]
    for wanted in (_words(name), _words(known)):
        if wanted in names:
            return names.index(wanted)
    for place, words in enumerate(names):
        if wanted and wanted <= words:
            return place
    within = [words for words in names if words <= wanted]
    longest = [one for one in within if not any(one < other for other in within)]
    if len(longest) == 1 and not wanted & _NOT:
        return names.index(longest[0])
    raise DataError(
        f"expected a material of {[_spoken(one) for one in materials.names]}, got {name[:60]!r}"
    )


def _words(name: str) -> frozenset[str]:
    return frozenset(re.sub(r"[()/,]", " ", _spoken(name.lower())).split())


def _spoken(name: str) -> str:
    return " ".join(name.replace("_", " ").split())
