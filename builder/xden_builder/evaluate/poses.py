"""How far the poses of rebuilt objects are off, whatever the symmetry of the objects."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np
import trimesh
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError, require
from xden1k.folder import open_folder
from xden1k.values.arrays import Points
from xden1k.values.types import DensityObject
from xden_builder.capture import CaptureFolder
from xden_builder.evaluate.cells import table
from xden_builder.evaluate.truth import size_of
from xden_builder.poly.model.frames import Pose
from xden_builder.registration.placement import RigidPlacement
from xden_builder.workers import gather

__all__ = ["PoseError", "PoseErrors", "compare_poses", "pose_error", "poses_markdown"]

PROBES: Final = 3000
"""Spread over the surface of each part."""
WITHIN: Final = 0.95
"""Share of a part's surface that is to lie near."""
RIGHT_MM: Final = 0.5
RIGHT_DEG: Final = 0.3
"""A right pose puts no part farther off; degrees as the object's rim moves about its middle."""
POSE_FLAGS: Final = frozenset({"pose_ambiguous", "pose_not_found", "shape_differs"})


@dataclass(frozen=True, slots=True)
class PoseError:
    """How far one rebuilt object is from where it stood.

    Parameters
    ----------
    off_mm
        The worst part's: 95 % of its surface, posed as rebuilt, are within it of the surface of
        what is of its material, posed as it stood.
    off_deg
        The turn about the object's middle that moves its farthest point by as much.
    flags
        Those of its pose.
    """

    off_mm: float
    off_deg: float
    flags: tuple[str, ...]

    @property
    def right(self) -> bool:
        """Whether it is within half a millimetre and 0.3 degrees."""
        return self.off_mm <= RIGHT_MM and self.off_deg <= RIGHT_DEG


@dataclass(frozen=True, slots=True)
class PoseErrors:
    """Poses of a rebuilt folder.

    Parameters
    ----------
    objects
        By object id.
    failures
        Object id and reason of the others.
    """

    objects: Mapping[str, PoseError]
    failures: tuple[tuple[str, str], ...]

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return asdict(self)


def compare_poses(
    captures: Path,
    root: Path,
    *,
    workers: int,
    on_done: Callable[[str], None] = lambda _: None,
) -> PoseErrors:
    """Compare the poses of a rebuilt folder with those in which the objects stood.

    Parameters
    ----------
    captures
        Folder of simulated captures of a tube, with their truth.
    root
        Dataset folder made of it.
    workers
        Processes.
    on_done
        Told of each object.

    Raises
    ------
    DataError
        If a folder cannot be read.
    MissingExtraError
        If libigl (extra ``import``) is not installed.
    """
    require("igl", "import")
    built = set(open_folder(root).ids())
    wanted = CaptureFolder(captures).object_ids
    there = [key for key in wanted if key in built]
    objects, failures = gather(partial(_compared, captures, root), there, workers, on_done)
    missing = [(key, "not rebuilt") for key in wanted if key not in built]
    return PoseErrors(objects, tuple(sorted([*missing, *failures])))


def pose_error(
    meshes: Sequence[trimesh.Trimesh],
    materials: Sequence[str],
    stood: Callable[[Points], Points],
    found: Callable[[Points], Points],
    flags: Iterable[str] = (),
) -> PoseError:
    """Measure how far apart two poses put an object.

    What is of one material is one kind: an object turned such that each part comes to lie on its
    kind looks, and weighs, the same.

    Parameters
    ----------
    meshes, materials
        Of its parts.
    stood, found
        Move points of the meshes, in cm, shape (n, 3): to where the object stood, and to where the
        rebuild has it.
    flags
        Of the rebuilt object; those of its pose are kept.

    Raises
    ------
    MissingExtraError
        If libigl (extra ``import``) is not installed.
    """
    kinds = {
        kind: _moved(
            [mesh for mesh, its in zip(meshes, materials, strict=True) if its == kind], stood
        )
        for kind in set(materials)
    }
    off_cm = max(
        _off_cm(found(_probes_cm(mesh)), kinds[kind])
        for mesh, kind in zip(meshes, materials, strict=True)
    )
    corners = np.concatenate([mesh.vertices for mesh in kinds.values()])
    rim_cm = float(np.linalg.norm(corners - corners.mean(axis=0), axis=1).max())
    raised = tuple(sorted(POSE_FLAGS.intersection(flags)))
    return PoseError(10 * off_cm, float(np.degrees(off_cm / rim_cm)), raised)


def poses_markdown(sets: Mapping[str, PoseErrors]) -> str:
    """Write a row for each set, then each object whose pose is not right, the worst first."""
    rows = [_row(name, list(each.objects.values())) for name, each in sets.items() if each.objects]
    if not rows:
        return "0 poses.\n"
    headers = (
        *("set", "objects", "right", "not right, flagged", "not right, not flagged"),
        *("right, but flagged", "right ones off, median, mm", "90th percentile, mm"),
    )
    wrong = sorted(
        (
            (-error.off_mm, name, key, error)
            for name, each in sets.items()
            for key, error in each.objects.items()
            if not error.right
        ),
        key=lambda row: row[:3],
    )
    sections = [
        f"Poses. Right: of every part {WITHIN:.0%} of the surface lie within {RIGHT_MM} mm and "
        f"{RIGHT_DEG}° of where they stood.",
        table(headers, rows),
    ]
    if wrong:
        listed = [
            [name, key, f"{error.off_mm:.2f}", f"{error.off_deg:.2f}", ", ".join(error.flags)]
            for _, name, key, error in wrong
        ]
        sections += [
            "Not right:",
            table(("set", "object", "off, mm", "off, degrees", "flags"), listed),
        ]
    return "\n\n".join(sections) + "\n"


def _row(name: str, errors: Sequence[PoseError]) -> list[str]:
    right = [error for error in errors if error.right]
    wrong = [error for error in errors if not error.right]
    off_mm = [error.off_mm for error in right] or [float("nan")]
    flagged = sum(bool(error.flags) for error in wrong)
    return [
        name,
        str(len(errors)),
        f"{len(right)} ({len(right) / len(errors):.1%})",
        str(flagged),
        f"{len(wrong) - flagged} ({(len(wrong) - flagged) / len(errors):.1%})",
        str(sum(bool(error.flags) for error in right)),
        *(f"{value:.2f}" for value in np.quantile(off_mm, [0.5, 0.9]).tolist()),
    ]


def _compared(captures: Path, root: Path, object_id: str) -> PoseError:
    rebuilt = open_folder(root).object(object_id)
    parts = CaptureFolder(captures).read(object_id).parts
    path = captures / object_id / "truth.json"
    if not path.is_file():
        raise DataError(f"{path}: expected the truth of a simulated object, found none")
    values = json.loads(path.read_text(encoding="utf-8"))
    kinds = {part["name"]: part["material"] for part in values["parts"]}
    return pose_error(
        [part.mesh for part in parts],
        [kinds[part.name] for part in parts],
        _stood(values),
        _found(rebuilt),
        rebuilt.flags,
    )


def _stood(values: Mapping[str, Any]) -> Callable[[Points], Points]:
    """Where the object of a ``truth.json`` stood, from the meshes that were handed over."""
    if "mesh_pose" in values:
        return RigidPlacement.from_dict(values["mesh_pose"]).apply
    matrix = np.linalg.inv(np.array(values["mesh_error"]["matrix"]))
    return lambda points_cm: np.asarray(points_cm @ matrix[:3, :3].T + matrix[:3, 3])


def _found(rebuilt: DensityObject) -> Callable[[Points], Points]:
    """Where a rebuilt object stands: registered, given its size, and refined."""
    meta = rebuilt.meta
    if not (refined := (meta.get("poly") or {}).get("pose")):
        raise DataError(f"{rebuilt.object_id}: expected a pose, got a rebuild without")
    placement, size = meta.get("registration"), size_of(rebuilt)
    there = None if placement is None else RigidPlacement.from_dict(placement)
    pose = Pose.from_dict(refined)
    turn = Rotation.from_rotvec(pose.rotation_rad).as_matrix()
    centre_cm, shift_cm = np.array(pose.centre_cm), np.array(pose.shift_cm)

    def moved(points_cm: Points) -> Points:
        registered = points_cm if there is None else there.apply(points_cm)
        return np.asarray((size.applied(registered) - centre_cm) @ turn.T + centre_cm + shift_cm)

    return moved


def _moved(meshes: Sequence[trimesh.Trimesh], move: Callable[[Points], Points]) -> trimesh.Trimesh:
    """Put meshes into one, moved."""
    together = trimesh.util.concatenate(meshes)
    assert isinstance(together, trimesh.Trimesh)
    return trimesh.Trimesh(move(np.asarray(together.vertices)), together.faces, process=False)


def _probes_cm(mesh: trimesh.Trimesh) -> Points:
    points_cm, _ = trimesh.sample.sample_surface(mesh, PROBES, seed=1)
    return np.asarray(points_cm, dtype=np.float64)


def _off_cm(points_cm: Points, surface: trimesh.Trimesh) -> float:
    """Distance within which most of the points lie of a surface."""
    squared, *_ = require("igl", "import").point_mesh_squared_distance(
        np.ascontiguousarray(points_cm),
        np.asarray(surface.vertices, dtype=np.float64),
        np.asarray(surface.faces, dtype=np.int64),
    )
    distances: Float64[np.ndarray, "n"] = np.sqrt(np.asarray(squared, dtype=np.float64))
    return float(np.quantile(distances, WITHIN))
