"""From a capture and its space to fits: by the tube's spectrum if known, attenuation always."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from xden1k.errors import DataError
from xden1k.rays import PathLengths, path_lengths
from xden_builder.audit.view import ViewAudit, audit_image, audit_view, noise_floor
from xden_builder.capture import Capture
from xden_builder.capture.saturation import GainBounds, completed, gain_bounds
from xden_builder.capture.space import Space
from xden_builder.fit import LacFit, fit_lac, fit_lac_adam
from xden_builder.poly.judgement import PolyFit
from xden_builder.poly.line import fit_poly
from xden_builder.poly.model.size import Size
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.registration.capture import Registered
from xden_builder.registration.placement import Registration
from xden_builder.registration.size import find_size

__all__ = ["Explained", "ModelUsed", "explain"]

ModelUsed = Literal["paper", "poly", "mono", "attenuation"]


@dataclass(frozen=True, slots=True, eq=False)
class Explained:
    """What the radiographs were explained by, and how well.

    Parameters
    ----------
    capture
        Its views where the refined pose sees the scanner from the meshes, and these as large as the
        object.
    space
        What is each part's, as large as the object.
    model
        ``paper``, ``poly``, ``mono`` or, without a known source, ``attenuation``.
    lengths
        Of the parts, in each fitted view.
    fit
        One attenuation coefficient for each part.
    poly
        None where the source has no spectrum.
    audits
        How well the fit explains each view.
    registration
        How the parts came into the scanner's frame; None where they were there already.
    size
        That was found of them, and given to them; None where it was not sought.
    """

    capture: Capture
    space: Space
    model: ModelUsed
    lengths: tuple[PathLengths, ...]
    fit: LacFit
    poly: PolyFit | None
    audits: tuple[ViewAudit, ...]
    registration: Registration | None
    size: Size | None


def explain(there: Registered, space: Space, settings: BuildSettings) -> Explained:
    """Fit everything that the source allows.

    Parameters
    ----------
    there
        Its parts stand in the scanner's frame.
    space
        What is each part's mesh's.
    settings
        How to rebuild.

    Raises
    ------
    DataError
        If the tube lies outside the tables, or the object was turned by hand and its source has no
        spectrum: its pose is found by that fit alone.
    """
    capture = there.capture
    model, poly, size = _model_used(capture, settings), None, None
    if model != "poly" and capture.turned:
        raise DataError(
            f"views.{min(capture.turned)}.turned: expected a tube's kv in scanner.toml and --model "
            f"poly, which alone finds the pose of a turned view; got the model {model}"
        )
    if model == "poly":
        poly = fit_poly(capture, space, settings.poly)
        capture, size = _turned(capture, poly), poly.size
    elif capture.mesh_scale == "near":
        size = find_size(capture, space)
    if size is not None:
        capture, space = _enlarged(capture, size), space.moved(size.enlarged)
    subrays = 1 if settings.model == "paper" else settings.subrays
    lengths = [
        path_lengths(space.meshes, space.order, view.geometry, subrays)
        for view in capture.fitted_views
    ]
    fit = _fit(capture, lengths, settings, poly)
    audits = _audits(capture, lengths, fit, poly)
    return Explained(
        capture, space, model, tuple(lengths), fit, poly, audits, there.registration, size
    )


def _model_used(capture: Capture, settings: BuildSettings) -> ModelUsed:
    """``paper``, ``poly``, ``mono`` or, without a known source, ``attenuation``."""
    if settings.model == "paper" or capture.tube is None:
        return settings.model if capture.tube is not None else "attenuation"
    return "mono" if capture.tube.kv is None else "poly"


def _turned(capture: Capture, poly: PolyFit) -> Capture:
    """Put the scanner where the refined pose sees it from the meshes."""
    pa, lat, *further = (
        replace(view, geometry=seen.geometry)
        for view, seen in zip(capture.fitted_views, poly.solution.seen, strict=True)
    )
    return replace(capture, views=(pa, lat), further_views=tuple(further))


def _enlarged(capture: Capture, size: Size) -> Capture:
    parts = tuple(replace(part, mesh=size.enlarged(part.mesh)) for part in capture.parts)
    return replace(capture, parts=parts)


def _fit(
    capture: Capture, lengths: Sequence[PathLengths], settings: BuildSettings, poly: PolyFit | None
) -> LacFit:
    views = list(zip(lengths, capture.fitted_views, strict=True))
    if settings.model == "paper":
        return fit_lac_adam(views)
    return fit_lac(views, dark_sd=capture.noise_sd, gain_bounds=_gain_bounds(capture, poly))


def _gain_bounds(capture: Capture, poly: PolyFit | None) -> dict[str, GainBounds]:
    """Return bounds of the gains of views whose air is saturated; a spectrum's fit has found them.

    One coefficient for each part does not know that thin material attenuates more for its
    thickness, which looks like less gain.
    """
    found = {}
    for number, view in enumerate(capture.fitted_views):
        bounds = gain_bounds(view, capture.at_least.get(view.name))
        if bounds is not None and poly is not None:
            gain = float(poly.solution.nuisances(number)[0])
            bounds = (gain, gain)
        if bounds is not None:
            found[view.name] = bounds
    return found


def _audits(
    capture: Capture, lengths: Sequence[PathLengths], fit: LacFit, poly: PolyFit | None
) -> tuple[ViewAudit, ...]:
    """How well the fit explains its own images."""
    found = []
    for number, (taken, each) in enumerate(zip(capture.fitted_views, lengths, strict=True)):
        view, saturated = completed(taken, capture.at_least.get(taken.name))
        floor = noise_floor(capture, view.name)
        if poly is None:
            lac, gain = np.nan_to_num(fit.lac_per_cm), float(fit.gain[number])
            found.append(audit_view(view, each, lac, gain=gain, floor=floor, saturated=saturated))
        else:
            gain = float(poly.solution.nuisances(number)[0])
            model = poly.solution.image(number, each)
            found.append(
                audit_image(view, each, model, gain=gain, floor=floor, saturated=saturated)
            )
    return tuple(found)
