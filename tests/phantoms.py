"""Small objects made of boxes: mass, centre of mass, paths and voxel means in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import trimesh

from xden1k.values.physics import PAPER_MAC_CM2_G
from xden1k.values.types import FIELD_SIZE, LABEL_SIZE, DensityField, DensityObject, Part
from xden1k.values.views import ViewGeometry, XRayView

NAN = float("nan")
APPARENT = 1.25
"""Apparent over true density of every box, so that no test can take one for the other."""
SOURCE_DISTANCE_CM = 100.0
DETECTOR_DISTANCE_CM = 40.0


@dataclass(frozen=True)
class Box:
    """A homogeneous axis-aligned box, with a box-shaped hole if ``hole`` gives one."""

    name: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    density_g_cm3: float = 1.0
    hole: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None
    material: str = ""

    @property
    def regions(self) -> list[tuple[int, np.ndarray, np.ndarray]]:
        """Sign, low and high corner: the box, then the hole."""
        outer = [(1, np.array(self.low), np.array(self.high))]
        return outer if self.hole is None else [*outer, (-1, *map(np.array, self.hole))]

    @property
    def mass_g(self) -> float:
        """Exact mass."""
        return self.density_g_cm3 * sum(
            sign * float(np.prod(high - low)) for sign, low, high in self.regions
        )

    @property
    def apparent_density_g_cm3(self) -> float:
        """What the paper's rule makes of its attenuation."""
        return APPARENT * self.density_g_cm3

    @property
    def moment_g_cm(self) -> np.ndarray:
        """Mass times centre of mass."""
        return self.density_g_cm3 * sum(
            sign * np.prod(high - low) * (low + high) / 2 for sign, low, high in self.regions
        )

    @property
    def mesh(self) -> trimesh.Trimesh:
        """Closed mesh; the hole's faces look inwards."""
        shells = [
            trimesh.creation.box(bounds=np.stack([low, high])) for _, low, high in self.regions
        ]
        faces = [shells[0].faces, *(8 + hole.faces[:, ::-1] for hole in shells[1:])]
        vertices = np.concatenate([shell.vertices for shell in shells])
        return trimesh.Trimesh(vertices, np.concatenate(faces), process=False)

    def share(self, axes: Sequence[np.ndarray], voxel: float) -> np.ndarray:
        """Exact share of each voxel that the part fills."""
        return sum(
            sign * np.einsum("i,j,k->ijk", *map(_overlap, axes, low, high, [voxel] * 3))
            for sign, low, high in self.regions
        )

    def lengths_cm(self, start: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Exact path length of rays from ``start`` along unit vectors."""
        return sum(sign * _chord(start, direction, low, high) for sign, low, high in self.regions)


def _overlap(centres: np.ndarray, low: float, high: float, voxel: float) -> np.ndarray:
    top, bottom = np.minimum(centres + voxel / 2, high), np.maximum(centres - voxel / 2, low)
    return np.clip(top - bottom, 0, None) / voxel


def _chord(start: np.ndarray, direction: np.ndarray, low: np.ndarray, high: np.ndarray):
    steps = np.where(np.abs(direction) < 1e-12, 1e-12, direction)
    a, b = (low - start) / steps, (high - start) / steps
    return np.clip(np.maximum(a, b).min(axis=-1) - np.minimum(a, b).max(axis=-1), 0, None)


def geometry(name: str, shape: tuple[int, int], half_cm: float) -> ViewGeometry:
    """Cone beam along +y (``pa``) or +x (``lat``); the detector shows +- ``half_cm`` at z = 0."""
    beam = np.array([0.0, 1.0, 0.0] if name == "pa" else [1.0, 0.0, 0.0])
    side = np.array([1.0, 0.0, 0.0] if name == "pa" else [0.0, -1.0, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    half = half_cm * (1 + DETECTOR_DISTANCE_CM / SOURCE_DISTANCE_CM)
    row_step, column_step = -2 * half / shape[0] * up, 2 * half / shape[1] * side
    corner = DETECTOR_DISTANCE_CM * beam - half * side + half * up
    return ViewGeometry(
        beam="cone",
        source_cm=-SOURCE_DISTANCE_CM * beam,
        pixel00_cm=corner + (row_step + column_step) / 2,
        column_step_cm=column_step,
        row_step_cm=row_step,
        shape=shape,
    )


def view(name: str, boxes: Sequence[Box], shape: tuple[int, int], half_cm: float) -> XRayView:
    """Noise-free radiograph, one ray a pixel, each box of its apparent density; one dead pixel."""
    place = geometry(name, shape, half_cm)
    rows, columns = np.meshgrid(*(np.arange(n, dtype=float) for n in shape), indexing="ij")
    rays = place.pixel_centres_cm(rows, columns) - place.source_cm
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    depth = sum(
        box.apparent_density_g_cm3 * PAPER_MAC_CM2_G * box.lengths_cm(place.source_cm, rays)
        for box in boxes
    )
    valid = np.ones(shape, dtype=bool)
    valid[-1, -1] = False
    return XRayView(name, np.where(valid, np.exp(-depth), 0).astype(np.float32), valid, place)


def box_object(
    object_id: str,
    boxes: Sequence[Box],
    *,
    shape: tuple[int, int] = (24, 20),
    density_known: bool = True,
    **rest: Any,
) -> DensityObject:
    """Object of boxes that do not overlap; the first box's hole counts as enclosed."""
    low = np.min([box.low for box in boxes], axis=0)
    high = np.max([box.high for box in boxes], axis=0)
    edge = 1.06 * float((high - low).max())
    corner, voxel = (low + high) / 2 - edge / 2, edge / FIELD_SIZE
    axes = [corner[i] + voxel * (np.arange(FIELD_SIZE) + 0.5) for i in range(3)]
    shares = [box.share(axes, voxel) for box in boxes]
    origin = corner + voxel / 2
    density = sum(box.density_g_cm3 * share for box, share in zip(boxes, shares, strict=True))
    field = DensityField(density, origin, voxel)
    apparent = DensityField(APPARENT * density, origin, voxel)
    half_cm = 1.2 * float(np.abs([low, high]).max())
    envelope = sum(Box("", box.low, box.high).share(axes, voxel) for box in boxes)
    return DensityObject(
        object_id=object_id,
        **{"category": "box", "split": "test", "source": "phantom"} | rest,
        views=tuple(view(name, boxes, shape, half_cm) for name in ("pa", "lat")),
        parts=tuple(_part(box, density_known) for box in boxes),
        labels=_labels(boxes, corner, edge / LABEL_SIZE),
        occupancy=np.clip(sum(shares), 0, 1),
        envelope=np.clip(envelope, 0, 1),
        density=field if density_known else None,
        apparent_density=apparent,
        origin_cm=origin,
        voxel_size_cm=voxel,
    )


def published_object(object_id: str, boxes: Sequence[Box], **rest: Any) -> DensityObject:
    """Object of the authors' release: the same without radiographs."""
    made = box_object(object_id, boxes, source="published", **rest)
    return replace(made, views=(), flags=("no_radiographs",))


def _part(box: Box, density_known: bool) -> Part:
    return Part(
        name=box.name,
        mesh=box.mesh,
        material=box.material,
        lac_per_cm=box.apparent_density_g_cm3 * PAPER_MAC_CM2_G,
        apparent_density_g_cm3=box.apparent_density_g_cm3,
        density_g_cm3=box.density_g_cm3 if density_known else NAN,
        density_sd_g_cm3=0.01 * box.density_g_cm3 if density_known else NAN,
        density_source="truth" if density_known else "none",
    )


def _labels(boxes: Sequence[Box], corner: np.ndarray, voxel: float) -> np.ndarray:
    axes = [corner[i] + voxel * (np.arange(LABEL_SIZE) + 0.5) for i in range(3)]
    labels = np.zeros((LABEL_SIZE,) * 3, dtype=np.uint8)
    for k, box in enumerate(boxes, start=1):
        for sign, low, high in box.regions:
            inside = [(low[i] <= axes[i]) & (axes[i] < high[i]) for i in range(3)]
            labels[np.ix_(*inside)] = k if sign > 0 else 0
    return labels


def exact_mass_g(boxes: Sequence[Box]) -> float:
    """Mass in closed form."""
    return sum(box.mass_g for box in boxes)


def exact_com_cm(boxes: Sequence[Box]) -> np.ndarray:
    """Centre of mass in closed form."""
    return sum(box.moment_g_cm for box in boxes) / exact_mass_g(boxes)


CUBE = (Box("cube", (-1, -1, -1), (1, 1, 1), 2.0, material="aluminium"),)
"""16 g, centre of mass at the origin."""
BAR = (
    Box("plastic", (0, 0, 0), (1, 2, 4), 1.0, material="polypropylene"),
    Box("steel", (1, 0, 0), (2, 2, 4), 8.0, material="steel"),
)
"""72 g, centre of mass at (25/18, 1, 2)."""
HOLLOW = (Box("shell", (-2, -2, -2), (2, 2, 2), 1.5, hole=((-1, -1, -1), (1, 1, 1))),)
"""84 g; an eighth of the envelope is an enclosed cavity."""
FILLED = (
    Box("shell", (-2, -1, -1), (2, 1, 1), 1.0, hole=((-1, -0.5, -0.5), (1, 0.5, 0.5))),
    Box("core", (-1, -0.5, -0.5), (1, 0.5, 0.5), 4.0, material="glass"),
)
"""A core that fills the hole of its shell."""


@cache
def objects() -> tuple[DensityObject, ...]:
    """Six objects, sorted by id, in all three splits; one of which only attenuation is known."""
    return (
        box_object("bar-0001", BAR, split="train", category="bar"),
        box_object("bar-0002", BAR, split="test", category="bar", weighed_mass_g=71.5),
        box_object("cube-0001", CUBE, split="train", category="cube", flags=("remark",)),
        box_object("cube-0002", CUBE, split="val", category="cube", density_known=False),
        box_object("filled-0001", FILLED, split="test", category="filled"),
        box_object("hollow-0001", HOLLOW, split="test", category="hollow", shape=(16, 30)),
    )
