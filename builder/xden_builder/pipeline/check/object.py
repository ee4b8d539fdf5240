"""One object of a capture folder, as far as it can be judged without a fit."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final, Literal, NamedTuple, TypeVar

import numpy as np

from xden1k.errors import XDenError
from xden1k.rays import PathLengths, path_lengths
from xden1k.values.views import XRayView
from xden_builder.capture import Capture, CaptureFolder, read_image
from xden_builder.capture.space import Space, divide
from xden_builder.physics.groups import energy_groups
from xden_builder.pipeline.check.outlines import Lengths, contradictions, outline, shadow_lengths
from xden_builder.pipeline.check.weight import weight_contradiction
from xden_builder.reconstruct.plausible import (
    check_exposure,
    check_places,
    check_size,
)
from xden_builder.reconstruct.settings import BuildSettings
from xden_builder.registration.capture import registered
from xden_builder.registration.placement import Registration
from xden_builder.triage.flags import flag_kind

__all__ = ["Finding", "Kind", "ObjectCheck", "check_object"]

Kind = Literal["refused", "contradicts"]
Result = TypeVar("Result")

SUBRAYS: Final = BuildSettings().subrays
"""Of a rebuild: what it refuses is judged by its rays."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that is wrong.

    Parameters
    ----------
    kind
        ``refused``: a rebuild would not take it; ``contradicts``: it would, but what was told
        cannot all be true.
    message
        One line.
    """

    kind: Kind
    message: str


@dataclass(frozen=True, slots=True)
class ObjectCheck:
    """What was found of one object.

    Parameters
    ----------
    object_id
        Which.
    findings
        Nothing where it is sound as far as can be told.
    pictures
        Checksum of the pixels of each radiograph, by view.
    lengths
        By view, how long its shadow is beside the outline of the parts; without views that tell
        nothing, and those before which the object was turned by hand.
    """

    object_id: str
    findings: tuple[Finding, ...]
    pictures: tuple[tuple[str, str], ...] = ()
    lengths: tuple[tuple[str, Lengths], ...] = ()


def check_object(folder: CaptureFolder, object_id: str) -> ObjectCheck:
    """Read an object as a rebuild would, and look whether it hangs together."""
    refused: list[str] = []
    capture = _read(folder, object_id, refused)
    if capture is None:
        return ObjectCheck(object_id, tuple(Finding("refused", said) for said in refused))
    judged = _judged(capture, refused)
    contradicting = *judged.contradicting, *_ct(folder, object_id)
    findings = [
        *(Finding("refused", said) for said in refused),
        *(Finding("contradicts", said) for said in contradicting),
    ]
    return ObjectCheck(
        object_id, tuple(findings), _pictures(folder.images(object_id)), judged.lengths
    )


def _read(folder: CaptureFolder, object_id: str, refused: list[str]) -> Capture | None:
    """Read everything; where that fails early, the parts are tried as well."""
    capture = _tried(folder.read, object_id, refused)
    if capture is None:
        _tried(folder.parts, object_id, refused)
    return None if refused else capture


def _ct(folder: CaptureFolder, object_id: str) -> list[str]:
    """Say what is wrong with a CT reference, which a rebuild does not read."""
    said: list[str] = []
    _tried(folder.ct, object_id, said)
    return [f"{each} (`xden-build audit` reads it, a rebuild does not)" for each in said]


def _tried(read: Callable[[str], Result], object_id: str, refused: list[str]) -> Result | None:
    """Return what is read, or None with the reason among those for a refusal."""
    try:
        return read(object_id)
    except (XDenError, OSError) as err:
        if str(err) not in refused:
            refused.append(str(err))
    return None


class _Judged(NamedTuple):
    """What a capture contradicts itself by, and how long its shadows are."""

    contradicting: tuple[str, ...] = ()
    lengths: tuple[tuple[str, Lengths], ...] = ()


def _judged(capture: Capture, refused: list[str]) -> _Judged:
    """Find contradictions, and add what a rebuild refuses."""
    try:
        _check_source(capture)
        there = registered(capture)
        capture = there.capture
        check_places(capture.parts, capture.fitted_views)
        space = divide(capture.parts)
        volumes_cm3 = space.volumes_cm3.tolist()
        meshes = [part.mesh for part in capture.parts]
        seen = [outline(view, capture.at_least.get(view.name), meshes) for view in capture.views]
        (pa, _), (lat, _) = seen
        check_size(capture.parts, capture.views, [level for _, level in seen])
        check_exposure((view, _lengths(space, view)) for view in capture.fitted_views)
    except XDenError as err:
        refused.append(str(err))
        return _Judged()
    turned = lat.name in capture.turned
    found = _of_pose(there.registration) or list(contradictions(pa, lat, turned=turned))
    if capture.weighed_mass_g is not None:
        said = weight_contradiction(capture.weighed_mass_g, capture.parts, volumes_cm3)
        found += [said] if said else []
    lengths = [(view.name, shadow_lengths(view)) for view in (pa, lat)[: 1 if turned else 2]]
    return _Judged(tuple(found), tuple((name, each) for name, each in lengths if each is not None))


def _lengths(space: Space, view: XRayView) -> PathLengths:
    """Cast the rays of a rebuild; one a pixel where too few are dead to be half of what it meets.

    More rays meet those pixels and others, and take several times as long.
    """
    rays = partial(path_lengths, space.meshes, space.order, view.geometry)
    fewer = rays(1)
    return fewer if 2 * np.count_nonzero(~view.valid) <= len(fewer.pixels) else rays(SUBRAYS)


def _of_pose(registration: Registration | None) -> list[str]:
    """Say that meshes and shadows do not go together in any pose."""
    raised = () if registration is None else registration.flags
    return [
        f"{flag}: {flag_kind(flag).meaning}"
        for flag in ("mirrored", "pose_not_found", "shape_differs")
        if flag in raised
    ]


def _check_source(capture: Capture) -> None:
    """Refuse a source that the tables do not know."""
    tube = capture.tube
    if tube is not None and tube.kv is not None:
        energy_groups(tube, capture.detector)


def _pictures(images: Mapping[str, Path]) -> tuple[tuple[str, str], ...]:
    """Return a digest of each picture as it was taken: flats may differ before one handed twice."""
    return tuple(
        (view, hashlib.sha256(read_image(path).pixels.tobytes()).hexdigest())
        for view, path in images.items()
    )
