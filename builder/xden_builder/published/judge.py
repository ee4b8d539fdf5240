"""How near an imported twin came to its truth: the tables of the manual.

``python -m xden_builder.published.judge RELEASE IMPORTED`` prints them, and the worst objects.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float64
from tabulate import tabulate

from xden1k.folder import open_folder
from xden1k.values.types import DensityObject, Part
from xden_builder.published.register import UPRIGHT
from xden_builder.published.twin import truth_path

__all__ = ["ObjectJudged", "PartJudged", "judge", "judged_table"]

LIKE: Final = 0.004
"""Share by which the coefficient of a part may be off its own in the truth."""
SAME: Final = 0.1
"""Share by which its volume may be."""
FAR: Final = 0.2
CENTRE: Final = 0.5
"""Of a voxel whose index the truth tells, where the import's voxel i is from i to i + 1."""
DOUBTS: Final = frozenset({"uncertain", "material_ambiguous"})
WORST: Final = 12


@dataclass(frozen=True, slots=True)
class PartJudged:
    """One part beside its truth.

    Parameters
    ----------
    name, material
        In the import, and truly.
    density_g_cm3, sd_g_cm3, true_g_cm3
        Imported, and true.
    flags
        Of the import.
    """

    name: str
    material: str
    density_g_cm3: float
    sd_g_cm3: float
    true_g_cm3: float
    flags: tuple[str, ...]

    @property
    def error(self) -> float:
        """Relative."""
        return self.density_g_cm3 / self.true_g_cm3 - 1

    @property
    def off_sd(self) -> float:
        """In standard deviations."""
        return (self.density_g_cm3 - self.true_g_cm3) / self.sd_g_cm3

    @property
    def silent(self) -> bool:
        """Whether it is far off and no flag says that it may be."""
        return abs(self.error) > FAR and not DOUBTS & set(self.flags)


@dataclass(frozen=True, slots=True)
class ObjectJudged:
    """One object beside its truth; all but the last are ratios less 1, or shares.

    Parameters
    ----------
    object_id, category
        As in the dataset.
    placed
        Root mean square error of the registration over the corners of the box, of its longest side.
    six_side, overlap
        Of the registration.
    volume, own_mass, published_mass, mass
        Of the volume of all parts; of the mass by LAC / 0.17 against the file's own, and against
        the truth; of our mass.
    off_sd
        Of our mass, in standard deviations.
    parts
        That have one truth.
    """

    object_id: str
    category: str
    placed: float
    six_side: float
    overlap: float
    volume: float
    own_mass: float
    published_mass: float
    mass: float
    off_sd: float
    parts: tuple[PartJudged, ...]


def judge(release: Path, imported: Path) -> list[ObjectJudged]:
    """Compare every object of an imported twin with the truth beside the release."""
    truth = json.loads(truth_path(release).read_text(encoding="utf-8"))["objects"]
    folder = open_folder(imported)
    return [
        _judged(made, truth[made.meta["published"]["id"]])
        for made in map(folder.object, folder.ids())
    ]


def _judged(made: DensityObject, truth: dict[str, Any]) -> ObjectJudged:
    volumes = np.array([part.mesh.volume for part in made.parts])
    published = volumes @ [part.apparent_density_g_cm3 for part in made.parts]
    ours = volumes @ [part.density_g_cm3 for part in made.parts]
    true_cm3 = sum(part["volume_cm3"] for part in truth["parts"])
    place = made.meta["registration"]
    pairs = ((part, _truth_of(part, truth["parts"])) for part in made.parts)
    return ObjectJudged(
        object_id=made.object_id,
        category=made.category,
        placed=_placed(place, truth),
        six_side=place["six_side"],
        overlap=place["iou"],
        volume=float(volumes.sum() / true_cm3 - 1),
        own_mass=float(published / truth["apparent_mass_g"] - 1),
        published_mass=float(published / truth["mass_g"] - 1),
        mass=float(ours / truth["mass_g"] - 1),
        off_sd=float((ours - truth["mass_g"]) / made.meta["uncertainty"]["mass_sd_g"]),
        parts=tuple(_part(part, *true) for part, true in pairs if true is not None),
    )


def _placed(place: dict[str, Any], truth: dict[str, Any]) -> float:
    """How far corners of the true box are apart, by the volume's place and by the mesh's."""
    extents_cm = np.array(truth["extents_cm"])
    to_mesh, to_voxels = (np.array(truth[name]) for name in ("mesh_matrix", "volume_matrix"))
    half = extents_cm * np.cbrt(np.linalg.det(to_mesh[:3, :3])) / 2
    corners = np.array(np.meshgrid(*np.stack([-half, half], axis=1))).reshape(3, -1).T
    indices = _moved(to_voxels, _moved(np.linalg.inv(to_mesh), corners))
    by_mesh = place["cm_per_unit"] * corners @ UPRIGHT.T
    by_volume = _moved(np.array(place["volume_to_object_cm"]), indices + CENTRE)
    apart = np.sqrt(((by_mesh - by_volume) ** 2).sum(axis=1).mean())
    return float(apart / extents_cm.max())


def _moved(
    matrix: Float64[np.ndarray, "4 4"], points: Float64[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n 3"]:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def _truth_of(part: Part, true: Sequence[dict[str, Any]]) -> tuple[str, float] | None:
    """Material and density of the true parts of a coefficient, of which voxels make one."""
    lac = part.lac_per_cm
    alike = [one for one in true if abs(one["lac_per_cm"] - lac) <= LIKE * lac]
    if not alike:
        return None
    near = min(alike, key=lambda one: abs(one["volume_cm3"] - part.mesh.volume))
    if abs(near["volume_cm3"] - part.mesh.volume) < SAME * part.mesh.volume:
        return near["material"], near["density_g_cm3"]
    whole = sum(one["volume_cm3"] for one in alike)
    mean = sum(one["volume_cm3"] * one["density_g_cm3"] for one in alike) / whole
    return near["material"], mean


def _part(part: Part, material: str, true_g_cm3: float) -> PartJudged:
    density, sd = part.density_g_cm3, part.density_sd_g_cm3
    return PartJudged(part.name, material, density, sd, true_g_cm3, part.flags)


def judged_table(judged: Sequence[ObjectJudged]) -> str:
    """Text of the figures, and of the objects whose masses are worst."""
    parts = [part for one in judged for part in one.parts]
    far = [part for part in parts if abs(part.error) > FAR]
    rows = [
        ("registration error, median and p90, %", _quantiles(judged, "placed", 0.5, 0.9)),
        ("six-side agreement, p5 and median", _quantiles(judged, "six_side", 0.05, 0.5, percent=1)),
        ("overlap, p10 and median", _quantiles(judged, "overlap", 0.1, 0.5, percent=1)),
        ("volume, median and p90, %", _quantiles(judged, "volume", 0.5, 0.9)),
        ("LAC / 0.17 against the file's own, %", _quantiles(judged, "own_mass", 0.5, 0.9)),
        ("mass by LAC / 0.17, mean and median, %", _mean_and_median(judged, "published_mass")),
        ("mass by ours, mean and median, %", _mean_and_median(judged, "mass")),
        ("masses within 1 and 2 sd, %", _within([one.off_sd for one in judged])),
        ("parts within 1 and 2 sd, %", _within([part.off_sd for part in parts])),
        ("parts off by over 20 %, of all", f"{len(far)} of {len(parts)}"),
        ("of these without a flag", str(sum(part.silent for part in far))),
        ("parts with such a flag", str(sum(bool(DOUBTS & set(part.flags)) for part in parts))),
    ]
    worst = sorted(judged, key=lambda one: -abs(one.mass))[:WORST]
    return f"{len(judged)} objects\n{tabulate(rows)}\n\n" + "\n".join(map(_line, worst))


def _values(judged: Sequence[ObjectJudged], name: str) -> Float64[np.ndarray, "n"]:
    return np.abs([getattr(one, name) for one in judged])


def _quantiles(
    judged: Sequence[ObjectJudged], name: str, *shares: float, percent: float = 100
) -> str:
    return "  ".join(f"{percent * x:.3g}" for x in np.quantile(_values(judged, name), shares))


def _mean_and_median(judged: Sequence[ObjectJudged], name: str) -> str:
    values = 100 * _values(judged, name)
    return f"{values.mean():.3g}  {np.median(values):.3g}"


def _within(off_sd: Sequence[float]) -> str:
    off = np.abs(off_sd)
    return f"{100 * (off < 1).mean():.0f}  {100 * (off < 2).mean():.0f}"


def _line(one: ObjectJudged) -> str:
    parts = (
        f"{part.name or part.material}: {part.density_g_cm3:.2f} ± {part.sd_g_cm3:.2f}, "
        f"{part.material} {part.true_g_cm3:.2f}"
        for part in one.parts
        if abs(part.error) > FAR
    )
    return (
        f"{one.object_id} {one.category} {one.mass:+.0%} {one.off_sd:+.1f} sd; {'; '.join(parts)}"
    )


if __name__ == "__main__":
    print(judged_table(judge(*map(Path, sys.argv[1:]))))  # noqa: T201
