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
from jaxtyping import Float64, Int64
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError, require
from xden1k.folder import open_folder
from xden1k.values.arrays import Points, Vec3
from xden1k.values.types import DensityObject
from xden_builder.capture import CaptureFolder
from xden_builder.evaluate.cells import table
from xden_builder.evaluate.truth import size_of
from xden_builder.poly.model.frames import Pose
from xden_builder.poly.sureness import felt_ways, moves_across, moves_at_all
from xden_builder.registration.placement import RigidPlacement
from xden_builder.workers import gather

__all__ = ["PoseError", "PoseErrors", "compare_poses", "pose_error", "poses_markdown"]

PROBES: Final = 1000
"""Spread over the surface of each part."""
WITHIN: Final = 0.95
"""Share of a part's surface that is to lie near."""
RIGHT_DEG: Final = 0.3
RIGHT_MM: Final = 0.5
MOST_MOVES: Final = 30
GROWTHS: Final = (0.5, 2.0)
"""Least and most: an object far from where it stood would shrink to a point on its surface."""
STILL: Final = 1e-4
"""A move of the rim by less, as a share of its radius, is none."""
POSE_FLAGS: Final = frozenset(
    {"mirrored", "pose_ambiguous", "pose_not_found", "pose_uncertain", "shape_differs"}
)


@dataclass(frozen=True, slots=True)
class PoseError:
    """How far one rebuilt object is from where it stood.

    Turn, shift and size are those of the least move that takes each part, posed as rebuilt, onto
    the surface of what is of its material, posed as it stood: a turn about an axis of symmetry, or
    one that puts parts onto their like, is none.

    Parameters
    ----------
    turn_deg
        Angle of its rotation.
    rim_deg
        The same at the rim: how far it moves any point, over how far the farthest is from the
        object's middle. A pen turned about its length is turned, and hardly any point is moved.
    shift_mm
        Of the object's middle.
    size_share
        By which the object is too large.
    left_mm
        What no such move takes away, of the worst part: 95 % of its surface lie as near. Large
        where the object is in another pose altogether.
    flags
        Those of its pose.
    """

    turn_deg: float
    rim_deg: float
    shift_mm: float
    size_share: float
    left_mm: float
    flags: tuple[str, ...]

    @property
    def right(self) -> bool:
        """Whether it is turned by 0.3 degrees at the rim and half a millimetre off at most."""
        return self.rim_deg <= RIGHT_DEG and max(self.shift_mm, self.left_mm) <= RIGHT_MM


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
        kind: _Surface.of(
            [mesh for mesh, its in zip(meshes, materials, strict=True) if its == kind], stood
        )
        for kind in sorted(set(materials))
    }
    onto = [kinds[kind] for kind in materials]
    parts = [found(_probes_cm(mesh)) for mesh in meshes]
    middle_cm = np.concatenate(parts).mean(axis=0)
    arms_cm = np.concatenate(parts) - middle_cm
    rim_cm = float(np.linalg.norm(arms_cm, axis=1).max())
    turn, shift_cm, growth = Rotation.identity(), np.zeros(3), 1.0
    for _ in range(MOST_MOVES):
        at = [_placed(part, middle_cm, turn, shift_cm, growth) for part in parts]
        step = _least_move(at, onto, middle_cm + shift_cm, rim_cm)
        turn = Rotation.from_rotvec(step[:3]) * turn
        shift_cm = shift_cm + rim_cm * step[3:6]
        growth = float(np.clip(growth * np.exp(step[6]), *GROWTHS))
        if np.linalg.norm(step) < STILL:
            break
    left_cm = max(
        float(np.quantile(surface.nearest(part)[1], WITHIN))
        for surface, part in zip(
            onto, (_placed(part, middle_cm, turn, shift_cm, growth) for part in parts), strict=True
        )
    )
    moved_cm = np.linalg.norm(np.cross(turn.as_rotvec(), arms_cm), axis=1)
    return PoseError(
        rim_deg=float(np.degrees(moved_cm.max() / rim_cm)),
        turn_deg=float(np.degrees(turn.magnitude())),
        shift_mm=10 * float(np.linalg.norm(shift_cm)),
        size_share=1 / growth - 1,
        left_mm=10 * left_cm,
        flags=tuple(sorted(POSE_FLAGS.intersection(flags))),
    )


def poses_markdown(sets: Mapping[str, PoseErrors]) -> str:
    """Write a row for each set, then each object whose pose is not right, the worst first."""
    rows = [_row(name, list(each.objects.values())) for name, each in sets.items() if each.objects]
    if not rows:
        return "0 poses.\n"
    headers = (
        *("set", "objects", "right", "not right, flagged", "not right, not flagged"),
        *("right, but flagged", "right about every axis"),
        *("turn of the right ones, °", "at the rim, °", "shift, mm", "size, %"),
    )
    wrong = sorted(
        (-max(error.left_mm, error.shift_mm), name, key)
        for name, each in sets.items()
        for key, error in each.objects.items()
        if not error.right
    )
    sections = [
        f"Poses. Right: turned by at most {RIGHT_DEG}° at the rim, shifted by at most {RIGHT_MM} "
        f"mm, and then {WITHIN:.0%} of the surface of every part within {RIGHT_MM} mm of where it "
        f"stood; about every axis, if no turn exceeds {RIGHT_DEG}°, that of a pen about its "
        "length included. Of the right ones the median, and the 90th percentile in brackets.",
        table(headers, rows),
    ]
    if wrong:
        listed = [
            [name, key, *_cells(sets[name].objects[key]), ", ".join(sets[name].objects[key].flags)]
            for _, name, key in wrong
        ]
        titles = (
            "set",
            "object",
            "turn, °",
            "at the rim, °",
            "shift, mm",
            "size, %",
            "left, mm",
            "flags",
        )
        sections += ["Not right:", table(titles, listed)]
    return "\n\n".join(sections) + "\n"


def _cells(error: PoseError) -> list[str]:
    shares = f"{100 * error.size_share:+.2f}"
    turns = f"{error.turn_deg:.2f}", f"{error.rim_deg:.2f}"
    return [*turns, f"{error.shift_mm:.2f}", shares, f"{error.left_mm:.2f}"]


def _row(name: str, errors: Sequence[PoseError]) -> list[str]:
    right = [error for error in errors if error.right]
    wrong = [error for error in errors if not error.right]
    flagged = sum(bool(error.flags) for error in wrong)
    figures = np.array(
        [[e.turn_deg, e.rim_deg, e.shift_mm, 100 * abs(e.size_share)] for e in right]
    )
    spread = np.quantile(figures, [0.5, 0.9], axis=0).T.tolist() if right else []
    return [
        name,
        str(len(errors)),
        f"{len(right)} ({len(right) / len(errors):.1%})",
        str(flagged),
        f"{len(wrong) - flagged} ({(len(wrong) - flagged) / len(errors):.1%})",
        str(sum(bool(error.flags) for error in right)),
        str(sum(error.turn_deg <= RIGHT_DEG for error in right)),
        *([f"{median:.2f} ({most:.2f})" for median, most in spread] or ["none"] * 4),
    ]


def _compared(captures: Path, root: Path, object_id: str) -> PoseError:
    rebuilt = open_folder(root).object(object_id)
    capture = CaptureFolder(captures).read(object_id)
    if capture.pose != "near" and rebuilt.meta.get("registration") is None:
        raise DataError(
            "expected a rebuild that found the pose, got one of meshes put in place before it (run "
            "--parts), which does not say from where"
        )
    path = captures / object_id / "truth.json"
    if not path.is_file():
        raise DataError(f"{path}: expected the truth of a simulated object, found none")
    values = json.loads(path.read_text(encoding="utf-8"))
    kinds = {part["name"]: part["material"] for part in values["parts"]}
    return pose_error(
        [part.mesh for part in capture.parts],
        [kinds[part.name] for part in capture.parts],
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
    size, registered = size_of(rebuilt), meta.get("registration")
    sized = RigidPlacement(np.eye(3), (1 - size.factor) * size.centre_cm, size.factor)
    refine = sized.followed_by(Pose.from_dict(refined)).apply
    if registered is None:
        return refine
    register = RigidPlacement.from_dict(registered).apply
    return lambda points_cm: refine(register(points_cm))


@dataclass(frozen=True, slots=True, eq=False)
class _Surface:
    """What is of one material, posed as it stood."""

    vertices_cm: Float64[np.ndarray, "v 3"]
    faces: Int64[np.ndarray, "f 3"]
    normals: Float64[np.ndarray, "f 3"]

    @classmethod
    def of(cls, meshes: Sequence[trimesh.Trimesh], stood: Callable[[Points], Points]) -> _Surface:
        together = trimesh.util.concatenate(meshes)
        assert isinstance(together, trimesh.Trimesh)
        moved = trimesh.Trimesh(stood(np.asarray(together.vertices)), together.faces, process=False)
        faces = np.asarray(moved.faces, dtype=np.int64)
        return cls(np.asarray(moved.vertices, dtype=np.float64), faces, moved.face_normals)

    def nearest(
        self, points_cm: Points
    ) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n"], Float64[np.ndarray, "n 3"]]:
        """Nearest points of the surface, how far they are, and its normals there."""
        squared, faces, nearest_cm = require("igl", "import").point_mesh_squared_distance(
            np.ascontiguousarray(points_cm), self.vertices_cm, self.faces
        )
        return np.asarray(nearest_cm), np.sqrt(squared), self.normals[faces]


def _probes_cm(mesh: trimesh.Trimesh) -> Points:
    points_cm, _ = trimesh.sample.sample_surface(mesh, PROBES, seed=1)
    return np.asarray(points_cm, dtype=np.float64)


def _placed(
    points_cm: Points, middle_cm: Vec3, turn: Rotation, shift_cm: Vec3, growth: float
) -> Points:
    """Turn and enlarge points about the object's middle, and shift them."""
    return np.asarray(growth * turn.apply(points_cm - middle_cm) + middle_cm + shift_cm)


def _least_move(
    parts: Sequence[Points], onto: Sequence[_Surface], middle_cm: Vec3, rim_cm: float
) -> Float64[np.ndarray, "7"]:
    """One step towards the surfaces: rotation vector, shift over the rim's radius, log of growth.

    Least squares of the distances along the surfaces' normals (Chen and Medioni 1992,
    doi:10.1016/0262-8856(92)90066-C), the farther ones counted linearly, over the moves that take
    points across the surfaces.
    """
    rows, off, moved = [], [], np.zeros((7, 7))
    for points_cm, surface in zip(parts, onto, strict=True):
        nearest_cm, _, normals = surface.nearest(points_cm)
        arm = (points_cm - middle_cm) / rim_cm
        rows.append(moves_across(arm, normals))
        off.append(np.einsum("ni,ni->n", nearest_cm - points_cm, normals) / rim_cm)
        moved += moves_at_all(arm)
    moves, wanted = np.concatenate(rows), np.concatenate(off)
    usual = np.median(np.abs(wanted)) + STILL
    weights = 1 / np.maximum(np.abs(wanted) / usual, 1)
    weighted = moves * weights[:, None]
    ways, felt = felt_ways(weighted.T @ moves, weights.mean() * moved)
    return np.asarray(ways @ (ways.T @ (weighted.T @ wanted) / felt))
