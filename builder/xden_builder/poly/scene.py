"""Stage 1 of the fit: what was captured, what reaches the panels, what each part may be.

Leads to :mod:`start`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import trimesh
from jaxtyping import Int64

from xden1k.errors import DataError
from xden1k.values.arrays import Mask
from xden1k.values.views import XRayView
from xden_builder.capture import Capture, CapturePart
from xden_builder.capture.saturation import GainBounds, completed, gain_bounds
from xden_builder.capture.space import Space
from xden_builder.physics.groups import GROUPS, EnergyGroups, energy_groups
from xden_builder.poly.materials.candidates import CandidateTable, candidate_table
from xden_builder.poly.model.beam import ViewBeam, view_beam
from xden_builder.poly.model.poses import TURNED_SHIFT_SD_CM
from xden_builder.poly.model.size import SIZE_SDS
from xden_builder.poly.model.walls import Walls
from xden_builder.poly.settings import PolySettings

__all__ = ["Light", "Scene", "set_scene"]

OUTLINE_GROUPS: Final = 8
"""Energy groups that are enough to find outlines."""


@dataclass(frozen=True, slots=True, eq=False)
class Light:
    """The beam in some number of energy groups, and what the parts may do to it.

    Parameters
    ----------
    groups
        Of energy.
    beams
        Of each view.
    tables
        Candidates of each part.
    """

    groups: EnergyGroups
    beams: tuple[ViewBeam, ...]
    tables: tuple[CandidateTable, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything that is known before anything is fitted.

    Parameters
    ----------
    views
        The radiographs that are fitted; a saturated pixel has the least transmission it can have.
    turned
        By view: whether the object was turned by hand before it.
    saturated
        Shape (rows, columns) each: those pixels.
    gains
        What is known of the gain of each view where its air is saturated; None where it is not.
    parts
        Their names and labels; where they are, ``space`` tells.
    space
        What is each part's.
    light
        In as many energy groups as densities need.
    outlines
        In as few as outlines need.
    noise_sd
        Of each view, behind something opaque.
    size_sd
        Of the logarithm of the object's size over that of its meshes.
    scale_sd
        Relative, of their scale where it was found and no two views tell how far away the object
        was; 0 elsewhere.
    walls
        How far ways through the parts may be off.
    """

    views: tuple[XRayView, ...]
    turned: tuple[bool, ...]
    saturated: tuple[Mask, ...]
    gains: tuple[GainBounds | None, ...]
    parts: tuple[CapturePart, ...]
    space: Space
    light: Light
    outlines: Light
    noise_sd: tuple[float, ...]
    size_sd: float
    scale_sd: float
    walls: Walls

    def moved(self, move: Callable[[trimesh.Trimesh], trimesh.Trimesh]) -> Scene:
        """Give the object another place or size."""
        return replace(self, space=self.space.moved(move))

    @property
    def batches(self) -> Int64[np.ndarray, "k"]:
        """Number the parts by label: those of one label are of one batch of material.

        Where surfaces may be off, each part has its own: what its ways are off is told by nothing
        else.
        """
        if self.walls.way_sd.any():
            return np.arange(len(self.parts))
        labels = [part.material or f"{number}" for number, part in enumerate(self.parts)]
        return np.asarray(np.unique(labels, return_inverse=True)[1], dtype=np.int64)


def set_scene(capture: Capture, space: Space, settings: PolySettings) -> Scene:
    """Work out beams and candidates of a capture.

    Parameters
    ----------
    capture
        With a tube or a photon energy.
    space
        What is each part's.
    settings
        What stands in the beam beside the told filters, and how far compositions may differ.

    Raises
    ------
    DataError
        If the source is not known or outside the tables.
    """
    if capture.tube is None:
        raise DataError("the polychromatic fit needs a tube or a photon energy in scanner.toml")
    views = capture.fitted_views
    tube = capture.tube.behind("Cu", settings.extra_filter_mm_cu / 10)
    fine, few = (energy_groups(tube, capture.detector, count) for count in (GROUPS, OUTLINE_GROUPS))
    beams = tuple(view_beam(capture, view, fine) for view in views)
    few_beams = tuple(beam.regrouped(few) for beam in beams)
    tables, few_tables = (
        tuple(candidate_table(part, groups, settings.composition) for part in capture.parts)
        for groups in (fine, few)
    )
    walls = Walls.of(space.regions, _standing(capture), capture.mesh_sd_cm)
    if capture.mesh_sd_cm:
        pairs = zip(tables, walls.way_sd.tolist(), strict=True)
        tables = tuple(table.with_ways(way_sd) for table, way_sd in pairs)
    limits = [capture.at_least.get(view.name) for view in views]
    whole = [completed(view, each) for view, each in zip(views, limits, strict=True)]
    return Scene(
        tuple(view for view, _ in whole),
        tuple(view.name in capture.turned for view in views),
        tuple(mask for _, mask in whole),
        tuple(gain_bounds(view, each) for view, each in zip(views, limits, strict=True)),
        capture.parts,
        space,
        Light(fine, beams, tables),
        Light(few, few_beams, few_tables),
        tuple(capture.noise_sd.get(view.name, 0.0) for view in views),
        SIZE_SDS[capture.mesh_scale],
        _scale_sd(capture),
        walls,
    )


def _standing(capture: Capture) -> list[XRayView]:
    """Give the views of the object as it was told to lie, not turned by hand."""
    return [view for view in capture.fitted_views if view.name not in capture.turned]


def _scale_sd(capture: Capture) -> float:
    """Relative standard deviation of a scale that each view tells as well as its distance.

    Of parts in the scanner's frame. Across the beam of either of two views it shows how far from
    the other's source the object was, as exactly as it was put back when it was turned.
    """
    views = capture.fitted_views
    if not capture.scale_sought or len(views) - len(capture.turned) > 1:
        return 0.0
    middle = np.mean([part.mesh.bounds.mean(axis=0) for part in capture.parts], axis=0)
    sources = [view.geometry.source_cm for view in views]
    away_cm = [np.inf if each is None else float(np.linalg.norm(each - middle)) for each in sources]
    return float(TURNED_SHIFT_SD_CM / np.linalg.norm(np.array(away_cm)))
