"""Phantoms as dataset objects: the simulator's truth, never a reconstruction."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from xden1k import __version__
from xden1k.documents.maintainer import Answers
from xden1k.folder import write_rows
from xden1k.format.manifest import Manifest
from xden1k.format.records import object_row
from xden1k.format.shards import Row
from xden1k.rays import THINNER_THAN_LABELS, object_grids
from xden1k.values.physics import apparent_density_g_cm3
from xden1k.values.types import DensityObject, Part, Split
from xden_builder.phantoms.phantom import Phantom, PhantomPart, Plan, make_phantom, plan_objects
from xden_builder.phantoms.posing import AS_SCANNED, Posing, posed
from xden_builder.phantoms.realism import TIDY, Realism
from xden_builder.phantoms.scanner import VIEWS, Scanner
from xden_builder.phantoms.writer import (
    NOTHING,
    Progress,
    each_object,
    make_scanner,
    simulation,
)

__all__ = ["TruthMaker", "truth_object", "write_truth_dataset", "write_truth_rows"]

BUILDER = f"xden-build phantoms {__version__}"
DATA_VERSION = "0.1.0"


def write_truth_dataset(
    out: Path,
    count: int,
    seed: int,
    *,
    size: int | None = None,
    ideal: bool = False,
    scanner: Scanner | None = None,
    realism: Realism = TIDY,
    posing: Posing = AS_SCANNED,
    workers: int = 1,
    progress: Progress = lambda _: None,
    categories: Sequence[str] = (),
    split: Split | None = None,
    unseen: Sequence[str] = (),
) -> Manifest:
    """Write phantoms as a dataset folder whose densities are the simulator's own.

    The objects and radiographs are those :func:`xden_builder.phantoms.writer.write_captures` makes
    of the same arguments. The folder appears complete or not at all.

    Parameters
    ----------
    out
        The dataset folder; an older one is replaced as a whole, but keeps its maintainer's answers.
    count, seed, size, ideal, scanner, realism, posing, workers, progress, categories, split, unseen
        As there. Everything is in the scanner's frame.

    Raises
    ------
    DataError
        If an argument is out of range, or ``out`` is something else than a dataset folder.
    """
    answers = Answers.of_folder(out)
    maker = TruthMaker(seed, make_scanner(size, ideal, scanner), realism, posing, tuple(unseen))
    plans = plan_objects(count, seed, categories, split, unseen)
    plans = sorted(plans, key=lambda plan: plan.object_id)
    return write_truth_rows(each_object(maker.row, plans, workers, progress), out, maker, answers)


def write_truth_rows(
    rows: Iterable[Row], out: Path, maker: TruthMaker, answers: Answers
) -> Manifest:
    """Write what a maker made, in ascending order of ids, as a dataset folder."""
    return write_rows(
        rows,
        out,
        version=DATA_VERSION,
        builder=BUILDER,
        config_sha256=maker.digest,
        answers=answers,
    )


@dataclass(frozen=True, slots=True, eq=False)
class TruthMaker:
    """Makes the rows of one set of phantoms, each from its id.

    Parameters
    ----------
    seed
        Of the set.
    scanner, realism, posing
        As :func:`xden_builder.phantoms.writer.write_captures` has them.
    unseen
        Categories of the split ``unseen``.
    """

    seed: int
    scanner: Scanner
    realism: Realism
    posing: Posing
    unseen: tuple[str, ...] = ()

    def row(self, object_id: str) -> Row:
        """Make the encoded row of one object."""
        phantom = make_phantom(Plan.of(self.seed, object_id, self.unseen), self.realism)
        return object_row(truth_object(posed(phantom, self.scanner, self.posing), self.scanner))

    @property
    def digest(self) -> str:
        """Checksum of all settings."""
        values = simulation(self.seed, self.scanner, self.realism, self.posing)
        told = values | ({"unseen": sorted(self.unseen)} if self.unseen else {})
        return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def truth_object(
    phantom: Phantom,
    scanner: Scanner,
    *,
    builder: str = BUILDER,
    told: Mapping[str, Any] = NOTHING,
) -> DensityObject:
    """Give the dataset object of a phantom: simulated radiographs, true densities.

    Attenuation coefficients are those at the scanner's reference energy; apparent densities follow
    from them by the paper's rule, as they would for a perfect fit.

    Parameters
    ----------
    phantom, scanner
        What, and by what it is taken.
    builder
        Name and version of the command.
    told
        What else its ``meta`` says.

    Raises
    ------
    DataError
        If the object is too large for the scanner.
    """
    setting, scanner = scanner.setting_for(phantom)
    meshes = [part.mesh for part in phantom.parts]
    grids = object_grids(meshes, range(len(meshes)))
    parts = tuple(
        _part(part, lac_per_cm, thin)
        for part, lac_per_cm, thin in zip(
            phantom.parts, scanner.lac_per_cm(phantom).tolist(), grids.thin(meshes), strict=True
        )
    )
    return DensityObject(
        object_id=phantom.plan.object_id,
        category=phantom.plan.kind,
        split=phantom.plan.split,
        source="phantom",
        views=(scanner.corrected(phantom, "pa"), scanner.corrected(phantom, "lat")),
        parts=parts,
        labels=grids.labels,
        occupancy=grids.occupancy,
        envelope=grids.envelope,
        density=grids.density([part.density_g_cm3 for part in parts]),
        apparent_density=grids.density([part.apparent_density_g_cm3 for part in parts]),
        origin_cm=grids.field.origin_cm,
        voxel_size_cm=grids.field.voxel_size_cm,
        flags=() if grids.labels.any() else (THINNER_THAN_LABELS,),
        meta={
            "builder": builder,
            **told,
            "seed": phantom.plan.seed,
            "setting": setting,
            "scanner": scanner.settings(),
            "fit": {
                "solver": "none: the simulator's truth",
                "gain": {view: scanner.exposure(phantom.plan, view) for view in VIEWS},
            },
        },
    )


def _part(part: PhantomPart, lac_per_cm: float, thin: bool) -> Part:
    return Part(
        name=part.name,
        mesh=part.mesh,
        material=part.material,
        lac_per_cm=lac_per_cm,
        apparent_density_g_cm3=apparent_density_g_cm3(lac_per_cm),
        density_g_cm3=part.density_g_cm3,
        density_sd_g_cm3=0.0,
        density_source="truth",
        flags=(THINNER_THAN_LABELS,) if thin else (),
        color_rgb=part.color_rgb,
    )
