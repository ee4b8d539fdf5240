"""One question to a chat model, and the key its answer is kept under."""

from __future__ import annotations

import base64
import hashlib
import io
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import PIL.Image

from xden_baselines.chat.candidates import Picture

__all__ = ["CUT_OFF", "ChatRequest", "png"]

CUT_OFF = "\n[cut off: no tokens left]"
"""End of an answer that the limit of tokens has ended; it is recorded with it."""

Content = list[dict[str, Any]]


@dataclass(frozen=True, slots=True)
class ChatRequest:
    """One question: a text, the pictures it is about, and what is said before it.

    Parameters
    ----------
    prompt
        Id and version of the wording, ``materials/1``; raised whenever the wording changes.
    about
        The object, for messages alone: it is no part of the key.
    text
        What is asked.
    images
        PNG files, sent after the text in this order.
    seed, temperature
        Sent along; a temperature of None leaves it to the server.
    system
        What holds for all questions of this kind, sent first; empty = nothing.
    examples
        Questions and their right answers, sent before the text.
    """

    prompt: str
    about: str
    text: str
    images: tuple[bytes, ...] = ()
    seed: int = 100
    temperature: float | None = None
    system: str = ""
    examples: tuple[tuple[str, str], ...] = ()

    def messages(self) -> list[dict[str, Any]]:
        """Return what is sent: the user's message last, pictures as data URLs."""
        return self._messages(_data_url)

    def key(self, model: str, max_tokens: int) -> str:
        """SHA-256 of all that an answer can depend on, as canonical JSON; pictures by their pixels.

        Not by their files: another Pillow or zlib packs the same pixels otherwise.
        """
        values = {
            "model": model,
            "prompt": self.prompt,
            "messages": self._messages(_pixels_sha256),
            "seed": self.seed,
            "temperature": self.temperature,
            "max_tokens": max_tokens,
        }
        canonical = json.dumps(values, sort_keys=True, separators=(",", ":"))
        return hashlib.sha256(canonical.encode()).hexdigest()

    def _messages(self, show: Callable[[bytes], str]) -> list[dict[str, Any]]:
        pictures: Content = [
            {"type": "image_url", "image_url": {"url": show(image)}} for image in self.images
        ]
        content: Content = [{"type": "text", "text": self.text}, *pictures]
        return [*self._before(), {"role": "user", "content": content}]

    def _before(self) -> Iterator[dict[str, Any]]:
        """Messages before the question."""
        if self.system:
            yield {"role": "system", "content": self.system}
        for question, answer in self.examples:
            yield {"role": "user", "content": question}
            yield {"role": "assistant", "content": answer}


def png(picture: Picture) -> bytes:
    """Return a picture as the bytes of a PNG file.

    Examples
    --------
    >>> import numpy as np
    >>> png(np.zeros((2, 3, 3), dtype=np.uint8))[1:4]
    b'PNG'
    """
    file = io.BytesIO()
    PIL.Image.fromarray(picture).save(file, format="PNG")
    return file.getvalue()


def _pixels_sha256(image: bytes) -> str:
    with PIL.Image.open(io.BytesIO(image)) as picture:
        about = f"{picture.mode} {picture.size} "
        return hashlib.sha256(about.encode() + picture.tobytes()).hexdigest()


def _data_url(image: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(image).decode()}"
