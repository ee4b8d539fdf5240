"""Asking a chat model what an object consists of."""

from __future__ import annotations

from typing import Literal

from xden_baselines.chat.answers import paired, parse_densities, parse_json, parse_thicknesses
from xden_baselines.chat.asking import RETRIES, ask, unanswered
from xden_baselines.chat.candidates import Candidate, MaterialProposer, Picture
from xden_baselines.chat.endpoint import ChatModel
from xden_baselines.chat.request import ChatRequest, png

__all__ = ["ChatProposer"]

_SUBJECT = "The object is described as: {category}.{picture}"
_PICTURE = " A picture of it is attached."
_MATERIALS = """{subject}
Which materials may it consist of? Think of all of its parts, inside as well as outside; leave out \
coatings and paint. Name exactly 5 different ones, likeliest first, and the range of each one's \
mass density in kg/m^3.
Answer with nothing but a list in this form:
(material 1: low-high kg/m^3);(material 2: low-high kg/m^3);(material 3: low-high kg/m^3);\
(material 4: low-high kg/m^3);(material 5: low-high kg/m^3)"""
_THICKNESS = """{subject}
It may consist of: {names}.
How thick, in cm, is each of these in it: the wall of a hollow part, the full depth of a solid one?
Answer with nothing but a list in this form, with exactly these names:
(material 1: low-high cm);(material 2: low-high cm)"""
_JSON = """{subject}
Which materials may it consist of? Think of all of its parts, inside as well as outside; leave out \
coatings and paint. Name exactly 5 different ones, likeliest first, with the range of the mass \
density in kg/m^3 and the range of the thickness in cm: the wall of a hollow part, the full depth \
of a solid one.
Answer with nothing but JSON in this form:
{{"materials": [{{"name": "...", "density_kg_m3": [low, high], "thickness_cm": [low, high]}}]}}"""


class ChatProposer:
    """Candidates from a chat model; where its answers make no sense, those of a fallback, counted.

    Parameters
    ----------
    model
        Who is asked.
    fallback
        Proposes in its place; None = nobody does.
    form
        ``lists``: materials and densities in one answer, thicknesses in a second, as NeRF2Physics
        has it; ``json``: all in one.
    retries
        Further questions after an answer that makes no sense, each with the next seed.
    """

    def __init__(
        self,
        model: ChatModel,
        fallback: MaterialProposer | None,
        *,
        form: Literal["lists", "json"] = "lists",
        retries: int = RETRIES,
    ) -> None:
        self._model, self._fallback, self._retries = model, fallback, retries
        self._propose = self._from_lists if form == "lists" else self._from_json
        self._fallbacks = 0

    @property
    def source(self) -> str:
        """The model, and who stands in for it."""
        other = f"; if it fails, {self._fallback.source}" if self._fallback else ""
        return f"{self._model.source}{other}"

    @property
    def fallbacks(self) -> int:
        """How often the fallback proposed."""
        return self._fallbacks

    def propose(
        self, object_id: str, category: str, picture: Picture | None = None
    ) -> tuple[Candidate, ...]:
        """Ask for candidates.

        Raises
        ------
        ChatError
            If no answer comes at all, or none makes sense and there is no fallback.
        """
        subject = _SUBJECT.format(category=category, picture="" if picture is None else _PICTURE)
        images = () if picture is None else (png(picture),)
        if (found := self._propose(object_id, subject, images)) is not None:
            return found
        if self._fallback is None:
            raise unanswered(ChatRequest("materials", object_id, ""), self._retries)
        self._fallbacks += 1
        return self._fallback.propose(object_id, category, picture)

    def _from_lists(
        self, object_id: str, subject: str, images: tuple[bytes, ...]
    ) -> tuple[Candidate, ...] | None:
        text = _MATERIALS.format(subject=subject)
        first = ChatRequest("materials/1", object_id, text, images)
        densities = ask(self._model, first, parse_densities, retries=self._retries)
        if densities is None:
            return None
        text = _THICKNESS.format(subject=subject, names=", ".join(densities))
        second = ChatRequest("thickness/1", object_id, text, images)
        return ask(
            self._model,
            second,
            lambda answer: paired(densities, parse_thicknesses(answer)),
            retries=self._retries,
        )

    def _from_json(
        self, object_id: str, subject: str, images: tuple[bytes, ...]
    ) -> tuple[Candidate, ...] | None:
        request = ChatRequest("materials-json/1", object_id, _JSON.format(subject=subject), images)
        return ask(self._model, request, parse_json, retries=self._retries)
