"""From an attenuation volume to the part of each voxel, and how much of the voxel it fills."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np
from jaxtyping import Float32, Float64, Int64, UInt8

from xden1k.errors import DataError
from xden1k.values.types import MAX_PARTS
from xden_builder.published import kernels

__all__ = ["LEAST_PER_CM", "LabelVolume", "air_per_cm", "label_volume"]

LEAST_PER_CM: Final = 1e-3
"""Attenuation up to which a voxel is air, 1/cm; air itself has 2e-4."""
OVER_AIR: Final = 3.0
MARGIN: Final = 4
"""Voxels of air around the object."""
LIKE: Final = 0.004
"""Share within which two attenuation coefficients are one."""
ROUNDING: Final = 1e-4
"""Share by which voxels of one plateau may differ."""
FLOOR: Final = 0.03
"""Of the weakest part's level: voxels up to it are air."""
JOINED: Final = "+"
"""Between the names of parts that are one."""
FEWEST: Final = MappingProxyType({1: 12, 2: 100})
"""Voxels that make a level in a volume without a table: inside of a part, and in a sheet."""


@dataclass(frozen=True, slots=True, eq=False)
class LabelVolume:
    """Parts on the volume's own grid, cropped to the object with a margin of air.

    Parameters
    ----------
    labels
        Owner of each voxel: 0 = air, k = part k.
    share
        Share of each voxel that its owner fills, 0 to 1.
    names, lac_per_cm
        Of the parts; parts that the volume cannot tell apart are one, ``a+b``.
    guessed_voxels
        Volume of each part in voxels that have none of it for certain near by: whose they are was
        guessed from their values.
    lost
        Parts of the table that no voxel shows, or without an attenuation.
    flags
        What was found on the way.
    start
        Its first voxel in the volume as published; negative where the margin reaches beyond.
    longest
        Longest side of the volume as published, in voxels.
    """

    labels: UInt8[np.ndarray, "x y z"]
    share: Float32[np.ndarray, "x y z"]
    names: tuple[str, ...]
    lac_per_cm: Float64[np.ndarray, "parts"]
    guessed_voxels: Float64[np.ndarray, "parts"]
    lost: tuple[str, ...]
    flags: tuple[str, ...]
    start: tuple[int, int, int]
    longest: int

    @property
    def filled_voxels(self) -> Float64[np.ndarray, "parts"]:
        """Volume of each part."""
        total = np.zeros(len(self.names) + 1)
        kernels.volumes(self.labels, self.share, total)
        return total[1:]


class _Voxels(NamedTuple):
    """Level of each voxel, how full it is, and what each level got by guessing."""

    labels: UInt8[np.ndarray, "x y z"]
    share: Float32[np.ndarray, "x y z"]
    guessed: Float64[np.ndarray, "k"]


@dataclass(frozen=True, slots=True)
class _Levels:
    """What the parts' voxels hold, in the order of the parts."""

    names: tuple[str, ...]
    lac_per_cm: tuple[float, ...]


def air_per_cm(volume: Float32[np.ndarray, "x y z"]) -> float:
    """Return what the volume holds beside the object: the median of its six faces."""
    faces = [np.moveaxis(volume, axis, 0)[end].ravel() for axis in range(3) for end in (0, -1)]
    return float(np.median(np.concatenate(faces)))


def label_volume(
    volume: Float32[np.ndarray, "x y z"], table_lac_per_cm: Mapping[str, float]
) -> LabelVolume:
    """Find the part of each voxel.

    Parameters
    ----------
    volume
        Attenuation coefficient of each voxel, 1/cm.
    table_lac_per_cm
        Of each part. Where it is empty, or the volume shows none of it but other levels, these
        count, and parts are named ``region_01`` and so on, the weakest first; by the table where
        that has as many.

    Raises
    ------
    DataError
        If nothing but air is found.

    Examples
    --------
    >>> volume = np.zeros((20, 20, 20), dtype=np.float32)
    >>> volume[5:15, 5:15, 5:10], volume[5:15, 5:15, 10:15] = 0.2, 1.5
    >>> found = label_volume(volume, {"head": 1.5, "handle": 0.2})
    >>> np.bincount(found.labels.ravel())[1:].tolist()
    [500, 500]
    """
    air = max(OVER_AIR * air_per_cm(volume), LEAST_PER_CM)
    box = _box(volume, air)
    cropped = np.pad(volume[box], MARGIN)
    usable = {name: lac for name, lac in table_lac_per_cm.items() if lac > air}
    levels, flags = _levels_and_flags(cropped, usable, air)
    voxels = _assigned(cropped, np.array(levels.lac_per_cm), air)
    shown = np.unique(voxels.labels[voxels.labels > 0]).astype(np.int64) - 1
    names = tuple(levels.names[place] for place in shown)
    x, y, z = (along.start - MARGIN for along in box)
    return LabelVolume(
        labels=_renumbered(voxels.labels, shown, len(levels.names)),
        share=voxels.share,
        names=names,
        lac_per_cm=np.array(levels.lac_per_cm)[shown],
        guessed_voxels=voxels.guessed[shown],
        lost=_lost(names, table_lac_per_cm),
        flags=flags,
        start=(x, y, z),
        longest=max(volume.shape),
    )


def _box(volume: Float32[np.ndarray, "x y z"], air: float) -> tuple[slice, slice, slice]:
    """Find what is more than air."""
    above = volume > air
    box = []
    for axis in range(3):
        met = np.flatnonzero(above.any(axis=tuple({0, 1, 2} - {axis})))
        if not len(met):
            raise DataError(f"volume: expected values above {air:.2g} 1/cm, got air alone")
        box.append(slice(int(met[0]), int(met[-1]) + 1))
    x, y, z = box
    return x, y, z


def _levels_and_flags(
    volume: Float32[np.ndarray, "x y z"], table_lac_per_cm: Mapping[str, float], air: float
) -> tuple[_Levels, tuple[str, ...]]:
    """Find the levels of the parts, and the flags that come with them.

    A table of which the volume shows no level is one of other figures: the volume's levels count,
    and have the table's names where there are as many, the weakest first in both.
    """
    if not table_lac_per_cm:
        return _from_volume(volume, air), ("parts_from_volume",)
    told = _from_table(table_lac_per_cm)
    merged = _merged_flags(told, table_lac_per_cm)
    near = _near(volume, np.sort(told.lac_per_cm))
    if not _shared_values(volume[_plateaus(np.where(near, 0, volume), air) == 1], FEWEST[1]):
        return told, merged
    if np.count_nonzero(near) >= FEWEST[1]:
        return told, (*merged, "levels_not_in_table")
    shown = _from_volume(volume, air)
    if len(shown.names) != len(told.names):
        return shown, ("levels_not_in_table", "parts_from_volume")
    names = tuple(told.names[place] for place in np.argsort(told.lac_per_cm))
    return _Levels(names, shown.lac_per_cm), (*merged, "levels_not_in_table")


def _merged_flags(told: _Levels, table_lac_per_cm: Mapping[str, float]) -> tuple[str, ...]:
    return ("equal_levels",) if len(told.names) < len(table_lac_per_cm) else ()


def _near(
    volume: Float32[np.ndarray, "x y z"], ascending: Float64[np.ndarray, "k"]
) -> UInt8[np.ndarray, "x y z"]:
    """Level that each voxel has, counted from 1; 0 = none."""
    near = np.zeros(volume.shape, dtype=np.uint8)
    kernels.near_levels(volume, ascending, LIKE, near)
    return near


def _plateaus(volume: Float32[np.ndarray, "x y z"], air: float) -> UInt8[np.ndarray, "x y z"]:
    """Mark the insides of parts, 1, and sheets, 2."""
    kinds = np.zeros(volume.shape, dtype=np.uint8)
    kernels.plateaus(volume, air, ROUNDING, kinds)
    return kinds


def _from_table(table_lac_per_cm: Mapping[str, float]) -> _Levels:
    """Take the table's levels; parts whose voxels cannot be told apart become one."""
    groups: list[list[str]] = []
    for name in sorted(table_lac_per_cm, key=lambda each: table_lac_per_cm[each]):
        last = table_lac_per_cm[groups[-1][0]] if groups else 0.0
        if table_lac_per_cm[name] <= last * (1 + 2 * LIKE):
            groups[-1].append(name)
        else:
            groups.append([name])
    order = list(table_lac_per_cm)
    groups = sorted(
        (sorted(group, key=order.index) for group in groups), key=lambda each: order.index(each[0])
    )
    return _Levels(
        tuple(JOINED.join(group) for group in groups),
        tuple(float(np.mean([table_lac_per_cm[name] for name in group])) for group in groups),
    )


def _from_volume(volume: Float32[np.ndarray, "x y z"], air: float) -> _Levels:
    """Look for values that many voxels share, and for what is stronger than all of these.

    Voxels never hold more than their strongest part: where many hold more than the strongest value
    that is shared, or none is, a part is too thin to fill enough of them, and the largest value is
    its own.
    """
    kinds = _plateaus(volume, air)
    inner, sheets = (_shared_values(volume[kinds == kind], FEWEST[kind]) for kind in (1, 2))
    known = np.array(inner)
    new = [value for value in sheets if not (np.abs(known - value) <= LIKE * value).any()]
    levels = sorted([*inner, *new])[:MAX_PARTS]
    strongest = levels[-1] if levels else air
    beyond = volume[volume > strongest * (1 + LIKE)]
    if len(beyond) >= FEWEST[1] and len(levels) < MAX_PARTS:
        levels.append(float(beyond.max()))
    if not levels:
        raise DataError(
            f"volume: expected {FEWEST[1]} voxels above {air:.2g} 1/cm, got {len(beyond)}"
        )
    names = tuple(f"region_{number:02d}" for number in range(1, len(levels) + 1))
    return _Levels(names, tuple(levels))


def _shared_values(values: Float32[np.ndarray, "n"], fewest: int) -> list[float]:
    """Return values that many voxels have, ascending."""
    ordered = np.sort(values.astype(np.float64))
    starts = np.flatnonzero(np.diff(ordered, prepend=0.0) > LIKE * ordered)
    groups = np.split(ordered, starts[1:])
    return [float(np.median(group)) for group in groups if len(group) >= fewest]


def _assigned(
    volume: Float32[np.ndarray, "x y z"], lac_per_cm: Float64[np.ndarray, "k"], air: float
) -> _Voxels:
    """Label the voxels by levels in any order."""
    order = np.argsort(lac_per_cm)
    levels = lac_per_cm[order]
    labels = np.zeros(volume.shape, dtype=np.uint8)
    share = np.zeros(volume.shape, dtype=np.float32)
    guessed = np.zeros(len(levels))
    floor = max(FLOOR * float(levels[0]), air)
    kernels.assign(volume, levels, _near(volume, levels), _steps(), floor, labels, share, guessed)
    numbers = np.append(0, order + 1).astype(np.uint8)
    return _Voxels(numbers[labels], share, guessed[np.argsort(order)])


def _steps() -> Int64[np.ndarray, "steps 3"]:
    """Return steps to the voxels within two: six neighbours, the rest of 26, then the others."""
    steps = np.argwhere(np.ones((5, 5, 5))) - 2
    far = (steps**2).sum(axis=1)
    beyond = np.abs(steps).max(axis=1) > 1
    order = np.lexsort((far, beyond))
    return steps[order][1 : int(((far <= 4) | ~beyond).sum())]


def _renumbered(
    labels: UInt8[np.ndarray, "x y z"], shown: Int64[np.ndarray, "parts"], count: int
) -> UInt8[np.ndarray, "x y z"]:
    """Leave out levels without a voxel, and number the rest."""
    numbers = np.zeros(count + 1, dtype=np.uint8)
    numbers[shown + 1] = np.arange(1, len(shown) + 1)
    return np.asarray(numbers[labels])


def _lost(names: Iterable[str], told: Iterable[str]) -> tuple[str, ...]:
    """Names of the table that none of the parts has, nor is joined of."""
    here = {name for joined in names for name in joined.split(JOINED)}
    return tuple(name for name in told if name not in here)
