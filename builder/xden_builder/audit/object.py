"""One object of a dataset against its capture, by what the dataset keeps alone.

Two checks. *Reprojection*: the stored meshes and attenuations are projected again and compared
with the radiographs. *CT*: where a capture has a computed tomogram, the attenuation is compared
voxel by voxel. So they check storage too; audit views, which no fit has seen, are compared where
there are any.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from xden1k.errors import DataError
from xden1k.rays import path_lengths
from xden1k.values.types import DensityObject
from xden1k.values.views import ViewGeometry, XRayView
from xden_builder.audit.ct import CTAudit, audit_ct
from xden_builder.audit.replay import replayed
from xden_builder.audit.view import ViewAudit, audit_image, audit_view, noise_floor, pixel_sets
from xden_builder.capture import Capture, CTReference
from xden_builder.capture.saturation import completed
from xden_builder.poly.model.frames import Pose, posed

__all__ = ["ObjectAudit", "audit_object"]


@dataclass(frozen=True, slots=True)
class ObjectAudit:
    """Everything the audit says of one object.

    Parameters
    ----------
    object_id
        Which.
    views
        One for each radiograph of the capture, fitted views first.
    ct
        None where the capture has no CT.
    """

    object_id: str
    views: tuple[ViewAudit, ...]
    ct: CTAudit | None

    @property
    def good(self) -> bool:
        """Whether every view shows these parts, but for audit views they lie outside of."""
        return all(
            view.good or (view.verdict == "not seen" and not view.fitted) for view in self.views
        )

    def to_dict(self) -> dict[str, Any]:
        """Values for JSON."""
        return asdict(self) | {"good": self.good}


def audit_object(
    obj: DensityObject, capture: Capture, ct: CTReference | None = None, subrays: int = 3
) -> ObjectAudit:
    """Audit one object of a dataset against its capture.

    Parameters
    ----------
    obj
        From the dataset.
    capture
        What it was made from, with any audit views.
    ct
        The capture's CT, if it has one.
    subrays
        Rays along each side of a pixel.

    Raises
    ------
    DataError
        If a radiograph has other rows and columns than the dataset's.
    """
    meshes = [part.mesh for part in obj.parts]  # they do not overlap, so any order will do
    lac = np.array([part.lac_per_cm for part in obj.parts])
    lac = np.nan_to_num(lac)  # a part that no ray met has none, and darkens no pixel
    gains: Mapping[str, float] = obj.meta["fit"]["gain"]
    refined = {view.name: view.geometry for view in obj.views}
    pose = obj.meta.get("poly", {}).get("pose")
    views = []
    for taken in capture.all_views:
        view, saturated = completed(taken, capture.at_least.get(taken.name))
        geometry = refined.get(view.name, view.geometry)
        if view.name not in refined and pose is not None:
            geometry = _posed(geometry, view.name, pose)
        _check_alike(capture.object_id, view, geometry)
        lengths = path_lengths(meshes, range(len(meshes)), geometry, subrays)
        floor, gain = noise_floor(capture, view.name), gains.get(view.name)
        if "poly" not in obj.meta:
            views.append(
                audit_view(view, lengths, lac, gain=gain, floor=floor, saturated=saturated)
            )
            continue
        fitted, (_, beside) = gain is not None, pixel_sets(view, lengths)
        model, gain = replayed(obj, capture, view, geometry, lengths, beside)
        views.append(
            audit_image(
                view,
                lengths,
                model,
                gain=gain,
                floor=floor,
                fitted=fitted,
                saturated=saturated,
            )
        )
    return ObjectAudit(
        obj.object_id, tuple(views), None if ct is None else audit_ct(meshes, lac.tolist(), ct)
    )


def _check_alike(object_id: str, view: XRayView, geometry: ViewGeometry) -> None:
    if view.transmission.shape != geometry.shape:
        rows, columns = geometry.shape
        raise DataError(
            f"{object_id}: view {view.name} has {view.geometry.shape[0]} x "
            f"{view.geometry.shape[1]} pixels, and {rows} x {columns} in the dataset, which was "
            "not made from this capture"
        )


def _posed(geometry: ViewGeometry, name: str, kept: Mapping[str, Any]) -> ViewGeometry:
    """Move the scanner of a view that the dataset does not hold by the pose it was fitted in.

    An audit view has the pose that views share; its rows are believed.
    """
    own: dict[str, Any] | None = kept.get("views", {}).get(name)
    return posed(geometry, Pose.from_dict(own or dict(kept)), shifted_rows=own is not None)
