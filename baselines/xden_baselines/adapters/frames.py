"""From a run's frame to the object's: similarity transforms, given or from bounding boxes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from xden1k.access.samples import SampleView
from xden1k.errors import DataError, about
from xden1k.values.arrays import Points, Vec3
from xden_baselines.adapters.cloud import Cloud
from xden_baselines.adapters.files import numbers, read_json

__all__ = ["Frame", "Frames", "Similarity", "dataparser"]

Frame = Literal["m", "cm", "box"]
"""The object's frame in metres or centimetres, or one that shares its axes and its box."""
TOLERANCE = 1e-3
"""A rotation from a file is rounded."""


@dataclass(frozen=True, slots=True, eq=False)
class Similarity:
    """A rotation, one scale for all axes, and a translation.

    Parameters
    ----------
    matrix
        Shape (4, 4): takes points of the one frame to the other.

    Raises
    ------
    DataError
        If it shears, mirrors, or is no such matrix.

    Examples
    --------
    >>> metres = Similarity.made(100.0)
    >>> metres(np.array([[0.01, 0.0, 0.0]])).tolist(), metres.scale
    ([[1.0, 0.0, 0.0]], 100.0)
    """

    matrix: Float[np.ndarray, "4 4"]

    def __post_init__(self) -> None:
        linear, scale = self.matrix[:3, :3], self.scale
        fits = (
            np.isfinite(self.matrix).all()
            and scale > 0
            and np.allclose(linear @ linear.T, scale**2 * np.eye(3), atol=TOLERANCE * scale**2)
            and np.linalg.det(linear) > 0
            and np.allclose(self.matrix[3], [0, 0, 0, 1])
        )
        if not fits:
            raise DataError(
                "expected a rotation, one positive scale and a translation as a 4 by 4 matrix, "
                f"got {np.round(self.matrix, 4).tolist()}"
            )

    def __call__(self, points: Points) -> Points:
        """Take points to the other frame."""
        return np.asarray(points @ self.matrix[:3, :3].T + self.matrix[:3, 3])

    @property
    def scale(self) -> float:
        """Length in the other frame of what has length 1 in the first."""
        return float(np.sqrt((self.matrix[:3, :3] ** 2).sum() / 3))

    @property
    def inverse(self) -> Similarity:
        """The way back."""
        return Similarity(np.linalg.inv(self.matrix))

    @classmethod
    def made(
        cls,
        scale: float,
        rotation: Float[np.ndarray, "3 3"] | None = None,
        translation: Vec3 | None = None,
    ) -> Similarity:
        """Put one together: x -> scale · rotation · x + translation."""
        matrix = np.eye(4)
        matrix[:3, :3] = scale * (np.eye(3) if rotation is None else rotation)
        matrix[:3, 3] = 0 if translation is None else translation
        return cls(matrix)


def dataparser(path: Path) -> Similarity:
    """Read ``dataparser_transforms.json``: from the scene's frame to the reconstruction's.

    p -> s (R p + t), of the 3 by 4 matrix [R|t] ``transform`` and s, ``scale``.

    Raises
    ------
    DataError
        If the file is missing or holds no such transform.
    """
    found = read_json(path)
    transform = numbers(found.get("transform"), (3, 4), f"{path}: transform")
    scale = float(numbers(found.get("scale"), (), f"{path}: scale"))
    try:
        return Similarity.made(scale, transform[:, :3], scale * transform[:, 3])
    except DataError as err:
        raise DataError(f"{path}: {err}") from err


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Where the objects of a run lie.

    Parameters
    ----------
    default
        Of objects without an entry; None = each must have one.
    entries
        By object id: ``similarity``, a 4 by 4 matrix from the run's frame to the object's in cm, or
        ``scale``, ``rotation`` and ``translation_cm``; and ``run``, what the run calls the object.
        Either may be missing.
    where
        The file they are from.
    """

    default: Frame | None
    entries: Mapping[str, Any]
    where: str = "transforms"

    @classmethod
    def read(cls, default: Frame | None, path: Path | None) -> Frames:
        """Read the entries from a JSON file, if one is named.

        Raises
        ------
        DataError
            If the file is not of this form.
        """
        entries = {} if path is None else read_json(path)
        if strange := sorted(key for key, one in entries.items() if not isinstance(one, dict)):
            raise DataError(f"{path}: {strange[0]}: expected a JSON object for each object id")
        return cls(default, entries, str(path) if path else "transforms")

    def run_name(self, object_id: str) -> str:
        """Return what the run calls an object.

        Raises
        ------
        DataError
            If that could be a path out of the run's folder.
        """
        name = self.entries.get(object_id, {}).get("run", object_id)
        if not isinstance(name, str) or not name or name != Path(name).name or name == "..":
            raise DataError(f"{self.where}: {object_id}: run must be a plain name, got {name!r}")
        return name

    def similarity(self, cloud: Cloud, sample: SampleView) -> Similarity:
        """Return the way from the run's frame to the object's, cm.

        Raises
        ------
        DataError
            If neither the entries nor the default say, or there is no box.
        """
        entry = dict(self.entries.get(sample.object_id, {}))
        entry.pop("run", None)
        if entry:
            return self._given(sample.object_id, entry)
        if self.default is None:
            raise DataError(
                f"{sample.object_id}: nothing says where the run has it: name its --frame or its "
                "place in --transforms"
            )
        if self.default == "box":
            with about(sample.object_id):
                return _between(cloud.bounds, np.asarray(sample.outer_mesh.bounds))
        return Similarity.made(100.0 if self.default == "m" else 1.0)

    def _given(self, object_id: str, entry: Mapping[str, Any]) -> Similarity:
        where = f"{self.where}: {object_id}"
        try:
            if set(entry) == {"similarity"}:
                return Similarity(numbers(entry["similarity"], (4, 4), "similarity"))
            if set(entry) == {"scale", "rotation", "translation_cm"}:
                return Similarity.made(
                    float(numbers(entry["scale"], (), "scale")),
                    numbers(entry["rotation"], (3, 3), "rotation"),
                    numbers(entry["translation_cm"], (3,), "translation_cm"),
                )
        except DataError as err:
            raise DataError(f"{where}: {err}") from err
        raise DataError(
            f"{where}: expected similarity, or scale, rotation and translation_cm, "
            f"got {sorted(entry)}"
        )


def _between(source: Float[np.ndarray, "2 3"], target_cm: Float[np.ndarray, "2 3"]) -> Similarity:
    """Centre to centre, longest side to longest side."""
    if not np.ptp(source, axis=0).max() > 0:
        raise DataError("all points are one, so there is no box around them")
    scale = float(np.ptp(target_cm, axis=0).max() / np.ptp(source, axis=0).max())
    return Similarity.made(scale, None, target_cm.mean(axis=0) - scale * source.mean(axis=0))
