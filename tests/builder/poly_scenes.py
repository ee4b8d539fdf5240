"""Objects of known densities before a tube, rendered energy by energy with many rays a pixel."""

from dataclasses import dataclass, replace

import numpy as np
import trimesh

from tests.builder.fit_scenes import cone
from xden1k.rays import disjoint_regions, ownership_order, path_lengths
from xden1k.values.materials import load_materials
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.capture import Capture, CapturePart
from xden_builder.capture.space import divide
from xden_builder.physics.attenuation import mac_cm2_g
from xden_builder.physics.source import Detector, Tube
from xden_builder.physics.spectrum import tube_spectrum
from xden_builder.poly.estimate import estimate
from xden_builder.poly.judgement import judge
from xden_builder.poly.line import sampled
from xden_builder.poly.posterior.problem import Mass
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.weighed import weighed

TUBE = Tube(kv=100.0, mas=126.0, filtration_cm={"Al": 0.25})
ANGLES = {"pa": 90.0, "lat": 0.0}
TILT = trimesh.transformations.euler_matrix(0.31, 0.17, 0.23)
"""Faces along rays and pixel rows are another story: a fraction of a pixel decides there."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A part, what it is, and what the annotator says it is."""

    name: str
    mesh: trimesh.Trimesh
    material: str
    density_g_cm3: float
    label: str | None = None
    hollow: bool = False

    @property
    def annotated(self):
        label = self.material if self.label is None else self.label
        return CapturePart(self.name, self.mesh, label, hollow=self.hollow)


def composition(material):
    return load_materials()[material].composition


def box(size_cm, at_cm=(0.0, 0.0, 0.0)):
    mesh = trimesh.creation.box(size_cm, trimesh.transformations.translation_matrix(at_cm))
    return mesh.apply_transform(TILT)


def cylinder(radius_cm, height_cm, at_cm=(0.0, 0.0, 0.0)):
    there = trimesh.transformations.translation_matrix(at_cm)
    mesh = trimesh.creation.cylinder(radius_cm, height_cm, sections=48, transform=there)
    return mesh.apply_transform(TILT)


def tool(**grip):
    """A steel blade, a plastic grip around its end, water beside it: like nothing turned."""
    return (
        Solid("blade", box((0.7, 0.25, 7.0), (0.3, 0.2, 2.5)), "steel", 7.82),
        replace(Solid("grip", box((3.0, 2.4, 5.0), (0.0, 0.0, -2.0)), "pp", 0.91), **grip),
        Solid("level", cylinder(0.9, 3.0, (2.6, 0.7, -1.5)), "water", 1.0),
    )


def geometries(size=128, width_cm=14.0):
    """Both views by name."""
    return {name: cone(angle, size, width_cm) for name, angle in ANGLES.items()}


def radiograph(solids, name, geometry, *, tube=TUBE, exposure=1.0, rays=4):
    """One view as a perfect panel takes it: all energies, and the mean of all rays of a pixel."""
    meshes = [solid.mesh for solid in solids]
    lengths = path_lengths(meshes, ownership_order(meshes), geometry, rays)
    spectrum = tube_spectrum(tube)
    lac = np.stack(
        [
            each.density_g_cm3 * mac_cm2_g(composition(each.material), spectrum.energies_kev)
            for each in solids
        ]
    )
    image = np.ones(geometry.shape, dtype=np.float32)
    image.flat[lengths.pixels] = np.concatenate(
        [  # piece by piece: every energy of every ray at once would take hundreds of megabytes
            spectrum.transmission(piece @ lac).mean(axis=1)
            for piece in np.array_split(lengths.lengths_cm, 16)
        ]
    )
    light = np.asarray(exposure * image, dtype=np.float32)
    return XRayView(name, light, np.ones(image.shape, dtype=bool), geometry)


def captured(solids, *, exposures=(1.0, 1.0), size=128, **how):
    """Both views of an object, and its annotated parts."""
    views = [
        radiograph(solids, name, geometry, exposure=exposure, **how)
        for (name, geometry), exposure in zip(geometries(size).items(), exposures, strict=True)
    ]
    return capture_of(solids, views, **how)


def capture_of(solids, views, *, tube=TUBE, **_):
    pa, lat = views
    return Capture(
        object_id="tool-0000",
        category="tool",
        split=None,
        source="phantom",
        weighed_mass_g=None,
        notes="",
        tube=tube,
        detector=Detector("CsI"),
        views=(pa, lat),
        audit_views=(),
        parts=tuple(solid.annotated for solid in solids),
        flags=(),
        noise_sd={},
    )


def relabelled(capture, **labels):
    """The capture with other words of the annotator's."""
    parts = [replace(part, material=labels.get(part.name, part.material)) for part in capture.parts]
    return replace(capture, parts=tuple(parts))


def true_mass_g(solids):
    """Mass of an object."""
    meshes = [solid.mesh for solid in solids]
    regions = disjoint_regions(meshes, ownership_order(meshes))
    return sum(
        float(region.volume) * solid.density_g_cm3
        for region, solid in zip(regions, solids, strict=True)
    )


def solved(capture, **choices):
    """Where the fit ends."""
    space, settings = divide(capture.parts), PolySettings(**choices)
    solution = estimate(sampled(capture, space, settings), settings)
    if capture.weighed_mass_g is None:
        return solution
    return weighed(solution, Mass(capture.weighed_mass_g, space.volumes_cm3))


def fitted(capture, **choices):
    """What the fit says of each part, by name."""
    fit = judge(solved(capture, **choices))
    return {part.name: found for part, found in zip(capture.parts, fit.parts, strict=True)}


def saturated(bright: Capture, limit: float) -> Capture:
    """What a panel makes of it that can tell no more than this."""
    views, at_least = [], {}
    for view in bright.views:
        full = view.transmission >= limit
        views.append(
            replace(view, transmission=np.where(full, np.nan, view.transmission), valid=~full)
        )
        at_least[view.name] = np.where(full, limit, np.nan).astype(np.float32)
    pa, lat = views
    return replace(bright, views=(pa, lat), at_least=at_least)


def of_pitch(geometry: ViewGeometry, factor: float) -> ViewGeometry:
    """Tell pixels to be larger by a factor, about the middle of the panel."""
    across = [end / 2 * (factor - 1) for end in np.subtract(geometry.shape, 1)]
    steps = geometry.row_step_cm, geometry.column_step_cm
    return replace(
        geometry,
        pixel00_cm=geometry.pixel00_cm
        - sum(by * step for by, step in zip(across, steps, strict=True)),
        row_step_cm=factor * geometry.row_step_cm,
        column_step_cm=factor * geometry.column_step_cm,
    )
