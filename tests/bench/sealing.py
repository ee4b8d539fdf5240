"""A dataset whose answers are unmistakable, and its sealed form."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from tests.phantoms import Box, box_object
from xden1k.documents.maintainer import Answers
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.values.types import DensityObject, Part
from xden_bench.sealed import Key, SealedTruth, Sealing, seal

KEY = Key(bytes(range(32)))
OTHER_KEY = Key(bytes(range(1, 33)))
ANSWERS = Answers.parse(b'[motivation]\nfunding = "A lottery."\n', "a file")
"""Of the maintainer, which anyone may know."""
SIZES = {"bolt": 0.5, "mug": 1.0, "pan": 1.5, "vase": 2.0}
"""Edge of the objects of each category."""


def box_of(name: str, number: int, answers: int) -> DensityObject:
    """One object; ``answers`` changes all that is secret and nothing that is not."""
    object_id, shape, size = f"{name}-{number:04d}", (12, 10), SIZES[name]
    shown = box_object(object_id, _boxes(size, (1.0, 2.0, 3.0)), shape=shape)
    draw = np.random.default_rng([number, answers, *name.encode()])
    boxes = _boxes(size, draw.uniform(1, 8, 3).tolist())
    hidden = box_object(
        object_id,
        boxes,
        shape=shape,
        category=name,
        split="test" if number else "train",
        weighed_mass_g=float(draw.uniform(1, 100)),
        flags=(f"remark-{object_id}-{answers}",),
        meta={"fit": {"gain": float(draw.uniform())}, "seed": 10**20 + answers},
    )
    parts = tuple(_marked(part, f"{object_id}-{answers}", draw) for part in hidden.parts)
    return replace(hidden, views=shown.views, parts=parts)


def _boxes(size: float, densities: Sequence[float]) -> tuple[Box, ...]:
    """Three boxes on no common axis: every figure of the object depends on every density."""
    places = (((0, 0, 0), (1, 2, 4)), ((1, 0, 0), (2, 1, 2)), ((1, 1, 0), (2, 2, 1)))
    return tuple(
        Box(f"part-{number}", _scaled(low, size), _scaled(high, size), density)
        for number, ((low, high), density) in enumerate(zip(places, densities, strict=True))
    )


def _scaled(corner: tuple[int, int, int], size: float) -> tuple[float, float, float]:
    x, y, z = (size * value for value in corner)
    return x, y, z


def _marked(part: Part, mark: str, draw: np.random.Generator) -> Part:
    return replace(
        part,
        material=f"material-{mark}",
        flags=(f"mark-{mark}",),
        color_rgb=tuple(draw.uniform(size=3).tolist()),
        density_sd_g_cm3=float(draw.uniform()),
    )


def write_dataset(root: Path, answers: int = 0, changed: frozenset[str] = frozenset()) -> Path:
    """Write 16 test objects of four categories, four to learn from; those named get new answers."""
    objects = [
        box_of(name, number, answers if f"{name}-{number:04d}" in changed else 0)
        for name in SIZES
        for number in range(5)
    ]
    write_folder(
        objects, root, version="1.0.0", builder="tests", config_sha256="c" * 64, answers=ANSWERS
    )
    return root


@dataclass(frozen=True)
class Sealed:
    """A dataset, what was made of it, and where."""

    whole: DatasetFolder
    out: Path
    made: Sealing

    @cached_property
    def public(self) -> DatasetFolder:
        return open_folder(self.out / "public")

    @cached_property
    def answers(self) -> dict[str, Any]:
        """What the private objects' answers are when nothing is wrong."""
        truth = self.truth()
        return {one: truth.answers(one) for one in self.made.private_ids}

    @property
    def path(self) -> Path:
        return self.out / "sealed-truth.xden"

    def truth(self, path: Path | None = None, key: Key = KEY) -> SealedTruth:
        return SealedTruth(path or self.path, self.public, key)


def sealed_dataset(whole: Path, out: Path, key: Key = KEY) -> Sealed:
    folder = open_folder(whole)
    return Sealed(folder, out, seal(folder, key, out))


def secrets_of(value: Any) -> Iterator[bytes]:
    """Every way a figure or a text may lie in a file."""
    if isinstance(value, str):
        yield value.encode()
    elif isinstance(value, float):
        yield struct.pack("<d", value)
        yield struct.pack("<f", value)
        yield f"{value:.5f}"[:7].encode()
    elif isinstance(value, list):
        for one in value:
            yield from secrets_of(one)
