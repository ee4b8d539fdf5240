"""What one object says of the whole release, before anything is decided: small, and of JSON."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
from jaxtyping import Float64

from xden_builder.published import kernels
from xden_builder.published.fill import fill_mesh
from xden_builder.published.given import PublishedObject
from xden_builder.published.labels import LabelVolume, label_volume
from xden_builder.published.orientation import overlaps
from xden_builder.published.shares import volume_shares

__all__ = ["PartSeen", "Survey", "parts_seen", "survey_object"]


@dataclass(frozen=True, slots=True)
class PartSeen:
    """One part as the volume shows it.

    Parameters
    ----------
    name
        Of the table; empty where the name came from the volume.
    lac_per_cm
        Attenuation coefficient.
    filled_voxels
        Its volume.
    paths_voxels
        Along each axis of the volume: mean way through the part of the rays that meet it.
    """

    name: str
    lac_per_cm: float
    filled_voxels: float
    paths_voxels: tuple[float, float, float]


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
    parts
        In the order of the labels.
    """

    object_id: str
    overlaps: Sequence[Sequence[float]]
    mesh_extent: tuple[float, float, float]
    volume_extent: tuple[float, float, float]
    size_cm: tuple[float, float, float]
    parts: tuple[PartSeen, ...]

    def to_json(self) -> dict[str, Any]:
        """Return values of JSON's types."""
        return asdict(self)

    @classmethod
    def from_json(cls, values: dict[str, Any]) -> Self:
        """Read what :meth:`to_json` gave."""
        parts = [
            PartSeen(**{**part, "paths_voxels": tuple(part["paths_voxels"])})
            for part in values["parts"]
        ]
        sides = {name: tuple(values[name]) for name in ("mesh_extent", "volume_extent", "size_cm")}
        return cls(**{**values, **sides, "parts": tuple(parts)})


def survey_object(given: PublishedObject) -> Survey:
    """Ask one object.

    Raises
    ------
    DataError
        If the mesh holds nothing, or the volume shows nothing.
    """
    volume = label_volume(given.lac_per_cm, given.table_lac_per_cm)
    mesh, shares = fill_mesh(given.mesh), volume_shares(volume)
    return Survey(
        given.object_id,
        overlaps(mesh, shares).round(5).tolist(),
        _three(mesh.extent),
        _three(shares.extent),
        _three(given.size_cm),
        parts_seen(volume),
    )


def parts_seen(volume: LabelVolume) -> tuple[PartSeen, ...]:
    """Measure the parts of a volume, in voxels."""
    paths = np.stack([_mean_paths(volume, axis) for axis in range(3)], axis=1)
    filled = np.bincount(volume.labels.ravel(), volume.share.ravel(), len(volume.names) + 1)[1:]
    named = "parts_from_volume" not in volume.flags
    return tuple(
        PartSeen(name if named else "", lac, size, _three(ways))
        for name, lac, size, ways in zip(
            volume.names, volume.lac_per_cm.tolist(), filled.tolist(), paths, strict=True
        )
    )


def _mean_paths(volume: LabelVolume, axis: int) -> Float64[np.ndarray, "parts"]:
    """Mean way through each part along an axis, over the rays that meet it."""
    filled, columns = np.zeros(len(volume.names)), np.zeros(len(volume.names), dtype=np.int64)
    kernels.runs(
        np.moveaxis(volume.labels, axis, 2), np.moveaxis(volume.share, axis, 2), filled, columns
    )
    return filled / columns


def _three(values: Float64[np.ndarray, "3"]) -> tuple[float, float, float]:
    x, y, z = values.tolist()
    return x, y, z
