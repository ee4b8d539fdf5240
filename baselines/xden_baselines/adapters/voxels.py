"""``pixie`` and ``vomp``: densities on a grid of the run's own box.

::

    RUNS/NAME/sample_0_pred.npy       Pixie: (11, 64, 64, 64), density, E, nu scaled to [-1, 1],
                                      then eight classes, one-hot
    RUNS/NAME/sample_0_mask.npy       (64, 64, 64): the object
    RUNS/NAME/mapped_preds.ply        in place of the two: x, y, z, density, material_id
    RENDERS/NAME/clip_features.npz    min_bounds, max_bounds, voxel_size, grid_shape
    RANGES                            normalization_ranges.yaml: one line of JSON

    RUNS/NAME.npz                     VoMP: voxel_data, structured: x, y, z, density, segment_id:
                                      voxel_material, or query_point_material, interpolated_material

Densities are in kg/m³.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from xden1k.errors import DataError
from xden_baselines.adapters.cloud import Cloud
from xden_baselines.adapters.files import numbers, read_json, read_npy, read_npz, read_ply
from xden_baselines.adapters.frames import dataparser

__all__ = ["density_range", "read_pixie", "read_vomp", "unscaled"]

PIXIE_SIZE: Final = 64
PIXIE_CHANNELS: Final = 11
PIXIE_CLASSES: Final = 3
"""Channel of the first class."""
BACKGROUND: Final = 7
VOMP_SIZE: Final = 64
VOMP_BOX: Final = np.array([[-0.5] * 3, [0.5] * 3])
"""The object's box is centred in it, its longest side 1."""
VOXEL_SEGMENT: Final = "voxel_material"
QUERY_SEGMENTS: Final = ("query_point_material", "interpolated_material")
"""Of points that the user chose: vertices of the mesh, unless told."""
PLY_NAMES: Final = ("x", "y", "z", "density", "material_id")
NODE_TOLERANCE: Final = 0.05
"""How far off a node, in steps, a point of a PLY file may lie."""

Range = tuple[float, float]


def density_range(path: Path) -> Range:
    """Read log10 of the densities, kg/m³, that -1 and 1 stand for.

    Raises
    ------
    DataError
        If the file is missing or has no such range.
    """
    values = read_json(path)
    low, high = (
        float(numbers(values.get(key), (), f"{path}: {key}"))
        for key in ("density_p1", "density_p99")
    )
    if not low < high:
        raise DataError(f"{path}: expected density_p1 < density_p99, got {low} and {high}")
    return low, high


def unscaled(scaled: Float[np.ndarray, "*shape"], span: Range) -> Float[np.ndarray, "*shape"]:
    """Density in kg/m³ of a network's output, which is clipped to [-1, 1].

    Examples
    --------
    >>> unscaled(np.array([-1.0, 0.0, 5.0]), (2.0, 4.0)).tolist()
    [100.0, 1000.0, 10000.0]
    """
    low, high = span
    return np.asarray(10 ** ((np.clip(scaled, -1, 1) + 1) / 2 * (high - low) + low))


def read_pixie(runs: Path, name: str, renders: Path, span: Range | None) -> Cloud:
    """Read a result of Pixie: the voxels of the mask that are no background.

    The grid was sampled at ``min_bounds + i * voxel_size``: the PLY files, which spread it up to
    ``max_bounds``, are put back.

    Parameters
    ----------
    runs, name
        The inference run, and what it calls the object.
    renders
        Folder of the voxel grids.
    span
        From :func:`density_range`; not needed for PLY files.

    Raises
    ------
    DataError
        If a file is missing or breaks its format, or nothing but background is left.
    """
    low, high, step = _grid(renders / name / "clip_features.npz")
    ply, world = runs / name / "mapped_preds.ply", runs / name / "world_mapped_preds.ply"
    if (runs / name / "sample_0_pred.npy").exists():
        if span is None:
            raise DataError(f"{runs / name}: its densities are scaled: name their --ranges")
        indices, density, foreground = _predicted(runs / name, span)
    elif ply.exists():
        indices, density, foreground = _mapped(ply, low, high, None)
    elif world.exists():
        parser = renders / name / "dataparser_transforms.json"
        indices, density, foreground = _mapped(world, low, high, parser)
    else:
        raise DataError(f"{runs / name}: expected sample_0_pred.npy or {ply.name} or {world.name}")
    if not foreground.any():
        raise DataError(f"{runs / name}: no voxel of the mask is of another class than background")
    nodes = low + step * indices
    box = np.stack([nodes.min(axis=0) - step / 2, nodes.max(axis=0) + step / 2])
    return Cloud(
        nodes[foreground],
        density[foreground],
        "kg/m3",
        cell=step,
        box=box,
        unread=int((~foreground).sum()),
    )


def read_vomp(runs: Path, name: str, *, original_scale: bool) -> Cloud:
    """Read the voxels of VoMP, or the points that it was asked for.

    Points of the surface say nothing of the inside: there the nearest one speaks, and the coverage
    of the row tells how far.

    Parameters
    ----------
    runs, name
        The run, and what it calls the object.
    original_scale
        Whether coordinates are the mesh's; else those of its normalised box. The file does not say.

    Raises
    ------
    DataError
        If the file is missing, holds other points or two kinds of them, or breaks its format.
    """
    path = runs / f"{name}.npz"
    voxels = read_npz(path, ("voxel_data",)).get("voxel_data")
    expected = {"x", "y", "z", "density", "segment_id"}
    if voxels is None or voxels.ndim != 1 or not expected <= set(voxels.dtype.names or ()):
        got = "nothing" if voxels is None else f"{voxels.dtype} {voxels.shape}"
        raise DataError(f"{path}: voxel_data must have the fields {sorted(expected)}, got {got}")
    segments = np.unique(voxels["segment_id"]).tolist()
    if len(segments) != 1 or segments[0] not in (VOXEL_SEGMENT, *QUERY_SEGMENTS):
        raise DataError(
            f"{path}: expected one segment_id of {[VOXEL_SEGMENT, *QUERY_SEGMENTS]}, "
            f"got {segments[:3]}"
        )
    points = np.stack(
        [numbers(voxels[axis], (None,), f"{path}: voxel_data: {axis}") for axis in "xyz"], axis=1
    )
    density = numbers(voxels["density"], (None,), f"{path}: voxel_data: density")
    in_box = np.abs(points).max() <= 0.5 + NODE_TOLERANCE / VOMP_SIZE
    if segments[0] in QUERY_SEGMENTS:
        if not (in_box or original_scale):
            raise DataError(
                f"{path}: expected points within 0.5 of the centre of the box: for coordinates of "
                "the mesh give --original-scale"
            )
        return Cloud(points, density, "kg/m3", box=None if original_scale else VOMP_BOX)
    if original_scale:
        return Cloud(
            points, density, "kg/m3", cell=float(np.ptp(points, axis=0).max()) / (VOMP_SIZE - 1)
        )
    steps = (points + 0.5) * VOMP_SIZE - 0.5
    if (np.abs(steps - np.rint(steps)) > NODE_TOLERANCE).any() or not in_box:
        raise DataError(
            f"{path}: expected voxel centres (i + 0.5) / {VOMP_SIZE} - 0.5: for coordinates of "
            "the mesh give --original-scale"
        )
    return Cloud(points, density, "kg/m3", cell=1 / VOMP_SIZE, box=VOMP_BOX)


def _grid(path: Path) -> tuple[np.ndarray, np.ndarray, float]:
    """Bounds of Pixie's grid and the distance of its nodes."""
    names = ("min_bounds", "max_bounds", "voxel_size", "grid_shape")
    found = read_npz(path, names)
    if missing := [name for name in names if name not in found]:
        raise DataError(f"{path}: {missing[0]} is missing")
    low, high, shape = (
        numbers(found[name], (3,), f"{path}: {name}")
        for name in ("min_bounds", "max_bounds", "grid_shape")
    )
    step = float(numbers(found["voxel_size"], (), f"{path}: voxel_size"))
    if shape.tolist() != [PIXIE_SIZE] * 3:
        raise DataError(f"{path}: grid_shape must be {(PIXIE_SIZE,) * 3}, got {shape.tolist()}")
    # 63 or 64 steps: f3rm's range may or may not reach the end
    if step <= 0 or (np.abs((high - low) / step - (PIXIE_SIZE - 0.5)) > 1).any():
        raise DataError(
            f"{path}: {PIXIE_SIZE} steps of {step:g} do not span {low.tolist()} to {high.tolist()}"
        )
    return low, high, step


def _predicted(folder: Path, span: Range) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return indices and densities of the mask's voxels, and which of them are foreground."""
    grid = (PIXIE_SIZE,) * 3
    path = folder / "sample_0_pred.npy"
    found = numbers(read_npy(path), (PIXIE_CHANNELS, *grid), str(path))
    mask = _mask(folder / "sample_0_mask.npy")
    classes = found[PIXIE_CLASSES:].argmax(axis=0)
    return np.argwhere(mask), unscaled(found[0][mask], span), classes[mask] != BACKGROUND


def _mask(path: Path) -> Bool[np.ndarray, "x y z"]:
    found, grid = read_npy(path), (PIXIE_SIZE,) * 3
    if found.shape != grid or found.dtype.kind not in "biuf":
        raise DataError(f"{path}: expected a mask of shape {grid}, got {found.dtype} {found.shape}")
    if not (mask := found > 0).any():
        raise DataError(f"{path}: the mask is empty")
    return mask


def _mapped(
    path: Path, low: np.ndarray, high: np.ndarray, parser: Path | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the same from a PLY file, whose nodes are spread from one bound to the other."""
    found = read_ply(path, PLY_NAMES)
    points = np.stack([numbers(found[axis], (None,), f"{path}: {axis}") for axis in "xyz"], axis=1)
    if parser is not None:
        points = dataparser(parser)(points)
    steps = (points - low) / (high - low) * (PIXIE_SIZE - 1)
    indices = np.rint(steps)
    if (np.abs(steps - indices) > NODE_TOLERANCE).any() or not (
        (indices >= 0) & (indices < PIXIE_SIZE)
    ).all():
        raise DataError(f"{path}: its points are no nodes of the grid between the bounds")
    density = numbers(found["density"], (len(points),), f"{path}: density")
    return indices, density, numbers(found["material_id"], (None,), str(path)) != BACKGROUND
