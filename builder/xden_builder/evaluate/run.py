"""Every method on every object of a folder of simulated captures, a process per core."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any, Final

import numpy as np
from jaxtyping import Float64

from xden1k.errors import DataError
from xden1k.values.mass import mass_of_meshes
from xden_builder.capture import Capture, CaptureFolder
from xden_builder.capture.space import Space, divide
from xden_builder.evaluate.methods import (
    ABLATIONS,
    MODES,
    Ablation,
    Mode,
    errors_of_fit,
    nominal,
    paper,
    poly,
    scaled,
    told,
)
from xden_builder.evaluate.quality import SHOWN, QualityPair, quality_of
from xden_builder.evaluate.truth import Errors, Truth, errors_of, read_truth
from xden_builder.fit.spread import spread
from xden_builder.poly.hardness import Hardness, join, pilots
from xden_builder.poly.judgement import UNCERTAIN, PolyFit
from xden_builder.poly.settings import PolySettings
from xden_builder.poly.survey import Clue
from xden_builder.reconstruct.clues import find_clues
from xden_builder.reconstruct.rigid import rigid_sd
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.registration.capture import registered
from xden_builder.registration.placement import Registration
from xden_builder.workers import gather

__all__ = ["BodyCheck", "Evaluation", "ObjectResult", "PartCheck", "evaluate"]

Key = tuple[str, str]
"""A method and what it was told."""


DRAW: Final = "xden-evaluate"
"""Goes before the ids by whose checksums objects are drawn."""


@dataclass(frozen=True, slots=True)
class PartCheck:
    """One density of the polychromatic fit and the truth."""

    density_g_cm3: float
    sd_g_cm3: float
    truth_g_cm3: float
    source: str
    flags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class BodyCheck:
    """Mass and centre of mass of the polychromatic fit: errors by their standard deviations."""

    mass: float
    com: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class ObjectResult:
    """All methods on one object.

    Parameters
    ----------
    errors
        By method and what it was told.
    parts
        Of the fit without a weighed mass, by what it was told.
    body
        Of the fit with labels.
    ablated
        Errors by ablation; empty where it was not asked for.
    quality
        Of all parts against the outer surface alone; None where it was not asked for.
    seconds
        Processor time of the methods that look at the images.
    """

    errors: dict[Key, Errors]
    parts: dict[Mode, tuple[PartCheck, ...]]
    body: BodyCheck
    ablated: dict[str, Errors]
    quality: QualityPair | None
    seconds: dict[str, float]


@dataclass(frozen=True, slots=True)
class Evaluation:
    """All objects.

    Parameters
    ----------
    objects
        By object id.
    failures
        Object id and reason of those that could not be evaluated.
    shared
        What the labelled parts say of filter and errors, by which objects are fitted whose labels
        are told.
    """

    objects: dict[str, ObjectResult]
    failures: tuple[tuple[str, str], ...]
    shared: Hardness

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {
            "objects": {
                object_id: {
                    **asdict(result),
                    "errors": [
                        {"method": method, "told": mode, **asdict(errors)}
                        for (method, mode), errors in result.errors.items()
                    ],
                }
                for object_id, result in self.objects.items()
            },
            "failures": [{"object_id": key, "message": why} for key, why in self.failures],
            "shared": asdict(self.shared),
        }


def evaluate(
    captures: Path,
    *,
    ablated: int,
    workers: int,
    on_done: Callable[[str], None] = lambda _: None,
) -> Evaluation:
    """Run every method on every object.

    Parameters
    ----------
    captures
        Folder of simulated captures, with their truth.
    ablated
        Number of objects, drawn by their ids, that the ablations are run on.
    workers
        Processes.
    on_done
        Told of each object.

    Raises
    ------
    DataError
        If the folder cannot be read.
    """
    folder = CaptureFolder(captures)
    drawn = sorted(folder.object_ids, key=_draw)[:ablated]
    asked = partial(_clues, captures)
    shared = join(gather(asked, pilots(folder.object_ids), workers, lambda _: None)[0])
    task = partial(_evaluate_object, captures, frozenset(drawn), shared)
    objects, failures = gather(task, folder.object_ids, workers, on_done)
    return Evaluation(objects, tuple(failures), shared)


def _draw(object_id: str) -> bytes:
    """Order of the objects that has nothing to do with their names."""
    return hashlib.sha256(f"{DRAW}/{object_id}".encode()).digest()


def _clues(captures: Path, object_id: str) -> tuple[Clue, ...]:
    return find_clues(CaptureFolder(captures).read(object_id), BuildSettings())


def _evaluate_object(
    captures: Path, drawn: frozenset[str], shared: Hardness, object_id: str
) -> ObjectResult:
    there = registered(CaptureFolder(captures).read(object_id))
    capture = there.capture
    if capture.tube is None or capture.tube.kv is None:
        raise DataError(f"{object_id}: expected a tube, got another source")
    truth = read_truth(captures / object_id, capture.parts, there.placement)
    space = divide(capture.parts)
    bench = _Bench(capture, space, truth, shared, {}, {})
    bench.paper()
    checks = {}
    for mode in MODES:
        fit = _as_unsure_as_its_pose(bench.mode(mode), there.registration)
        checks[mode] = _part_checks(fit, truth)
        if mode == "labels":
            body, quality = _body_check(fit, space, truth), None
            if object_id in drawn or capture.category in SHOWN:
                quality = quality_of(capture, space.order, truth, fit)
    ablated = {name: bench.ablation(each) for name, each in ABLATIONS.items() if object_id in drawn}
    return ObjectResult(bench.errors, checks, body, ablated, quality, bench.seconds)


@dataclass(frozen=True, slots=True, eq=False)
class _Bench:
    """One object that methods are tried on, and what its folder's labels say of all objects."""

    capture: Capture
    space: Space
    truth: Truth
    shared: Hardness
    errors: dict[Key, Errors]
    seconds: dict[str, float]

    def paper(self) -> None:
        """Try the paper's way, with and without a weighed mass."""
        begin = process_time()
        density = paper(self.capture, self.space.order)
        self.seconds["paper"] = process_time() - begin
        self._keep("paper", "nothing", density)
        self._keep("paper + mass", "nothing", self._scaled(density))

    def mode(self, mode: Mode) -> PolyFit:
        """Try what labels say and what X-rays say, and return the fit without a weighed mass."""
        capture = told(self.capture, mode)
        usual = nominal(capture.parts)
        self._keep("labels alone", mode, usual)
        self._keep("labels alone + mass", mode, self._scaled(usual))
        begin = process_time()
        masses = (None, self.truth.mass_g)
        shared = self.shared if mode == "labels" else join({})
        fits = poly(capture, self.space, masses, shared.applied(PolySettings()))
        self.seconds[f"poly, {mode}, with and without mass"] = process_time() - begin
        for name, fit in zip(("poly", "poly + mass"), fits, strict=True):
            self.errors[name, mode] = errors_of_fit(fit, self.space, self.truth)
        return fits[0]

    def ablation(self, ablation: Ablation) -> Errors:
        """Try the fit without one of its parts."""
        capture = ablation.applied(self.capture)
        shared = self.shared if ablation.shared else join({})
        (fit,) = poly(capture, self.space, [None], shared.applied(ablation.settings))
        return errors_of_fit(fit, self.space, self.truth)

    def _scaled(self, density: Float64[np.ndarray, "k"]) -> Float64[np.ndarray, "k"]:
        return scaled(density, self.space.regions, self.truth.mass_g)

    def _keep(self, method: str, mode: str, density: Float64[np.ndarray, "k"]) -> None:
        self.errors[method, mode] = errors_of(density, self.space.regions, self.truth)


def _as_unsure_as_its_pose(fit: PolyFit, registration: Registration | None) -> PolyFit:
    if registration is None:
        return fit
    parts, covariance = spread(fit.parts, fit.covariance, registration.density_spread(), UNCERTAIN)
    return replace(fit, parts=parts, covariance=covariance)


def _part_checks(fit: PolyFit, truth: Truth) -> tuple[PartCheck, ...]:
    return tuple(
        PartCheck(part.density_g_cm3, part.sd_g_cm3, known, part.source, part.flags)
        for part, known in zip(fit.parts, truth.density_g_cm3.tolist(), strict=True)
    )


def _body_check(fit: PolyFit, space: Space, truth: Truth) -> BodyCheck:
    density, size = fit.solution.density_g_cm3, fit.size
    regions, truth = space.moved(size.enlarged).regions, truth.enlarged(size)
    body = mass_of_meshes(regions, density.tolist())
    sd = rigid_sd(regions, density, fit.covariance, fit.by_size_g_cm3, size.sd)
    off = (body.com_cm - truth.com_cm) / sd.com_cm
    return BodyCheck((body.mass_g - truth.mass_g) / sd.mass_g, tuple(off.tolist()))
