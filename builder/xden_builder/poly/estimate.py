"""The whole polychromatic fit of one object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float64

from xden1k.errors import DataError
from xden1k.rays import PathLengths, path_lengths
from xden1k.values.arrays import Image
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.capture import Capture
from xden_builder.fit.levenberg import Minimum
from xden_builder.poly.beam import ViewBeam, energy_groups, view_beam
from xden_builder.poly.candidates import CandidateTable, candidate_table
from xden_builder.poly.evidence import MaterialPosterior, Radiographs, weigh_materials
from xden_builder.poly.image import model_image
from xden_builder.poly.pixels import BLOCK_PX, BLOCK_RAYS, ViewPixels, choose_pixels
from xden_builder.poly.pose import coarse, posed
from xden_builder.poly.posterior import Mass, Problem, solve
from xden_builder.poly.refine import PoseFit, refine_pose
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.stand_ins import StandIns, certain, loosened, mixtures
from xden_builder.poly.start import first_choice
from xden_builder.poly.stray import coarse_binning, stray_light
from xden_builder.poly.trust import sample_sd

__all__ = ["Scene", "Seen", "Solution", "densities", "estimate", "prepare"]

SWEEPS: Final = 3
"""Rounds of densities and materials, at most."""
POSE_GROUPS: Final = 8
"""Energy groups that are enough to find outlines."""
DEFAULT: Final = PolySettings()


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """One view, its meshes in their refined pose.

    Parameters
    ----------
    view, beam
        The radiograph, and what reaches its panel.
    geometry
        In the frame of the meshes, after the pose.
    lengths
        Of one ray a pixel.
    blocks
        Of the blocks that outlines are compared in; ``lengths`` where they are not.
    smooth
        Of the coarse panel, for stray light.
    samples
        What is compared.
    noise_sd
        Behind something opaque.
    """

    view: XRayView
    beam: ViewBeam
    geometry: ViewGeometry
    lengths: PathLengths
    blocks: PathLengths
    smooth: PathLengths
    samples: ViewPixels
    noise_sd: float


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Where the fit ended.

    Parameters
    ----------
    seen
        Both views.
    pose
        None where it was not sought.
    tables, posteriors
        Candidates of each part, and how probable each is.
    problem, minimum
        The last one solved, and its solution.
    """

    seen: tuple[Seen, ...]
    pose: PoseFit | None
    tables: tuple[CandidateTable, ...]
    posteriors: tuple[MaterialPosterior, ...]
    problem: Problem
    minimum: Minimum

    @property
    def density_g_cm3(self) -> Float64[np.ndarray, "k"]:
        """Most probable density of each part."""
        return self.minimum.unknowns[: self.problem.parts]

    def image(self, number: int, lengths: PathLengths) -> Image:
        """Model image of a view: direct beam and stray light, with the gain.

        Parameters
        ----------
        number
            Of the view.
        lengths
            In the refined pose, of as many rays a pixel as are to be averaged.
        """
        seen, stand_ins = self.seen[number], self.problem.stand_ins
        return model_image(
            seen.view,
            seen.beam,
            lengths,
            seen.smooth,
            stand_ins.mac_cm2_g,
            stand_ins.scattering_cm2_g,
            self.density_g_cm3,
            self.nuisances(number),
        )

    def nuisances(self, number: int) -> Float64[np.ndarray, "4"]:
        """Gain, near scatter, far scatter and glare of a view."""
        return self.minimum.unknowns[self.problem.nuisances(number)]


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """A capture made ready: meshes in their pose, samples chosen, materials started.

    Parameters
    ----------
    seen
        Both views.
    pose
        None where it was not sought.
    tables
        Candidates of each part.
    choice
        Which candidate each part is taken for at first.
    density_g_cm3
        Shape (K,): to start from.
    """

    seen: tuple[Seen, ...]
    pose: PoseFit | None
    tables: tuple[CandidateTable, ...]
    choice: list[int]
    density_g_cm3: Float64[np.ndarray, "k"]


def estimate(
    capture: Capture,
    order: Sequence[int],
    volumes_cm3: Float64[np.ndarray, "k"],
    settings: PolySettings = DEFAULT,
) -> Solution:
    """Find densities, materials, pose, gains and stray light of one object.

    Parameters
    ----------
    capture
        With a tube or a photon energy.
    order
        Which part owns space first, see :func:`xden1k.rays.ownership_order`.
    volumes_cm3
        Shape (K,): of the space each part owns; used where the object was weighed.
    settings
        What is modelled.

    Raises
    ------
    DataError
        If the source is not known or outside the tables.
    """
    mass = None if capture.weighed_mass_g is None else Mass(capture.weighed_mass_g, volumes_cm3)
    return densities(prepare(capture, order, settings), mass, settings)


def prepare(capture: Capture, order: Sequence[int], settings: PolySettings = DEFAULT) -> Scene:
    """Do what does not depend on a weighed mass: start, pose, path lengths, samples.

    Raises
    ------
    DataError
        As :func:`estimate`.
    """
    if capture.tube is None:
        raise DataError("the polychromatic fit needs a tube or a photon energy in scanner.toml")
    meshes = [part.mesh for part in capture.parts]
    groups = energy_groups(capture.tube, capture.detector.scintillator)
    beams = [view_beam(capture, view, groups) for view in capture.views]
    tables = tuple(candidate_table(part, groups) for part in capture.parts)
    binning = coarse_binning(capture.views[0].geometry.shape)
    choice = first_choice(capture.views, meshes, order, groups, tables, binning)
    start = certain(tables, choice)
    pose = None
    density = start.mean_g_cm3
    if settings.pose:
        few = energy_groups(capture.tube, capture.detector.scintillator, POSE_GROUPS)
        pose = refine_pose(
            capture.views,
            [replace(beam, groups=few) for beam in beams],
            meshes,
            order,
            certain([candidate_table(part, few) for part in capture.parts], choice).mac_cm2_g,
            density,
        )
        density = pose.density_g_cm3
    seen = _see(capture, beams, order, pose, settings)
    return Scene(seen, pose, tables, choice, density)


def _see(
    capture: Capture,
    beams: Sequence[ViewBeam],
    order: Sequence[int],
    pose: PoseFit | None,
    settings: PolySettings,
) -> tuple[Seen, ...]:
    """Render path lengths in the refined pose and choose samples."""
    meshes = [part.mesh for part in capture.parts]
    rng = np.random.default_rng(0)
    seen = []
    for number, (view, beam) in enumerate(zip(capture.views, beams, strict=True)):
        geometry = view.geometry
        if pose is not None:
            geometry = posed(geometry, pose.pose, shifted_rows=number == 1)
        lengths = path_lengths(meshes, order, geometry)
        blocks = lengths
        if settings.blocks and min(geometry.shape) > BLOCK_PX:
            blocks = path_lengths(meshes, order, coarse(geometry, BLOCK_PX), BLOCK_RAYS)
        smooth = path_lengths(meshes, order, coarse(geometry, coarse_binning(geometry.shape)))
        samples = choose_pixels(view, lengths, blocks, beam, rng)
        noise_sd = capture.noise_sd.get(view.name, 0.0)
        seen.append(Seen(view, beam, geometry, lengths, blocks, smooth, samples, noise_sd))
    return tuple(seen)


def densities(scene: Scene, mass: Mass | None, settings: PolySettings = DEFAULT) -> Solution:
    """Fit densities, weigh materials, and again, until no part changes what it most probably is.

    At first densities may leave their materials' ranges, so that stray light and gain need not
    make up for a wrong label.
    """
    seen, tables, density = scene.seen, scene.tables, scene.density_g_cm3
    parts = len(tables)
    count = sum(len(each.samples.pixels) for each in seen)
    share = min(1.0, settings.worth_a_part * parts / max(count, 1))
    now = loosened(certain(tables, scene.choice))
    best = scene.choice
    problem = _problem(seen, now, density, share, mass, settings)
    nuisances = problem.prior.mean[parts:]
    for _ in range(SWEEPS):
        minimum = solve(problem, np.concatenate([density, nuisances]))
        nuisances = minimum.unknowns[parts:]
        posteriors, density = _weigh(problem, minimum, tables, settings)
        now = mixtures(tables, posteriors)
        problem = _problem(seen, now, density, share, mass, settings)
        chosen = [int(np.argmax(each.probability)) for each in posteriors]
        if chosen == best:
            break
        best = chosen
    minimum = solve(problem, np.concatenate([density, nuisances]))
    return Solution(seen, scene.pose, tables, posteriors, problem, minimum)


def _problem(
    seen: Sequence[Seen],
    stand_ins: StandIns,
    density: Float64[np.ndarray, "k"],
    share: float,
    mass: Mass | None,
    settings: PolySettings,
) -> Problem:
    """Work out stray light and standard deviations at some densities."""
    density = density.clip(stand_ins.low_g_cm3, stand_ins.high_g_cm3)
    strays = [
        stray_light(
            each.view,
            each.beam,
            each.smooth,
            stand_ins.mac_cm2_g,
            stand_ins.scattering_cm2_g,
            density,
            each.samples.pixels,
            each.samples.measured,
        )
        for each in seen
    ]
    sds = [
        sample_sd(
            each.samples,
            each.lengths,
            each.blocks,
            each.beam,
            stand_ins.mac_cm2_g,
            density,
            stray,
            each.noise_sd,
            settings,
        )
        for each, stray in zip(seen, strays, strict=True)
    ]
    samples = [each.samples for each in seen]
    return Problem(samples, strays, sds, share, stand_ins, mass, settings)


def _weigh(
    problem: Problem,
    minimum: Minimum,
    tables: Sequence[CandidateTable],
    settings: PolySettings,
) -> tuple[tuple[MaterialPosterior, ...], Float64[np.ndarray, "k"]]:
    """Weigh the materials part by part, each with the outcome of those before."""
    nuisances = [minimum.unknowns[problem.nuisances(n)] for n in range(len(problem.views))]
    scene = Radiographs(
        problem.views,
        problem.sds,
        [
            each[0] * (stray @ each[1:])
            for each, stray in zip(nuisances, problem.strays, strict=True)
        ],
        [float(each[0]) for each in nuisances],
        settings.evidence_share * problem.share,
    )
    density = minimum.unknowns[: problem.parts].copy()
    macs = problem.stand_ins.mac_cm2_g.copy()
    found = []
    for part, table in enumerate(tables):
        posterior = weigh_materials(scene, part, density, macs, table)
        density[part] = posterior.probability @ posterior.density_g_cm3
        weights = posterior.probability * posterior.density_g_cm3
        macs[part] = weights @ table.mac_cm2_g / weights.sum()
        found.append(posterior)
    return tuple(found), density
