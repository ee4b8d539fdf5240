"""Checking a submission against the truth: every problem is found before any number counts."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from xden1k.predictions import CODES, Predictions, Problem, SubmissionMeta, listed
from xden1k.predictions.archive import SubmissionArchive
from xden1k.segmentation import SegmentsMeta
from xden1k.values.arrays import Grid
from xden1k.values.modality import Modality, Track
from xden_bench.scoring.axes import AxesWatch
from xden_bench.scoring.expand import PartShares, grid_of_parts, part_shares, sd_grid_of_parts
from xden_bench.scoring.metrics import nonuniformity, relative_error
from xden_bench.scoring.protocol import Protocol, Rules
from xden_bench.scoring.reference import Reference, Truth, xray_refusal

__all__ = [
    "PLACEHOLDER",
    "Check",
    "Progress",
    "even_fill_g_cm3",
    "id_problems",
    "meta_problems",
    "validate",
]

Progress = Callable[[Sequence[str]], Iterable[str]]
"""What shows a bar while it goes through ids."""

PLACEHOLDER = "my method"
"""The method's name in a template, until somebody fills it in."""
CONSTANT_TOLERANCE = 1e-3
"""Relative: float16 rounds by half of it."""
EVEN = 0.1
"""Share of the mass by which an even filling may be uneven: much noise for its size."""
INHOMOGENEOUS = 0.03
"""Non-uniformity from which on nobody hits a whole field by hitting one number."""


@dataclass(eq=False)
class Check:
    """The check of one submission, run by going through :meth:`fields`.

    Parameters
    ----------
    predictions
        The open file.
    reference
        The truth.
    protocol
        The rules.
    track
        The track it is meant for; None = the one its inputs lead to.
    progress
        Goes through the object ids; tqdm, for instance.
    """

    predictions: Predictions
    reference: Reference
    protocol: Protocol
    track: Track | None = None
    progress: Progress = iter
    _found: list[Problem] = field(default_factory=list, init=False)
    _warned: dict[str, list[str]] = field(default_factory=dict, init=False)
    _highest: float = field(default=0.0, init=False)
    _axes: AxesWatch = field(default_factory=AxesWatch, init=False)
    _inner: tuple[float, float] = field(default=(np.inf, -np.inf), init=False)
    """Lowest and highest value in voxels wholly inside an object."""
    even_fills_g_cm3: dict[str, float] = field(default_factory=dict, init=False)
    """Density of each object that is filled evenly: see :func:`even_fill_g_cm3`."""
    _inhomogeneous: set[str] = field(default_factory=set, init=False)
    _arrays: hashlib._Hash = field(default_factory=hashlib.sha256, init=False)

    def fields(self) -> Iterator[tuple[Truth, Grid, Grid | None]]:
        """Check object by object, giving the truth, the grid and its deviation of each sound one.

        The deviation is None where the submission has none.

        :attr:`problems` is complete when the iteration has ended.
        """
        self._found = [*self.predictions.problems]
        meta = self.predictions.meta
        if meta is None:
            return
        self._found += meta_problems(meta, self.reference, self.protocol, self.track)
        self._found += id_problems(self.predictions, self.reference)
        for object_id in self.progress(self.reference.ids):
            if object_id in self.predictions:
                truth = self.reference.truth(object_id, meta.target)
                shares = cache(partial(self._shares, truth))  # cut once, if at all
                grid = self._grid(truth, meta, shares)
                sd, sound = self._sd(truth, shares)
                if grid is not None and sound:
                    self._watch(truth, grid)
                    self._add_arrays(truth, grid, sd)
                    yield truth, grid, sd

    @property
    def arrays_sha256(self) -> str:
        """Checksum of what was scored, however it was stored and whatever surrounds it.

        Of each object, sorted by id: its id, its densities and their deviations if it has some,
        g/cm³, little-endian float32, of the voxels with envelope > 0 in C order.
        """
        return self._arrays.hexdigest()

    @property
    def problems(self) -> tuple[Problem, ...]:
        """Every error, then every warning."""
        every = (*self._found, *self._unit_problems(), *self._warnings())
        return tuple(sorted(every, key=lambda problem: not problem.is_error))

    def _shares(self, truth: Truth) -> PartShares:
        meshes = self.reference.part_meshes(truth.object_id)
        return part_shares(meshes, truth.origin_cm, truth.voxel_size_cm)

    def _grid(
        self, truth: Truth, meta: SubmissionMeta, shares: Callable[[], PartShares]
    ) -> Grid | None:
        """Return an object's predicted grid, or None if it has a problem, which is noted."""
        values, problems = self.predictions.examine(truth.object_id)
        if values is not None and values.ndim == 1:
            if problem := _part_problem(truth, len(values), meta.reads):
                problems, values = [problem], None
            else:
                values = grid_of_parts(values, shares())
        if values is not None and values.any() and not values[truth.envelope > 0].any():
            message = "it has mass, but none where the object is: check axes and origin"
            problems, values = [Problem("E405", truth.object_id, message)], None
        self._found += problems
        return values

    def _sd(self, truth: Truth, shares: Callable[[], PartShares]) -> tuple[Grid | None, bool]:
        """Return the deviation of an object's grid, if there is one, and whether it is sound."""
        values, problems = self.predictions.examine_sd(truth.object_id)
        self._found += problems
        if values is not None and values.ndim == 1:
            if len(values) != truth.parts + 1:  # as is its density, and that is told
                return None, False
            values = sd_grid_of_parts(values, shares())
        return values, not problems

    def _watch(self, truth: Truth, grid: Grid) -> None:
        """Note what the warnings are made of."""
        self._highest = max(self._highest, float(grid.max()))
        self._axes.look(grid, truth.envelope)
        inner = grid[truth.envelope == 1]
        if inner.size:
            low, high = self._inner
            self._inner = (min(low, float(inner.min())), max(high, float(inner.max())))
        outside = grid[truth.envelope == 0].sum(dtype=np.float64)
        if outside > self.protocol.max_outside_share * grid.sum(dtype=np.float64):
            self._warned.setdefault("W503", []).append(truth.object_id)
        if (fill := even_fill_g_cm3(grid, truth.envelope)) is not None:
            self.even_fills_g_cm3[truth.object_id] = fill
        if nonuniformity(truth.density_g_cm3, truth.envelope) > INHOMOGENEOUS:
            self._inhomogeneous.add(truth.object_id)
        if relative_error(truth.density_g_cm3, grid, truth.envelope) < self.protocol.copied_within:
            self._warned.setdefault("W504", []).append(truth.object_id)

    def _add_arrays(self, truth: Truth, grid: Grid, sd: Grid | None) -> None:
        """Add an object to the checksum of the arrays."""
        self._arrays.update(truth.object_id.encode())
        for values in (grid, sd):
            if values is not None:
                self._arrays.update(values[truth.envelope > 0].astype("<f4").tobytes())

    def _warnings(self) -> Iterator[Problem]:
        low, high = self._inner
        if high >= low >= high * (1 - CONSTANT_TOLERANCE):
            yield Problem("W502", None, f"{high:.4g} g/cm³ inside every object")
        if ids := self._warned.get("W503"):
            share = self.protocol.max_outside_share
            message = f"over {share:.0%} of the mass lies outside the object, not scored: "
            yield Problem("W503", None, message + listed(ids))
        yield from self._copy_warnings()
        if finding := self._axes.finding():
            yield Problem("W506", None, finding)

    def _copy_warnings(self) -> Iterator[Problem]:
        """Tell of values that are the reference's on too many of the objects that are not even.

        A good method hits homogeneous objects whole, so they count only where there are no others.
        """
        telling = self._inhomogeneous or set(self.reference.ids)
        ids = self._warned.get("W504", [])
        if len(telling.intersection(ids)) > self.protocol.max_identical_share * len(telling):
            within = f"within {self.protocol.copied_within:.1%}"
            yield Problem("W504", None, f"{CODES['W504']}, {within}: {listed(ids)}")

    def _unit_problems(self) -> Iterator[Problem]:
        meta = self.predictions.meta
        if meta is None or meta.target not in self.protocol.targets:  # an error already
            return
        limit = self.protocol.max_density_g_cm3[meta.target]
        if self._highest > limit:
            code = "E407" if self.protocol.refuse_above_limit else "W501"
            message = f"highest value {self._highest:.6g} g/cm³, above {limit:g}: units?"
            yield Problem(code, None, message)
        elif meta.units == "kg/m3" and 0 < self._highest * 1000 <= limit:
            message = f"kg/m3 declared, but the highest value is {self._highest * 1000:.4g}"
            yield Problem("W501", None, message)


def validate(
    path: Path,
    reference: Reference,
    protocol: Protocol,
    track: Track | None = None,
    progress: Progress = iter,
) -> tuple[Problem, ...]:
    """Return everything that is wrong with a submission, errors first.

    Parameters
    ----------
    path
        The ``preds.npz``.
    reference
        What it should have predicted.
    protocol
        The rules.
    track
        The track it is meant for; None = the one its inputs lead to.
    progress
        Goes through the object ids.

    Raises
    ------
    OSError
        If there is no such file.
    DataError
        If the truth cannot be read.
    """
    with Predictions(path) as predictions:
        check = Check(predictions, reference, protocol, track, progress)
        for _ in check.fields():
            pass
        return check.problems


def meta_problems(
    meta: SubmissionMeta | SegmentsMeta,
    reference: Reference,
    protocol: Rules,
    track: Track | None,
) -> Iterator[Problem]:
    """Compare what the file says it predicts with what is being scored."""
    if meta.method == PLACEHOLDER:
        message = f"method is still {PLACEHOLDER!r}, as in the template: fill in all that it lists"
        yield Problem("E207", None, message)
    here = reference.manifest_sha256
    for name, found, expected in (
        ("dataset_revision", meta.dataset_revision, reference.revision),
        ("manifest_sha256", meta.manifest_sha256 or here, here),
        ("config", meta.config, protocol.config),
        ("split", meta.split, reference.split),
        ("track", meta.track, track or meta.track),
    ):
        if found != expected:
            because = f", from the inputs {list(meta.inputs)}" if name == "track" else ""
            message = f"{name} must be {expected!r} here, got {found!r}{because}"
            yield Problem("E205", None, message)
    if meta.track == "xray" and (message := xray_refusal(reference.folder, reference.split)):
        yield Problem("E205", None, message)
    if meta.target not in protocol.targets:
        message = f"target must be one of {list(protocol.targets)}, got {meta.target!r}"
        yield Problem("E205", None, message)


def id_problems(predictions: SubmissionArchive[Any], reference: Reference) -> Iterator[Problem]:
    """Compare the objects named in the file with those of the split."""
    expected = frozenset(reference.ids)
    where = f"{len(expected)} in the split {reference.split}"
    if missing := expected - predictions.named_ids:
        yield Problem("E301", None, f"objects missing of the {where}: {listed(missing)}")
    if extra := predictions.named_ids - expected:
        yield Problem("E302", None, f"objects that are none of the {where}: {listed(extra)}")


def _part_problem(truth: Truth, count: int, reads: Modality) -> Problem | None:
    """Refuse part densities of the wrong number, or from a method that does not see parts."""
    if Modality.PARTS not in reads:
        message = "part_density is for methods whose inputs include 'parts'; send a density grid"
        return Problem("E402", truth.object_id, message)
    if count != truth.parts + 1:
        message = f"shape must be ({truth.parts + 1},), air and {truth.parts} parts, got ({count},)"
        return Problem("E402", truth.object_id, message)
    return None


def even_fill_g_cm3(density_g_cm3: Grid, envelope: Grid) -> float | None:
    """Density with which the outer surface is filled evenly, up to noise; None if it is not.

    Parameters
    ----------
    density_g_cm3
        Shape (x, y, z), g/cm³, voxel means.
    envelope
        Shape (x, y, z), 0 to 1: share of the voxel inside the outer surface.

    Examples
    --------
    >>> box = np.ones((1, 1, 2))
    >>> even_fill_g_cm3(2 * box, box), even_fill_g_cm3(np.array([[[1.0, 3.0]]]), box)
    (2.0, None)
    """
    inside = envelope > 0
    mass, volume = (float(one[inside].sum(dtype=np.float64)) for one in (density_g_cm3, envelope))
    return mass / volume if nonuniformity(density_g_cm3, envelope) <= EVEN else None
