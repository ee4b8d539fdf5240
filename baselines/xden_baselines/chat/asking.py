"""Asking until the answer makes sense, and asking much at the same time."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from typing import TypeVar

from xden1k.errors import DataError
from xden_baselines.chat.endpoint import ChatError, ChatModel
from xden_baselines.chat.request import CUT_OFF, ChatRequest

__all__ = ["RETRIES", "ask", "at_once", "unanswered"]

RETRIES = 3
"""Further questions after an answer that makes no sense."""

Answer = TypeVar("Answer")
Question = TypeVar("Question")

logger = logging.getLogger(__name__)


def ask(
    model: ChatModel,
    request: ChatRequest,
    parse: Callable[[str], Answer],
    *,
    retries: int = RETRIES,
) -> Answer | None:
    """Ask, and again with the next seed as long as the answer cannot be parsed.

    Parameters
    ----------
    model
        Who is asked.
    request
        The first question.
    parse
        Reads an answer; raises a DataError for one that makes no sense.
    retries
        Further questions, at most.

    Returns
    -------
    Answer or None
        What ``parse`` made of the first answer it could read; None if there was none. The caller
        counts it and says so in its row.

    Raises
    ------
    ChatError
        If no answer comes at all: an endpoint out of order must not look like a bad answer.
    """
    for seed in range(request.seed, request.seed + retries + 1):
        try:
            return parse(_whole(model.complete(replace(request, seed=seed))))
        except DataError as err:
            logger.info("%s: %s, seed %d: %s", request.about, request.prompt, seed, err)
    return None


def unanswered(request: ChatRequest, retries: int) -> ChatError:
    """Say that no answer made sense where nobody may answer in the model's place."""
    return ChatError(
        f"{request.about}: {request.prompt}: no answer of {retries + 1} made sense, and nobody "
        "may answer in the model's place (XDEN_VLM_FALLBACK=none, or zero-shot)"
    )


def at_once(
    work: Callable[[Question], Answer], questions: Iterable[Question], in_flight: int
) -> list[Answer]:
    """Do some work for each question, several at the same time; the order is that of the questions.

    Questions are taken as they are needed, so that few of their pictures are in memory. After an
    error nothing more is begun.

    Parameters
    ----------
    work
        Asks, in a thread of its own.
    questions
        What is asked.
    in_flight
        How many at the same time.
    """
    room = threading.Semaphore(2 * in_flight)
    futures: list[Future[Answer]] = []
    with ThreadPoolExecutor(in_flight) as pool:
        for question in questions:
            room.acquire()
            if any(one.done() and one.exception() for one in futures[-2 * in_flight :]):
                break
            future = pool.submit(work, question)
            future.add_done_callback(lambda _: room.release())
            futures.append(future)
        return [future.result() for future in futures]


def _whole(text: str) -> str:
    """Refuse an answer that was cut off: half a list reads as a shorter one."""
    if text.endswith(CUT_OFF):
        raise DataError("the answer is cut off: more tokens are needed")
    return text
