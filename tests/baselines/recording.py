"""Asking a server about many objects, in a process that may be killed meanwhile."""

from __future__ import annotations

from pathlib import Path

from xden_baselines.chat.answers import parse_densities
from xden_baselines.chat.asking import ask, at_once
from xden_baselines.chat.candidates import Range
from xden_baselines.chat.cassette import Recorder
from xden_baselines.chat.endpoint import Endpoint
from xden_baselines.chat.prompts import MATERIALS, of_object
from xden_baselines.chat.request import ChatRequest

OBJECTS, IN_FLIGHT = 400, 8


def question(number: int) -> ChatRequest:
    """What is asked about an object."""
    name = f"mug-{number:04}"
    return ChatRequest("materials/2", name, of_object(name), system=MATERIALS)


def record_all(base_url: str, cassette: str) -> list[dict[str, Range] | None]:
    """Ask about every object and keep the answers; None where none makes sense."""
    recorder = Recorder(Endpoint(base_url, "qwen", timeout_s=300, pause_s=0), Path(cassette))

    def answered(number: int) -> dict[str, Range] | None:
        return ask(recorder, question(number), parse_densities)

    found = at_once(answered, range(OBJECTS), IN_FLIGHT)
    recorder.close()
    return found
