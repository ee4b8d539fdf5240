"""Which objects are tried: examined in a drawn order until each stratum is full."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
import trimesh

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.format.records import decode_array, split_meshes
from xden1k.format.shards import Row
from xden1k.values.mass import MassProperties, mass_of_meshes
from xden_bench.manip.closed_forms import weight_n
from xden_bench.manip.draws import Draw, draw_of, keyed_generator
from xden_bench.manip.graspnet import read_graspnet
from xden_bench.manip.grasps import Grasps
from xden_bench.manip.hulls import contact_error_cm, hulls_of, volume_error
from xden_bench.manip.item import STRATA, Item, Stratum
from xden_bench.manip.protocol import ManipProtocol, Tier
from xden_bench.manip.rest import Rest, rest_of
from xden_bench.manip.sampler import antipodal_grasps, usable
from xden_bench.manip.shape import Shape, shape_of
from xden_bench.scoring.metrics import integrate

__all__ = ["RULES", "Chosen", "Examiner", "choose"]

RULES: Final = {
    "heavy": "weighs more than the protocol's limit, or than the weakest regime holds with ease",
    "between": "centre of mass neither off nor balanced",
    "wide": "wider than the gripper in every direction",
    "hulls": "volume of the hulls too far from that inside the outer surface",
    "restless": "never at rest on the table",
    "few grasps": "too few candidates whose contacts the hulls have",
}
"""Why an object is taken out, in the order in which is asked."""
COLUMNS: Final = (
    *("category", "mass_g", "part_names", "part_density_g_cm3", "mesh_vertices", "mesh_faces"),
    *("face_part", "envelope", "grid_origin_cm", "voxel_size_cm"),
)


class TakenOut(Exception):
    """An object that a rule takes out; the argument is the rule's name."""


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """What is cheap to know of an object.

    Parameters
    ----------
    object_id
        Which.
    row
        Of the dataset.
    stratum
        Where it belongs.
    shape, mass
        Its outer surface, and its true mass properties.
    """

    object_id: str
    row: Row
    stratum: Stratum
    shape: Shape
    mass: MassProperties


@dataclass(frozen=True, slots=True)
class Chosen:
    """The objects that are tried, and those that are not.

    Parameters
    ----------
    items
        By stratum, then in the order in which they were drawn.
    taken_out
        By rule: ids of the objects that were examined.
    not_needed
        How many were not examined to the end, because their stratum was full.
    """

    items: tuple[Item, ...]
    taken_out: Mapping[str, tuple[str, ...]]
    not_needed: int


@dataclass(frozen=True, slots=True)
class Examiner:
    """Looks at objects one by one.

    Parameters
    ----------
    folder
        The dataset.
    rules
        The protocol.
    draws
        Trials of each object in each regime.
    cache
        Folder in which hulls are kept.
    grasps
        Folder with grasps of another detector, ``ID.npz`` each; None samples them here.
    """

    folder: DatasetFolder
    rules: ManipProtocol
    draws: int
    cache: Path
    grasps: Path | None = None

    def outline(self, object_id: str) -> Outline:
        """Say what is cheap to say.

        Raises
        ------
        TakenOut
            By the rules ``heavy``, ``between`` and ``wide``.
        DataError
            If a density is unknown.
        """
        rules, row = self.rules, self.folder.row(object_id, COLUMNS)
        densities = row["part_density_g_cm3"]
        if row["mass_g"] is None or any(one is None or np.isnan(one) for one in densities):
            raise DataError(f"{object_id}: expected the density of every part, one is unknown")
        if row["mass_g"] > rules.objects.max_mass_g or (
            weight_n(row["mass_g"]) > rules.max_best_weight_n
        ):
            raise TakenOut("heavy")
        meshes = split_meshes(row)
        shape, mass = shape_of(meshes), mass_of_meshes(meshes, densities)
        stratum = self._stratum(shape.along_cm(mass.com_cm))
        if shape.thickness_cm > rules.objects.max_width_cm:
            raise TakenOut("wide")
        return Outline(object_id, row, stratum, shape, mass)

    def _stratum(self, along_cm: float) -> Stratum:
        if abs(along_cm) > self.rules.objects.off_cm:
            return "off"
        if abs(along_cm) < self.rules.objects.balanced_cm:
            return "balanced"
        raise TakenOut("between")

    def item(self, outline: Outline) -> Item:
        """Make an object ready to be tried.

        Raises
        ------
        TakenOut
            By the rules ``hulls``, ``restless`` and ``few grasps``.
        DataError
            If its grasps of another detector are missing or bad.
        """
        rules, object_id = self.rules, outline.object_id
        shape, mass = outline.shape, outline.mass
        hulls = hulls_of(shape.surface, rules.hulls, self.cache)
        if volume_error(hulls, shape.volume_cm3) > rules.hulls.max_volume_error:
            raise TakenOut("hulls")
        rest = rest_of(hulls, mass, rules, keyed_generator(rules.seed, object_id, "rest"))
        if not rest.is_calm(rules.rest):
            raise TakenOut("restless")
        grasps = self._grasps(object_id, shape.surface, rest)
        tips = rest.pose.to_body(grasps.tips_cm.reshape(-1, 3))
        errors = contact_error_cm(hulls, tips).reshape(2, -1).max(axis=0)
        grasps = grasps[errors <= rules.hulls.max_contact_error_cm]
        if len(grasps) < rules.objects.min_candidates:
            raise TakenOut("few grasps")
        return Item(
            object_id,
            outline.row["category"],
            outline.stratum,
            mass,
            _homogeneous(shape.surface, mass.mass_g),
            _centroid_cm(outline.row),
            shape.long_axis,
            hulls,
            rest.pose,
            grasps,
            {name: self._draws(object_id, name, mass.mass_g) for name in rules.regimes},
        )

    def _grasps(self, object_id: str, surface: trimesh.Trimesh, rest: Rest) -> Grasps:
        rules = self.rules
        resting = trimesh.Trimesh(
            rest.pose.to_world(np.asarray(surface.vertices)), surface.faces, process=False
        )
        generator = keyed_generator(rules.seed, object_id, "grasps")
        if self.grasps is None:
            return antipodal_grasps(resting, rules.grasps, rules.gripper, generator)
        found = read_graspnet(self.grasps / f"{object_id}.npz", surface).moved(rest.pose)
        points, _ = trimesh.sample.sample_surface(
            resting, rules.grasps.collision_points, seed=generator
        )
        return usable(found, np.asarray(points), rules.grasps, rules.gripper)

    def _draws(self, object_id: str, regime: str, mass_g: float) -> tuple[Draw, ...]:
        rules = self.rules
        return tuple(
            draw_of(
                rules.regimes[regime],
                rules.trial.shake_rad,
                mass_g,
                rules.trial.max_load,
                (rules.seed, object_id, regime, number),
            )
            for number in range(self.draws)
        )


def _homogeneous(surface: trimesh.Trimesh, mass_g: float) -> MassProperties:
    return mass_of_meshes([surface], [mass_g / float(surface.volume)])


def _centroid_cm(row: Row) -> np.ndarray:
    """Where the scorer puts the centre of a prediction without mass."""
    envelope, origin = decode_array(row, "envelope"), np.array(row["grid_origin_cm"])
    return integrate(0 * envelope, envelope, origin, row["voxel_size_cm"]).com_cm


@dataclass(slots=True)
class _Choice:
    """A choice under way."""

    examiner: Examiner
    tier: Tier
    items: dict[Stratum, list[Item]] = field(
        default_factory=lambda: {stratum: [] for stratum in STRATA}
    )
    taken_out: dict[str, list[str]] = field(default_factory=lambda: {rule: [] for rule in RULES})
    waiting: list[str] = field(default_factory=list)
    """Of a category that their stratum has already."""
    not_needed: int = 0

    def is_full(self, stratum: Stratum) -> bool:
        wanted: int = getattr(self.tier, stratum)
        return len(self.items[stratum]) >= wanted

    def look(self, object_id: str, *, again: bool) -> None:
        """Take an object in, or out, or let it wait."""
        if all(map(self.is_full, STRATA)):
            self.not_needed += 1
            return
        try:
            found = self.examiner.outline(object_id)
            chosen = self.items[found.stratum]
            if self.is_full(found.stratum):
                self.not_needed += 1
            elif not again and found.row["category"] in {one.category for one in chosen}:
                self.waiting.append(object_id)
            else:
                chosen.append(self.examiner.item(found))
        except TakenOut as rule:
            self.taken_out[str(rule)].append(object_id)


def choose(
    ids: Sequence[str],
    examiner: Examiner,
    tier: Tier,
    progress: Callable[[Sequence[str]], Iterable[str]] = iter,
) -> Chosen:
    """Choose the objects of a tier, no two of one category in a stratum where it can be helped.

    Parameters
    ----------
    ids
        Of the split.
    examiner
        Looks at them.
    tier
        How many of each stratum.
    progress
        Goes through ids.

    Raises
    ------
    DataError
        If a stratum stays empty, or an object cannot be read.
    """
    seed = examiner.rules.seed
    drawn = sorted(ids, key=lambda one: (keyed_generator(seed, "order", one).random(), one))
    choice = _Choice(examiner, tier)
    for object_id in progress(drawn):
        choice.look(object_id, again=False)
    for object_id in progress(choice.waiting):
        choice.look(object_id, again=True)
    if empty := [stratum for stratum in STRATA if not choice.items[stratum]]:
        counts = {rule: len(out) for rule, out in choice.taken_out.items()}
        raise DataError(
            f"no object of the stratum {empty[0]!r} among {len(ids)}: {counts} taken out"
        )
    return Chosen(
        tuple(item for stratum in STRATA for item in choice.items[stratum]),
        {rule: tuple(sorted(out)) for rule, out in choice.taken_out.items()},
        choice.not_needed,
    )
