"""Ways to densities that are compared, and what each is allowed to know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Final, Literal, get_args

import numpy as np
import trimesh
from jaxtyping import Float64

from xden1k.rays import path_lengths
from xden1k.values.materials import families, load_materials
from xden1k.values.physics import apparent_density_g_cm3
from xden_builder.capture import Capture, CapturePart
from xden_builder.capture.space import Space
from xden_builder.evaluate.truth import Errors, Truth, errors_of
from xden_builder.fit import fit_lac_adam
from xden_builder.poly.judgement import PolyFit
from xden_builder.poly.line import fit_samples, sampled, with_mass
from xden_builder.poly.materials.candidates import candidates
from xden_builder.poly.settings import PolySettings

__all__ = [
    "ABLATIONS",
    "MODES",
    "Ablation",
    "Mode",
    "errors_of_fit",
    "nominal",
    "paper",
    "poly",
    "scaled",
    "told",
]

Mode = Literal["labels", "families", "blind"]
MODES: Final[tuple[Mode, ...]] = get_args(Mode)
Densities = Float64[np.ndarray, "k"]


@dataclass(frozen=True, slots=True)
class Ablation:
    """The fit without one of its parts, or told something wrong.

    Parameters
    ----------
    settings
        Of the fit.
    copper_cm
        Filter that the fit believes in and that is not there.
    exposure
        Factor on both radiographs.
    shared
        Whether it is told what the labels of a whole folder say of filter and errors. They say it
        of the whole fit: one that leaves something out errs farther.
    """

    settings: PolySettings = field(default_factory=PolySettings)
    copper_cm: float = 0.0
    exposure: float = 1.0
    shared: bool = False

    def applied(self, capture: Capture) -> Capture:
        """Return the capture as the fit is told it."""
        assert capture.tube is not None
        filters = dict(capture.tube.filtration_cm)
        if self.copper_cm:
            filters["Cu"] = filters.get("Cu", 0.0) + self.copper_cm
        pa, lat, *further = (
            replace(view, transmission=view.transmission * np.float32(self.exposure))
            for view in capture.fitted_views
        )
        return replace(
            capture,
            tube=replace(capture.tube, filtration_cm=filters),
            views=(pa, lat),
            further_views=tuple(further),
            at_least={
                name: least * np.float32(self.exposure) for name, least in capture.at_least.items()
            },
        )


ABLATIONS: Final[Mapping[str, Ablation]] = MappingProxyType(
    {
        "everything": Ablation(shared=True),
        "no labels of other objects": Ablation(),
        "no gain": Ablation(PolySettings(gain=False)),
        "no stray light": Ablation(PolySettings(stray=False)),
        "no pose": Ablation(PolySettings(pose=False)),
        "meshes believed in size": Ablation(PolySettings(size=False)),
        "no edge weights": Ablation(PolySettings(edge_weights=False)),
        "no sub-pixel averaging": Ablation(PolySettings(blocks=False)),
        "0.1 mm Cu too much in the filter": Ablation(copper_cm=0.01),
        "exposure 10 % off": Ablation(exposure=1.1),
    }
)


def told(capture: Capture, mode: Mode) -> Capture:
    """Take knowledge of the materials away: all but the families, or all."""
    return replace(capture, parts=tuple(_told(part, mode) for part in capture.parts))


def _told(part: CapturePart, mode: Mode) -> CapturePart:
    if mode == "labels" or not part.material or part.material in families():
        return part if mode != "blind" else replace(part, material="")
    family = load_materials()[part.material].family
    return replace(part, material=family if mode == "families" else "")


def scaled(
    density_g_cm3: Densities, regions: Sequence[trimesh.Trimesh], mass_g: float
) -> Densities:
    """Scale all densities so that the object has a known mass."""
    volumes = np.array([float(region.volume) for region in regions])
    return np.asarray(density_g_cm3 * mass_g / float(volumes @ density_g_cm3))


def paper(capture: Capture, order: Sequence[int]) -> Densities:
    """Give the paper's densities: one attenuation coefficient for each part by Adam, by 0.17."""
    meshes = [part.mesh for part in capture.parts]
    views = [(path_lengths(meshes, order, view.geometry), view) for view in capture.fitted_views]
    lac = np.nan_to_num(fit_lac_adam(views).lac_per_cm)
    return np.array([apparent_density_g_cm3(each) for each in lac.tolist()])


def nominal(parts: Sequence[CapturePart]) -> Densities:
    """Give what the labels say, without any X-ray: the median density of what a part may be."""
    found = []
    for part in parts:
        options = sorted(candidates(part.material, hollow=part.hollow), key=lambda c: c.mean_g_cm3)
        shares = np.cumsum(np.exp([each.log_prior for each in options]))
        found.append(options[int(np.searchsorted(shares, shares[-1] / 2))].mean_g_cm3)
    return np.array(found)


def poly(
    capture: Capture,
    space: Space,
    masses_g: Sequence[float | None],
    settings: PolySettings,
) -> list[PolyFit]:
    """Fit the tube's spectrum, once for each mass that may be known; the pose does not need it."""
    samples = sampled(capture, space, settings)
    volumes = samples.size.factor**3 * space.volumes_cm3
    by_images = fit_samples(samples, settings)
    return [
        by_images if mass_g is None else with_mass(by_images, mass_g, volumes)
        for mass_g in masses_g
    ]


def errors_of_fit(fit: PolyFit, space: Space, truth: Truth) -> Errors:
    """Say how far a fit is off, at the size that it found."""
    regions = space.moved(fit.size.enlarged).regions
    return errors_of(fit.solution.density_g_cm3, regions, truth.enlarged(fit.size))
