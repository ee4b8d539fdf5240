"""Part meshes from a network's clusters, as a rebuild reads them.

Points are asked about all over the inside of an outer surface; their clusters become closed solids
that fill it, but for what is void.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
import trimesh
from jaxtyping import Bool, Float, UInt8
from scipy import ndimage

from xden1k.access.samples import SampleView
from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.rays import CubeGrid, label_solids, outer_surface
from xden1k.segmentation import GRID_SIZE
from xden1k.segmentation.points import inside_voxels
from xden1k.values.arrays import Labels
from xden1k.values.closed import edge_faults
from xden1k.values.ply import CM_PER_UNIT, write_ply
from xden1k.values.types import FIELD_SIZE
from xden_baselines.geometry import nearest_filled
from xden_baselines.learning.checkpoint import WEIGHTS_FILE
from xden_baselines.xfield.methods import Predicting

__all__ = ["Regions", "dense_grid", "regions_of", "skin_voxels", "write_parts"]

POINTS: Final = 60_000
"""Points inside an object that are asked about, or nearly."""
COARSEST: Final = 32
VOID_G_CM3: Final = 0.15
"""A cluster that is lighter on the mean is void. That is the least gap at which the board of
segmentation tells materials apart, so such a cluster is of void's region; only foams are as light.
The errors are not alike: material taken for void is gone for good, while void taken for a part is
given its small density by the radiographs. So the limit is low."""
SAMPLES: Final = 10
"""Points of a surface in each face of a voxel, to see which voxels it crosses."""
FILLED: Final = 0.999
"""Least share of an outer surface's inside that lies within that of its parts."""
FRAGMENT: Final = 0.001
"""A piece with a smaller share of the inside goes to what is nearest to it."""
ABOUT_NAME: Final = "x-field.json"
"""Beside an object's parts: what they were made from, and the densities that were predicted."""
REGISTRATION: Final = "registration.json", "xden-registration/1"
"""Name and schema of the file that says that parts stand in the scanner's frame."""
ROW: Final = ("mesh_vertices", "mesh_faces", "face_part", "xray_pa", "xray_lat", "meta_json")
"""Columns that decide an object's parts."""

Inside = Bool[np.ndarray, "x y z"]
Clusters = UInt8[np.ndarray, "points"]
Densities = Float[np.ndarray, "points"]


@dataclass(frozen=True, slots=True, eq=False)
class Regions:
    """What is where inside an object.

    Parameters
    ----------
    labels
        Shape (x, y, z): 0 outside, else 1, 2, ..., the largest region first, and void last.
    density_g_cm3
        Mean predicted density of each region, void included.
    void
        Its label; None where nothing is void.
    """

    labels: Labels
    density_g_cm3: tuple[float, ...]
    void: int | None


def dense_grid(sample: SampleView) -> CubeGrid:
    """Give the grid over an object's cube that has about ``POINTS`` voxels inside."""
    edge_cm = sample.voxel_size_cm * FIELD_SIZE
    finest = edge_cm / np.cbrt(float(sample.outer_mesh.volume) / POINTS)
    size = int(np.clip(np.ceil(finest), COARSEST, GRID_SIZE))
    corner = sample.origin_cm - sample.voxel_size_cm / 2
    return CubeGrid(corner + edge_cm / size / 2, edge_cm / size, size)


def regions_of(
    inside: Inside, skin: Inside, clusters: Clusters, density_g_cm3: Densities
) -> Regions:
    """Make regions of the clusters of points.

    Clusters that are void become one; where all are, the heaviest is none, since something must
    have cast the shadow. Fragments go to what is nearest to them. Void never reaches the surface,
    which is by definition one of material: the skin belongs to the nearest material.

    Parameters
    ----------
    inside
        Shape (x, y, z): voxels that were asked about, at least one.
    skin
        Shape (x, y, z): those too near to the surface to be void.
    clusters, density_g_cm3
        Shape (points,): of these voxels, in C order.
    """
    sizes = np.maximum(np.bincount(clusters), 1)
    means = np.bincount(clusters, density_g_cm3) / sizes
    light = means < min(VOID_G_CM3, means[np.unique(clusters)].max())
    labels = np.zeros(inside.shape, dtype=np.uint8)
    labels[inside] = np.where(light[clusters], np.uint8(len(means) + 1), clusters + np.uint8(1))
    labels = _refilled(labels, inside, wrong=_fragments(labels, inside))
    void = labels == len(means) + 1
    labels = _refilled(labels, inside & ~void, wrong=skin & void)
    return _sorted(labels, inside, density_g_cm3, len(means) + 1)


def skin_voxels(outer: trimesh.Trimesh, inside: Inside, grid: CubeGrid) -> Inside:
    """Find the voxels inside that a surface crosses, and their neighbours.

    It may cross others than those beside the outside: a gap between two parts is often thinner than
    a voxel, and has none of its own.
    """
    number = int(SAMPLES * float(outer.area) / grid.voxel_size_cm**2)
    points_cm, _ = trimesh.sample.sample_surface(outer, max(number, 1), seed=0)
    places = np.floor((points_cm - grid.origin_cm) / grid.voxel_size_cm + 0.5).astype(int)
    crossed = np.zeros(inside.shape, dtype=np.bool_)
    crossed[tuple(places.clip(0, grid.size - 1).T)] = True
    return np.asarray(inside & ndimage.binary_dilation(crossed))


def _refilled(labels: Labels, known: Inside, wrong: Inside) -> Labels:
    """Give wrong voxels the label of the nearest known one that is not wrong."""
    if not wrong.any():
        return labels
    nearest = nearest_filled(labels.astype(np.float32), known & ~wrong).astype(np.uint8)
    return np.where(wrong, nearest, labels)


def _fragments(labels: Labels, inside: Inside) -> Inside:
    """Find pieces of labels that are too small, but for the largest of all."""
    pieces = np.zeros(labels.shape, dtype=np.int32)
    for label in np.unique(labels[inside]):
        found, _ = ndimage.label(labels == label)
        pieces += np.where(found > 0, found + pieces.max(), 0)
    sizes = np.bincount(pieces[inside])
    small = sizes < FRAGMENT * inside.sum()
    small[sizes.argmax()] = False
    return np.asarray(inside & small[pieces])


def _sorted(labels: Labels, inside: Inside, density_g_cm3: Densities, void: int) -> Regions:
    """Give labels numbers by their size, void last."""
    there, sizes = np.unique(labels[inside], return_counts=True)
    order = there[np.lexsort((-sizes, there == void))]
    number = np.zeros(int(there.max()) + 1, dtype=np.uint8)
    number[order] = np.arange(1, len(order) + 1)
    numbered = np.where(inside, number[labels], np.uint8(0))
    means = [float(density_g_cm3[numbered[inside] == one].mean()) for one in number[order]]
    return Regions(numbered, tuple(means), len(order) if order[-1] == void else None)


def write_parts(
    method: Predicting, fit: Path, folder: DatasetFolder, object_id: str, out: Path
) -> Literal["made", "kept"]:
    """Write the parts of an object, whole or not at all.

    ``OUT/OBJECT_ID`` gets ``parts/region-N.ply``, in the frame and the units of the object's
    capture, a ``parts.csv`` that tells no material, and what they were made from. One that was made
    from the same is kept.

    Parameters
    ----------
    method
        Taken up from ``fit``.
    fit
        The checkpoint's folder.
    folder, object_id
        The object, as ``xden-build run`` has made it.
    out
        Folder of all parts.

    Raises
    ------
    DataError
        If the object was not made from a capture, a radiograph does not show it, no point of the
        grid lies inside, a solid is not closed, or one leaves a void open to the outside.
    """
    made_from = _digest(method, fit, folder, object_id)
    if _made_from(out / object_id / ABOUT_NAME) == made_from:
        return "kept"
    meta = folder.object(object_id).meta
    if "mesh_units" not in meta:
        raise DataError(f"{object_id}: expected an object that xden-build run made of a capture")
    regions, solids = _solids(method, SampleView(folder, object_id, method.reads))
    out.mkdir(parents=True, exist_ok=True)
    fresh = out / f".{object_id}.partial"
    shutil.rmtree(fresh, ignore_errors=True)
    (fresh / "parts").mkdir(parents=True)
    units = str(meta["mesh_units"])
    for name, solid in solids.items():
        scaled = trimesh.Trimesh(solid.vertices / CM_PER_UNIT[units], solid.faces, process=False)
        write_ply(fresh / "parts" / f"{name}.ply", scaled, units)
    rows = "".join(f"{name},yes\n" for name in solids)
    (fresh / "parts.csv").write_text(f"name,hollow\n{rows}", encoding="utf-8")
    if "registration" in meta:
        name, schema = REGISTRATION
        how = {"schema": schema, "object_id": object_id, **meta["registration"]}
        _write_json(fresh / name, how)
    about = {"made_from": made_from, "method": method.name, "void": regions.void is not None}
    _write_json(fresh / ABOUT_NAME, {**about, "predicted_g_cm3": regions.density_g_cm3})
    shutil.rmtree(out / object_id, ignore_errors=True)
    fresh.rename(out / object_id)
    return "made"


def _solids(
    method: Predicting, sample: SampleView
) -> tuple[Regions, Mapping[str, trimesh.Trimesh]]:
    grid = dense_grid(sample)
    inside = inside_voxels(sample.outer_mesh, grid)
    if not inside.any():
        raise DataError(
            f"{sample.object_id}: expected points inside, got none on a grid of {grid.size} a side"
        )
    points_cm = grid.origin_cm + grid.voxel_size_cm * np.argwhere(inside)
    skin = skin_voxels(sample.outer_mesh, inside, grid)
    regions = regions_of(inside, skin, *method.clusters(sample, points_cm))
    found = label_solids(sample.outer_mesh, regions.labels, grid, regions.void)
    solids = {f"region-{k}": solid for k, solid in enumerate(found, 1) if len(solid.faces)}
    for name, solid in solids.items():
        if any(edge_faults(solid.faces)):
            raise DataError(f"{sample.object_id}: the solid {name} is not closed")
    filled = float(outer_surface(list(solids.values())).volume) / float(sample.outer_mesh.volume)
    if filled < FILLED:
        raise DataError(
            f"{sample.object_id}: expected parts that enclose all void, got ones whose outer "
            f"surface holds {filled:.1%} of the object's"
        )
    return regions, solids


def _digest(method: Predicting, fit: Path, folder: DatasetFolder, object_id: str) -> str:
    """Checksum of what decides an object's parts, but for this code."""
    digest = hashlib.sha256(f"{method.name} {method.version}".encode())
    digest.update((fit / WEIGHTS_FILE).read_bytes())
    for value in folder.row(object_id, list(ROW)).values():
        if value is not None:
            digest.update(value.encode() if isinstance(value, str) else value)
    return digest.hexdigest()


def _made_from(about: Path) -> str | None:
    """Read what parts that are there were made from; None where nothing tells."""
    try:
        values = json.loads(about.read_text(encoding="utf-8"))
    except (FileNotFoundError, ValueError, RecursionError):
        return None
    return str(values.get("made_from")) if isinstance(values, dict) else None


def _write_json(path: Path, values: Mapping[str, Any]) -> None:
    path.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")
