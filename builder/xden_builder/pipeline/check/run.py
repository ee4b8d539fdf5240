"""Check a whole capture folder: every object, whatever is wrong with others."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Final

from xden_builder.capture import CaptureFolder
from xden_builder.pipeline.check.object import Finding, Kind, ObjectCheck, check_object
from xden_builder.pipeline.check.outlines import Lengths
from xden_builder.triage.sizes import middle_of
from xden_builder.workers import Answer, explain, run_each

__all__ = ["FolderCheck", "check_folder"]

LONGER: Final = 0.08
"""Shadows that are longer or shorter than the parts' outlines by this share, in the median of a
folder, are of another scanner than was told. Of sound folders it is within 0.03."""
TALLER: Final = 0.03
"""So much, and by more than chance, where rows and columns are compared."""


@dataclass(frozen=True, slots=True)
class FolderCheck:
    """What was found of every object, in the order of their names."""

    objects: tuple[ObjectCheck, ...]

    @property
    def clean(self) -> bool:
        """Whether nothing was found."""
        return not any(each.findings for each in self.objects) and not self.remarks

    @property
    def remarks(self) -> tuple[str, ...]:
        """What contradicts itself in all objects alike: shadows of another length or form.

        Where both views are too long or short, it may be the meshes.
        """
        lengths: dict[str, list[Lengths]] = {}
        for each in self.objects:
            for view, one in each.lengths:
                lengths.setdefault(view, []).append(one)
        return tuple(said for view, ones in lengths.items() for said in _of_lengths(view, ones))

    @property
    def by_finding(self) -> dict[Finding, tuple[str, ...]]:
        """Each finding, and of which objects it was found: a wrong ``scanner.toml`` is of all.

        What differs by the object's own files alone is one finding, told of the first of them.
        """
        first: dict[Finding, Finding] = {}
        found: dict[Finding, list[str]] = {}
        for each in self.objects:
            for finding in each.findings:
                own = rf"(?<![\w.-]){re.escape(each.object_id)}(?![\w.-])"
                alike = replace(finding, message=re.sub(own, "OBJECT", finding.message))
                found.setdefault(first.setdefault(alike, finding), []).append(each.object_id)
        return {finding: tuple(object_ids) for finding, object_ids in found.items()}

    def count(self, kind: Kind) -> int:
        """How many objects have findings of a kind."""
        return sum(any(one.kind == kind for one in each.findings) for each in self.objects)

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return {
            "schema": "xden-check/1",
            "clean": self.clean,
            "refused": self.count("refused"),
            "contradicting": self.count("contradicts"),
            "remarks": self.remarks,
            "objects": [
                {
                    "object_id": each.object_id,
                    "findings": [asdict(finding) for finding in each.findings],
                }
                for each in self.objects
            ],
        }


def _of_lengths(view: str, lengths: Sequence[Lengths]) -> Iterator[str]:
    """Say that the shadows of a view are longer, or of another form, than the meshes are there."""
    size = middle_of(each.ratio for each in lengths)
    if size is not None and size.off_by(LONGER):
        yield (
            f"shadows in {view} are {size.factor:.2f} times as long as the meshes are there, in "
            f"the median of {size.objects} objects: check views.{view}.source_cm, column_step_cm "
            "and row_step_cm in scanner.toml, how the meshes were scaled, and whether all objects "
            "have a part without a mesh"
        )
    form = middle_of(each.aspect for each in lengths if each.aspect is not None)
    if form is not None and form.off_by(TALLER):
        yield (
            f"shadows in {view} are {form.factor:.3f} times as tall for their width as the meshes "
            f"are there, in the median of {form.objects} objects: check views.{view}.row_step_cm "
            "and column_step_cm in scanner.toml, of which one is off by that beside the other"
        )


def check_folder(
    captures: Path,
    *,
    parts: Path | None = None,
    workers: int,
    on_done: Callable[[str], None] = lambda _: None,
) -> FolderCheck:
    """Check every object of a capture folder.

    Parameters
    ----------
    captures
        The folder.
    parts
        Other part meshes in place of the annotated ones.
    workers
        Number of processes.
    on_done
        Told of each object.

    Raises
    ------
    DataError
        If ``objects.csv`` is missing or wrong.
    """
    folder = CaptureFolder(captures, parts)
    found = []
    for object_id, answer in _answers(folder, workers):
        found.append(_check(object_id, answer))
        on_done(object_id)
    found.sort(key=lambda each: each.object_id)
    return FolderCheck(tuple(_with_same_pictures(found)))


def _answers(folder: CaptureFolder, workers: int) -> Iterable[Answer[str, ObjectCheck]]:
    """Check here where one process is wanted: another one takes seconds to start."""
    task = partial(check_object, folder)
    if workers > 1:
        return run_each(task, folder.object_ids, workers)
    return ((object_id, _tried(task, object_id)) for object_id in folder.object_ids)


def _tried(task: Callable[[str], ObjectCheck], object_id: str) -> ObjectCheck | BaseException:
    """Give what ended the check of an object as other processes give it, and go on."""
    try:
        return task(object_id)
    except Exception as err:
        return err


def _check(object_id: str, answer: ObjectCheck | BaseException) -> ObjectCheck:
    if isinstance(answer, ObjectCheck):
        return answer
    return ObjectCheck(object_id, (Finding("refused", explain(object_id, answer)),))


def _with_same_pictures(objects: Iterable[ObjectCheck]) -> list[ObjectCheck]:
    """Add which radiographs are another one's picture."""
    objects = list(objects)
    places: dict[str, list[tuple[str, str]]] = {}
    for each in objects:
        for view, picture in each.pictures:
            places.setdefault(picture, []).append((each.object_id, view))
    return [
        replace(each, findings=(*each.findings, *_same_pictures(each, places))) for each in objects
    ]


def _same_pictures(one: ObjectCheck, places: Mapping[str, list[tuple[str, str]]]) -> list[Finding]:
    found = []
    for view, picture in one.pictures:
        others = [place for place in places[picture] if place != (one.object_id, view)]
        if others:
            object_id, other = others[0]
            said = f"the picture of {view} is that of {other} of {object_id} too"
            found.append(Finding("contradicts", said))
    return found
