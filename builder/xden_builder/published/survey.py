"""What one object says of the whole release, before anything is decided: small, and of JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np
from jaxtyping import Bool, Float32, Float64

from xden_builder.published import kernels
from xden_builder.published.fill import fill_mesh
from xden_builder.published.given import PublishedObject
from xden_builder.published.hypotheses import families_of
from xden_builder.published.labels import LabelVolume, label_volume
from xden_builder.published.orientation import ORIENTATIONS, best_way, overlaps
from xden_builder.published.refine import fit_pair, mesh_box
from xden_builder.published.shares import volume_shares

CLASSES: Final = 8
"""Of ways through a part."""
THREES: Final = ("mesh_extent", "volume_extent", "size_cm", "box_sides", "box_middle")

Three = tuple[float, float, float]

__all__ = ["PartSeen", "Survey", "mean_chords", "parts_seen", "survey_object"]


@dataclass(frozen=True, slots=True)
class PartSeen:
    """One part as the volume shows it.

    Parameters
    ----------
    name
        Of the table, or of what is in one piece its category; empty where neither tells.
    category
        Of the object.
    lac_per_cm
        Attenuation coefficient.
    filled_voxels
        Its volume.
    paths_voxels, others_voxels_per_cm
        Shape (3, 8): for each axis of the volume the ways through the part of the rays along it, in
        eight classes of as many rays each; and what lies beside it on them, way times coefficient.
    chords_voxels
        Shape (3, 2): for each axis how wide the shadow along it is, along either other axis: the
        mean length of the lines in which they cross it.
    rays
        Shape (3,): how many meet it along each axis.
    """

    name: str
    category: str
    lac_per_cm: float
    filled_voxels: float
    paths_voxels: Sequence[Sequence[float]]
    others_voxels_per_cm: Sequence[Sequence[float]]
    chords_voxels: Sequence[Sequence[float]]
    rays: Sequence[int]


@dataclass(frozen=True, slots=True)
class Survey:
    """One object's say.

    Parameters
    ----------
    object_id
        Which.
    overlaps
        Shape (2, 48): of :func:`xden_builder.published.orientation.overlaps`.
    mesh_extent, volume_extent
        Sides of the boxes, in the mesh's unit and in voxels.
    size_cm
        As published, in the release's order.
    box_sides, box_middle
        Of the mesh's box in the volume, along the volume's axes, in shares of its longest side, as
        the object's own best mode and orientation put it.
    parts
        In the order of the labels.
    """

    object_id: str
    overlaps: Sequence[Sequence[float]]
    mesh_extent: Three
    volume_extent: Three
    size_cm: Three
    box_sides: Three
    box_middle: Three
    parts: tuple[PartSeen, ...]

    def to_json(self) -> dict[str, Any]:
        """Return values of JSON's types."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Survey:
        """Read what :meth:`to_json` gave."""
        parts = [PartSeen(**part) for part in values["parts"]]
        threes = {name: tuple(values[name]) for name in THREES}
        return cls(**{**values, **threes, "parts": tuple(parts)})


def survey_object(given: PublishedObject) -> Survey:
    """Ask one object.

    Raises
    ------
    DataError
        If the mesh holds nothing, or the volume shows nothing.
    """
    volume = label_volume(given.lac_per_cm, given.table_lac_per_cm)
    mesh, shares = fill_mesh(given.mesh), volume_shares(volume)
    scores = overlaps(mesh, shares).round(5)
    mode, place = best_way(scores)
    sides, middle = mesh_box(shares, fit_pair(mesh, shares, ORIENTATIONS[place], mode))
    return Survey(
        given.object_id,
        scores.tolist(),
        _three(mesh.extent),
        _three(shares.extent),
        _three(given.size_cm),
        _three(sides / volume.longest),
        _three(middle / volume.longest),
        parts_seen(volume, given.category),
    )


def parts_seen(volume: LabelVolume, category: str) -> tuple[PartSeen, ...]:
    """Measure the parts of a volume, in voxels."""
    along = [_along(volume, axis) for axis in range(3)]
    return tuple(
        PartSeen(name, category, lac, size, *zip(*seen, strict=True))
        for name, lac, size, *seen in zip(
            _told_names(volume, category),
            volume.lac_per_cm.tolist(),
            volume.filled_voxels.tolist(),
            *along,
            strict=True,
        )
    )


def _told_names(volume: LabelVolume, category: str) -> tuple[str, ...]:
    """Names of the parts; what is in one piece is called as the object, if its name says nothing.

    Examples
    --------
    >>> labels = np.ones((1, 1, 1), dtype=np.uint8)
    >>> share, lac, flags = labels.astype(np.float32), np.ones(1), ("parts_from_volume",)
    >>> whole = LabelVolume(labels, share, ("region_01",), lac, lac, (), flags, (0, 0, 0), 1)
    >>> _told_names(whole, "wrench")
    ('wrench',)
    """
    told = volume.names if "parts_from_volume" not in volume.flags else ("",) * len(volume.names)
    return (category,) if len(told) == 1 and not families_of(told[0]) else told


_Seen = tuple[list[float], list[float], list[float], int]


def _along(volume: LabelVolume, axis: int) -> list[_Seen]:
    """Classes of ways through each part along an axis, what lies beside it, chords, and rays."""
    labels, share = np.moveaxis(volume.labels, axis, 2), np.moveaxis(volume.share, axis, 2)
    paths = np.zeros((len(volume.names), *labels.shape[:2]), dtype=np.float32)
    depths = np.zeros(labels.shape[:2], dtype=np.float32)
    kernels.ways(labels, share, volume.lac_per_cm, paths, depths)
    return [
        _seen(path, depths - lac * path)
        for path, lac in zip(paths, volume.lac_per_cm.tolist(), strict=True)
    ]


def _seen(path: Float32[np.ndarray, "u v"], others: Float32[np.ndarray, "u v"]) -> _Seen:
    """Means of the rays that meet a part, the shortest ways first, and the size of its shadow."""
    shadow = path > 0
    met = np.flatnonzero(shadow)
    order = met[np.argsort(path.ravel()[met], kind="stable")]
    groups = np.array_split(order, CLASSES) if len(order) >= CLASSES else [order] * CLASSES
    ways, beside = (
        [float(values.ravel()[group].mean()) for group in groups] for values in (path, others)
    )
    return ways, [max(value, 0.0) for value in beside], mean_chords(shadow), len(met)


def mean_chords(shadow: Bool[np.ndarray, "u v"]) -> list[float]:
    """Mean length of the lines along either axis in which they cross a shadow, in pixels.

    Examples
    --------
    >>> mean_chords(np.ones((8, 2), dtype=bool))
    [8.0, 2.0]
    """
    padded = np.pad(shadow, 1)
    ends = [int((np.diff(padded, axis=axis)).sum()) for axis in (0, 1)]
    return [2 * int(shadow.sum()) / count for count in ends]


def _three(values: Float64[np.ndarray, "3"]) -> Three:
    x, y, z = values.tolist()
    return x, y, z
