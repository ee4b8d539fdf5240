"""Small objects and pictures for the tests of the trained networks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.phantoms import BAR, CUBE, HOLLOW, Box, box_object
from xden1k.access.samples import Examples, SampleView
from xden1k.folder import DatasetFolder, open_folder, write_folder
from xden1k.values.modality import Modality
from xden1k.values.types import DensityObject
from xden_baselines.pixie.categories import Peers
from xden_baselines.pixie.channels import channels
from xden_baselines.pixie.losses import Batch, gathered
from xden_baselines.pixie.store import Stored, stored
from xden_baselines.views.cameras import Rig
from xden_baselines.views.pictures import Pictures
from xden_baselines.views.source import RenderedPhantoms


@dataclass(frozen=True)
class Remembered(RenderedPhantoms):
    """Draws each object once."""

    drawn: dict[tuple[Path, str], Pictures] = field(default_factory=dict, repr=False, compare=False)

    def __call__(self, folder: DatasetFolder, object_id: str) -> Pictures:
        key = folder.root, object_id
        if key not in self.drawn:
            self.drawn[key] = super().__call__(folder, object_id)
        return self.drawn[key]


SMALL = Remembered(Rig(elevations_deg=(-40.0, 35.0), per_ring=4, size_px=64))
"""Eight small pictures."""
COLORS = {"plastic": (0.9, 0.2, 0.1), "steel": (0.5, 0.5, 0.6)}
SWAPPED = (
    replace(BAR[0], low=BAR[1].low, high=BAR[1].high),
    replace(BAR[1], low=BAR[0].low, high=BAR[0].high),
)
"""The same shape and category: colours and radiographs alone tell which half is of steel."""
TINY = {"resolution": 16, "epochs": 2, "batch": 2}
"""Settings of a fit that takes a second."""


def colored(object_id: str, boxes: Sequence[Box], **rest: Any) -> DensityObject:
    """An object whose parts have the colours of their names, in radiographs of 48 x 48 pixels."""
    obj = box_object(object_id, boxes, shape=(48, 48), **rest)
    parts = [replace(part, color_rgb=COLORS.get(part.name, (0.7, 0.7, 0.7))) for part in obj.parts]
    return replace(obj, parts=tuple(parts))


def dataset(root: Path) -> DatasetFolder:
    """Four objects to learn from and two to predict."""
    objects = [
        colored("bar-0001", BAR, split="train", category="bar"),
        colored("bar-0002", SWAPPED, split="train", category="bar"),
        colored("bar-0003", BAR, split="test", category="bar"),
        colored("cube-0001", CUBE, split="train", category="cube"),
        colored("hollow-0001", HOLLOW, split="train", category="mug"),
        colored("hollow-0002", HOLLOW, split="test", category="mug"),
    ]
    write_folder(objects, root, version="0.1.0", builder="tests")
    return open_folder(root)


def written(root: Path, boxes: tuple[Box, ...]) -> DatasetFolder:
    """A dataset of one object."""
    obj = colored("box-0001", boxes, split="train", category="box")
    write_folder([obj], root, version="0.1.0", builder="tests")
    return open_folder(root)


def sample(folder: DatasetFolder, object_id: str, reads: Modality) -> SampleView:
    return SampleView(folder, object_id, reads, SMALL)


def examples(folder: DatasetFolder, reads: Modality) -> Examples:
    return Examples(folder, "train", reads, "density", SMALL)


def prepared(folder: DatasetFolder, reads: Modality, resolution: int) -> list[Stored]:
    found = examples(folder, reads)
    return [stored(example, channels(example.sample), resolution) for example in found]


def together(objects: Sequence[Stored], resolution: int) -> Batch:
    """All objects as one batch, each told of its category."""
    categories = Peers.of(objects).categories
    return gathered(objects, [categories.kind(one.category) for one in objects], resolution)


@dataclass(frozen=True)
class Altered:
    """Pictures of a source, changed by a function."""

    change: Any
    source: RenderedPhantoms = SMALL
    description: str = "altered pictures"

    def __call__(self, folder: DatasetFolder, object_id: str) -> Pictures:
        return self.change(self.source(folder, object_id))


def altered(folder: DatasetFolder, object_id: str, reads: Modality, change: Any) -> SampleView:
    return SampleView(folder, object_id, reads, Altered(change))


def same_in_black(pictures: Pictures) -> Pictures:
    return replace(pictures, colors=np.zeros_like(pictures.colors))


def backwards(pictures: Pictures) -> Pictures:
    return pictures.take(range(len(pictures) - 1, -1, -1))
