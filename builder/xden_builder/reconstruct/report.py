"""What an object says of how it was made: fit report, provenance, uncertainty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
import trimesh

from xden1k.rays import PathLengths
from xden1k.values.plain import plain
from xden_builder.capture.calibrated import panel_values
from xden_builder.physics.source import Detector
from xden_builder.poly.judgement import PolyFit
from xden_builder.reconstruct.densities import Densities
from xden_builder.reconstruct.explained import Explained
from xden_builder.reconstruct.rigid import Weighed, rigid_sd
from xden_builder.reconstruct.settings import BuildSettings

__all__ = ["report"]


def report(
    explained: Explained,
    densities: Densities,
    settings: BuildSettings,
) -> Mapping[str, Any]:
    """Give what ``meta`` keeps: nothing of the machine or the hour, so that bytes repeat.

    Parameters
    ----------
    explained
        The fits.
    densities
        Of the parts.
    settings
        How it was rebuilt.
    """
    capture, poly, registration = explained.capture, explained.poly, explained.registration
    names = [part.name for part in capture.parts]
    return (
        _fits(explained, settings)
        | _uncertainty(explained.space.regions, densities, poly)
        | ({} if poly is None else {"poly": plain(poly.report(names))})
        | ({} if registration is None else {"registration": plain(registration.to_dict())})
        | ({} if explained.size is None else {"mesh_size": explained.size.to_dict()})
    )


def _detector(detector: Detector) -> dict[str, Any]:
    """Give what is told of a detector; of its panel only what is."""
    kept = {"scintillator": detector.scintillator, "bits": detector.bits}
    return kept | panel_values(detector)


def _fits(explained: Explained, settings: BuildSettings) -> dict[str, Any]:
    """Fit report and provenance."""
    capture, fit = explained.capture, explained.fit
    names = [view.name for view in capture.fitted_views]
    meta = {
        "model": explained.model,
        "settings": asdict(settings),
        "mesh_units": capture.mesh_units,
        "tube": None if capture.tube is None else asdict(capture.tube),
        "detector": _detector(capture.detector),
        "fit": {
            **fit.report,
            "loss": fit.loss,
            "lac_sd_per_cm": {
                part.name: sd
                for part, sd in zip(capture.parts, fit.lac_sd_per_cm.tolist(), strict=True)
            },
            "gain": dict(zip(names, fit.gain.tolist(), strict=True)),
        },
        "reprojection": {
            audit.name: {
                "transmission_mae": audit.transmission_mae,
                "transmission_corr": audit.transmission_corr,
                "unexplained": asdict(audit.unexplained),
                "blur": asdict(audit.blur),
            }
            for audit in explained.audits
        },
        "overlap_share": {
            name: _overlap_share(view) for name, view in zip(names, explained.lengths, strict=True)
        },
        "priorities": {part.name: part.priority for part in capture.parts},
        "notes": capture.notes,
    }
    cleaned: dict[str, Any] = plain(meta)  # a part that no ray meets has no standard deviation
    return cleaned


def _overlap_share(lengths: PathLengths) -> float:
    """Share of the way through the object that two or more annotated parts claim."""
    total = float(lengths.lengths_cm.sum(dtype=np.float64)) / lengths.lengths_cm.shape[1]
    return float(lengths.shared_cm.sum(dtype=np.float64)) / total if total else 0.0


def _uncertainty(
    regions: Sequence[trimesh.Trimesh],
    densities: Densities,
    poly: PolyFit | None,
) -> dict[str, Any]:
    """Give standard deviations of the mass properties, if every density is known.

    What surfaces leave a volume off is as much of a mass off as a density would be.
    """
    known = np.array([density.density_g_cm3 for density in densities.parts])
    if np.isnan(known).any():
        return {}
    covariance, weighing = densities.covariance, None
    if poly is not None:
        covariance = covariance + np.diag((poly.solution.scene.walls.volume_sd * known) ** 2)
        if (mass := poly.solution.problem.mass) is not None:
            weighing = Weighed(mass.sd * mass.mass_g, poly.fitted)
    sd = rigid_sd(
        regions,
        known,
        covariance,
        densities.by_size_g_cm3,
        densities.size_sd,
        weighing,
    )
    return {
        "uncertainty": {
            "mass_sd_g": sd.mass_g,
            "com_sd_cm": sd.com_cm.tolist(),
            "inertia_sd_g_cm2": [
                float(sd.inertia_g_cm2[axes])
                for axes in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))
            ],
        }
    }
