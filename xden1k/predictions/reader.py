"""Reading ``preds.npz``: every problem collected, one object in memory at a time."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final

import numpy as np
from jaxtyping import Float32

from xden1k.errors import MissingObjectError
from xden1k.predictions.archive import OBJECT_ID, Named, SubmissionArchive, open_flawless
from xden1k.predictions.meta import SubmissionMeta
from xden1k.predictions.npz import BadArchiveError, Member, check_size
from xden1k.predictions.problems import Problem, listed, raise_errors
from xden1k.values.types import FIELD_SIZE, MAX_PARTS

__all__ = ["Predictions", "open_predictions"]

GRID_SHAPE: Final = (FIELD_SIZE,) * 3
MAX_VALUE_BYTES: Final = 4 * FIELD_SIZE**3
"""One float32 grid: the largest member there may be."""
MAX_VALUE: Final = 1e9
"""In the units as stored: far above any matter, and no sum over it overflows."""

_FLOATS: Final = ("<f[24]", "float32 or float16 ('<f4' or '<f2')")
_SD_PREFIX: Final = "density_sd: "
"""Opens messages about a standard deviation, of grids and of parts."""


class Predictions(SubmissionArchive[SubmissionMeta]):
    """An open ``preds.npz``. :func:`open_predictions` is the same for files that must be flawless.

    Parameters
    ----------
    path
        The file.
    """

    form = SubmissionMeta
    key = re.compile(rf"(?P<kind>density|part_density)(?P<sd>_sd)?/(?P<id>{OBJECT_ID})\.npy")
    keys = "__meta__, density/ID or part_density/ID, or these with _sd"
    main = "density"

    def __init__(self, path: Path) -> None:
        self._sd_members: dict[str, Member] = {}
        super().__init__(path)

    @property
    def has_sd(self) -> bool:
        """True if standard deviations come with the densities: of all objects, if sound."""
        return bool(self._sd_members)

    def examine(self, object_id: str) -> tuple[Float32[np.ndarray, "..."] | None, list[Problem]]:
        """Read one object and say what is wrong with its values.

        Parameters
        ----------
        object_id
            One of ``ids``.

        Returns
        -------
        values, problems
            g/cm³, shape (64, 64, 64) or (parts + 1,); None if there is a problem: E101, E403,
            E404, E406.

        Raises
        ------
        MissingObjectError
            If the file has no readable prediction for it.
        """
        if object_id not in self._members:
            raise MissingObjectError(f"{self.path}: no prediction for {object_id}")
        return self._examine(object_id, self._members[object_id])

    def examine_sd(self, object_id: str) -> tuple[Float32[np.ndarray, "..."] | None, list[Problem]]:
        """Read the standard deviation of one object's density and say what is wrong with it.

        Parameters
        ----------
        object_id
            One of ``ids``.

        Returns
        -------
        values, problems
            g/cm³, of the shape of the density; None if there is a problem, as in
            :meth:`examine`, or no standard deviation, and then no problem.
        """
        if object_id not in self._sd_members:
            return None, []
        return self._examine(object_id, self._sd_members[object_id], _SD_PREFIX)

    def read(self, object_id: str) -> Float32[np.ndarray, "..."]:
        """Read one object: g/cm³, shape (64, 64, 64) or (parts + 1,).

        Raises
        ------
        MissingObjectError
            If the file has no readable prediction for it.
        SubmissionError
            If its values are damaged, not finite or negative.
        """
        values, problems = self.examine(object_id)
        raise_errors(problems)
        assert values is not None
        return values

    def read_sd(self, object_id: str) -> Float32[np.ndarray, "..."]:
        """Read the standard deviation of one object's density: g/cm³, of the density's shape.

        Raises
        ------
        MissingObjectError
            If the file has no readable standard deviation for it.
        SubmissionError
            If its values are damaged, not finite or negative.
        """
        values, problems = self.examine_sd(object_id)
        raise_errors(problems)
        if values is None:
            raise MissingObjectError(f"{self.path}: no density_sd for {object_id}")
        return values

    def _examine(
        self, object_id: str, member: Member, prefix: str = ""
    ) -> tuple[Float32[np.ndarray, "..."] | None, list[Problem]]:
        """Read a member in g/cm³; ``prefix`` opens each message."""
        try:
            stored = self._archive.read(member)
        except BadArchiveError as err:
            return None, [Problem(err.code, object_id, f"{prefix}{err}")]
        with np.errstate(invalid="ignore"):  # a signalling nan; reported below
            values = stored.astype(np.float32)
        if problems := list(_value_problems(object_id, values, prefix)):
            return None, problems
        if self.meta is not None and self.meta.units == "kg/m3":
            values *= np.float32(1e-3)
        return values, []

    def _slot(self, found: re.Match[str]) -> str:
        return "sd" if found["sd"] else self.main

    def _examine_member(self, info: zipfile.ZipInfo, found: re.Match[str]) -> Iterator[Problem]:
        prefix = _SD_PREFIX if found["sd"] else ""
        try:
            member = self._archive.member(info)
            _check_edge(found["kind"], member)
            check_size(member, MAX_VALUE_BYTES, *_FLOATS)
            _check_shape(found["kind"], member)
        except BadArchiveError as err:
            yield Problem(err.code, found["id"], f"{prefix}{err}")
        else:
            members = self._sd_members if found["sd"] else self._members
            members[found["id"]] = member

    def _slot_problems(self, named: Named) -> Iterator[Problem]:
        yield from _sd_problems(named.get(self.main, {}), named.get("sd", {}))
        yield from self._length_problems()

    def _length_problems(self) -> Iterator[Problem]:
        """Tell of standard deviations that are more or fewer than the densities."""
        for object_id, member in self._sd_members.items():
            density = self._members.get(object_id)
            if density and density.shape != member.shape:
                expected = f"shape must be the density's, {density.shape}"
                yield Problem("E402", object_id, f"{_SD_PREFIX}{expected}, got {member.shape}")


def open_predictions(path: Path | str) -> Predictions:
    """Open a submission that must be flawless as far as its headers and meta data show.

    Raises
    ------
    SubmissionError
        With every problem found.
    """
    return open_flawless(Predictions(Path(path)))


def pooling(shape: tuple[int, ...]) -> str:
    """Say how a finer cube becomes the grid; nothing of any other shape.

    Examples
    --------
    >>> pooling((128, 128, 128))
    '; take means: values.reshape(64, 2, 64, 2, 64, 2).mean((1, 3, 5))'
    >>> pooling((64, 64))
    ''
    """
    edge = shape[0] if shape else 0
    if shape != (edge,) * 3 or edge % FIELD_SIZE or edge == FIELD_SIZE:
        return ""
    pairs = ", ".join([f"{FIELD_SIZE}, {edge // FIELD_SIZE}"] * 3)
    return f"; take means: values.reshape({pairs}).mean((1, 3, 5))"


def _check_edge(kind: str, member: Member) -> None:
    """Refuse a finer cube by its shape, before its size is found too large."""
    if kind == "density" and (how := pooling(member.shape)):
        raise BadArchiveError("E402", f"shape must be {GRID_SHAPE}, got {member.shape}{how}")


def _check_shape(kind: str, member: Member) -> None:
    """Compare a member's shape with the format."""
    if kind == "density" and member.shape != GRID_SHAPE:
        raise BadArchiveError("E402", f"shape must be {GRID_SHAPE}, got {member.shape}")
    if kind == "part_density" and not (
        len(member.shape) == 1 and 2 <= member.shape[0] <= MAX_PARTS + 1
    ):
        raise BadArchiveError("E402", f"shape must be (parts + 1,), got {member.shape}")


def _sd_problems(kinds: Mapping[str, str], sd_kinds: Mapping[str, str]) -> Iterator[Problem]:
    """Compare the objects that have a standard deviation with those that have a density."""
    if alone := [key for key, kind in sd_kinds.items() if kinds.get(key) != kind]:
        expected = "density_sd needs its density, part_density_sd its part_density"
        yield Problem("E303", None, f"{expected}; without it {listed(alone)}")
    if sd_kinds and (without := kinds.keys() - sd_kinds.keys()):
        expected = "density_sd is for all objects or none"
        yield Problem("E303", None, f"{expected}; objects without it {listed(without)}")


def _value_problems(
    object_id: str, values: Float32[np.ndarray, "..."], prefix: str
) -> Iterator[Problem]:
    """Look for values that are no densities."""
    for code, what, bad in (
        ("E403", "not finite", ~np.isfinite(values)),
        ("E404", "negative", values < 0),
        ("E403", f"above {MAX_VALUE:g}", np.isfinite(values) & (values > MAX_VALUE)),
    ):
        if bad.any():
            first = tuple(int(index) for index in np.argwhere(bad)[0])
            message = f"{prefix}{bad.sum()} values are {what}, first at {first}"
            yield Problem(code, object_id, message)
    if values.ndim == 1 and values[0] != 0:
        message = f"{prefix}entry 0 is air and must be 0, got {values[0]}"
        yield Problem("E406", object_id, message)
