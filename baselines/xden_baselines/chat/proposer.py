"""Asking a chat model what an object consists of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, TypeVar

from xden_baselines.chat.answers import (
    paired,
    parse_caption,
    parse_densities,
    parse_json,
    parse_thicknesses,
)
from xden_baselines.chat.asking import RETRIES, ask, unanswered
from xden_baselines.chat.candidates import Candidate, MaterialProposer, Picture
from xden_baselines.chat.endpoint import ChatModel
from xden_baselines.chat.prompts import (
    CAPTION,
    JSON,
    MATERIALS,
    SUBJECT,
    THICKNESS,
    THICKNESS_EXAMPLES,
    of_object,
)
from xden_baselines.chat.request import ChatRequest, png

__all__ = ["ChatProposer"]

Form = Literal["lists", "caption", "json"]
Answer = TypeVar("Answer")


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
        has it; ``caption``: the same, and the model's own sentence about the picture in place of
        the category, as there too; ``json``: all in one.
    retries
        Further questions after an answer that makes no sense, each with the next seed.
    """

    def __init__(
        self,
        model: ChatModel,
        fallback: MaterialProposer | None,
        *,
        form: Form = "lists",
        retries: int = RETRIES,
    ) -> None:
        self._model, self._fallback, self._retries = model, fallback, retries
        by_form = {
            "lists": self._from_lists,
            "caption": self._from_caption,
            "json": self._from_json,
        }
        self._propose = by_form[form]
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
        images = () if picture is None else (png(picture),)
        if (found := self._propose(object_id, category, images)) is not None:
            return found
        assert self._fallback is not None  # or the question that nobody answered has been named
        self._fallbacks += 1
        return self._fallback.propose(object_id, category, picture)

    def _from_caption(
        self, object_id: str, category: str, images: tuple[bytes, ...]
    ) -> tuple[Candidate, ...] | None:
        request = ChatRequest("caption/1", object_id, CAPTION, images)
        caption = self._ask(request, parse_caption)
        return None if caption is None else self._from_lists(object_id, caption, ())

    def _from_lists(
        self, object_id: str, description: str, images: tuple[bytes, ...]
    ) -> tuple[Candidate, ...] | None:
        text = of_object(description)
        first = ChatRequest("materials/2", object_id, text, images, system=MATERIALS)
        densities = self._ask(first, parse_densities)
        if densities is None:
            return None
        second = ChatRequest(
            "thickness/2",
            object_id,
            of_object(description, tuple(densities)),
            images,
            system=THICKNESS,
            examples=THICKNESS_EXAMPLES,
        )
        return self._ask(second, lambda answer: paired(densities, parse_thicknesses(answer)))

    def _from_json(
        self, object_id: str, description: str, images: tuple[bytes, ...]
    ) -> tuple[Candidate, ...] | None:
        text = JSON.format(subject=_subject(description, images))
        request = ChatRequest("materials-json/1", object_id, text, images)
        return self._ask(request, parse_json)

    def _ask(self, request: ChatRequest, parse: Callable[[str], Answer]) -> Answer | None:
        """Ask; where no answer makes sense, None is for the fallback, or the run ends."""
        answer = ask(self._model, request, parse, retries=self._retries)
        if answer is None and self._fallback is None:
            raise unanswered(request, self._retries)
        return answer


def _subject(description: str, images: tuple[bytes, ...]) -> str:
    picture = " A picture of it is attached." if images else ""
    return SUBJECT.format(description=description, picture=picture)
