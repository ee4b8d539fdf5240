"""Reading ``segments.npz``: every problem collected, one object in memory at a time."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from xden1k.errors import MissingObjectError
from xden1k.predictions.archive import OBJECT_ID, Named, SubmissionArchive, open_flawless
from xden1k.predictions.meta import SegmentsMeta
from xden1k.predictions.npz import BadArchiveError, Member, check_size
from xden1k.predictions.problems import CODES, Problem, listed
from xden1k.segmentation.values import (
    CLUSTER_COUNTS,
    MAX_POINTS,
    Segmentation,
    faults,
    shape_message,
)

__all__ = ["SEGMENT_CODES", "Segments", "open_segments"]

SEGMENT_CODES: Final = {
    **{code: meaning for code, meaning in CODES.items() if code <= "E302" and code != "E204"},
    "E102": "declared size or compression ratio beyond what the points allow",
    "E205": "revision, manifest, config, split, track or points are not what is being scored",
    "E304": "labels without free, or free without labels",
    "E401": "dtype is not uint8",
    "E402": "shape is not (18, points), or (points,)",
    "E408": "more clusters than k",
}
"""Every code of a ``segments.npz`` and its meaning: the file is refused."""
_UINT8: Final = (r"\|u1", "uint8 ('|u1')")
_ROWS: Final = {"labels": len(CLUSTER_COUNTS), "free": 1}


class Segments(SubmissionArchive[SegmentsMeta]):
    """An open ``segments.npz``. :func:`open_segments` is the same for files that must be flawless.

    Parameters
    ----------
    path
        The file.
    """

    form = SegmentsMeta
    key = re.compile(rf"(?P<kind>labels|free)/(?P<id>{OBJECT_ID})\.npy")
    keys = "__meta__, labels/ID or free/ID"
    main = "labels"

    def __init__(self, path: Path) -> None:
        self._free_members: dict[str, Member] = {}
        super().__init__(path)

    def examine(self, object_id: str, points: int) -> tuple[Segmentation | None, list[Problem]]:
        """Read one object and say what is wrong with its labels.

        Parameters
        ----------
        object_id
            One of ``ids``.
        points
            How many points it has.

        Returns
        -------
        segmentation, problems
            None if there is a problem: E101, E402, E408; or if ``free`` cannot be read, which
            ``problems`` of the file tell.

        Raises
        ------
        MissingObjectError
            If the file has no readable labels for it.
        """
        if object_id not in self._members:
            raise MissingObjectError(f"{self.path}: no labels for {object_id}")
        if object_id not in self._free_members:
            return None, []
        try:
            labels = self._archive.read(self._members[object_id])
            free = self._archive.read(self._free_members[object_id])
        except BadArchiveError as err:
            return None, [Problem(err.code, object_id, str(err))]
        if found := [Problem(code, object_id, text) for code, text in faults(labels, free, points)]:
            return None, found
        return Segmentation(labels, free), []

    def _slot(self, found: re.Match[str]) -> str:
        return found["kind"]

    def _examine_member(self, info: zipfile.ZipInfo, found: re.Match[str]) -> Iterator[Problem]:
        kind = found["kind"]
        try:
            member = self._archive.member(info)
            _check_shape(kind, member)
            check_size(member, _ROWS[kind] * MAX_POINTS, *_UINT8)
        except BadArchiveError as err:
            yield Problem(err.code, found["id"], f"{kind}: {err}")
        else:
            members = self._free_members if kind == "free" else self._members
            members[found["id"]] = member

    def _slot_problems(self, named: Named) -> Iterator[Problem]:
        labels, free = (named.get(slot, {}).keys() for slot in ("labels", "free"))
        if alone := labels ^ free:
            message = f"an object must have both labels and free; only one of them {listed(alone)}"
            yield Problem("E304", None, message)


def open_segments(path: Path | str) -> Segments:
    """Open a submission that must be flawless as far as its headers and meta data show.

    Raises
    ------
    SubmissionError
        With every problem found.
    """
    return open_flawless(Segments(Path(path)), named=True)


def _check_shape(kind: str, member: Member) -> None:
    """Compare a member's shape with the format, as far as the number of points is not needed."""
    rows = _ROWS["labels"]
    expected: tuple[int | str, ...] = (rows, "points") if kind == "labels" else ("points",)
    if len(member.shape) != len(expected) or member.shape[:-1] != expected[:-1]:
        raise BadArchiveError("E402", shape_message(expected, member.shape))
