"""Asking until the answer makes sense."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from xden1k.errors import DataError
from xden_baselines.chat.endpoint import ChatModel
from xden_baselines.chat.request import ChatRequest

__all__ = ["RETRIES", "ask"]

RETRIES = 3
"""Further questions after an answer that makes no sense."""

Answer = TypeVar("Answer")

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
            return parse(model.complete(replace(request, seed=seed)))
        except DataError as err:
            logger.info("%s: %s, seed %d: %s", request.about, request.prompt, seed, err)
    return None
