"""How well a dataset explains the captures it was made from.

Two checks. *Reprojection*: the stored meshes and attenuations are projected again and compared
with the radiographs, in transmission T and in attenuation p = -ln T. *CT*: where a capture has a
computed tomogram, the attenuation is compared voxel by voxel. Both use the dataset alone, so
they check storage too; audit views, which no fit has seen, are compared where there are any.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
import trimesh
from jaxtyping import Bool, Float

from xden1k.rays import CubeGrid, PathLengths, part_fractions, path_lengths
from xden1k.values.arrays import Image, Vec3
from xden1k.values.types import DensityObject
from xden1k.values.views import XRayView
from xden_builder.capture import Capture, CTReference
from xden_builder.poly.image import replayed
from xden_builder.poly.pose import Pose, posed

__all__ = [
    "GOOD_CORRELATION",
    "CTAudit",
    "ObjectAudit",
    "ViewAudit",
    "audit_ct",
    "audit_image",
    "audit_object",
    "audit_view",
    "noise_floor",
]

GOOD_CORRELATION = 0.9
"""Below this correlation of transmission on the object a view does not show these parts."""
WITHIN_NOISE = 2.0
"""A view whose error on the object is below so many times that beside it fits, whatever the
correlation."""
SMALLEST_TRANSMISSION = 1 / 65535
"""One count of a 16-bit detector: the floor of T in -ln T where no dark image tells the noise."""


@dataclass(frozen=True, slots=True)
class ViewAudit:
    """Reprojection error of one view.

    Errors on the object are over valid pixels whose ray meets a part, those of the background
    over all other valid pixels. A correlation is Pearson's; nan where either image is constant.

    Parameters
    ----------
    name
        The view's.
    fitted
        False for an audit view, which the fit has not seen.
    gain
        Open-field factor of the model: the fit's, or for an audit view the median transmission
        of the background, 1 if it has none.
    transmission_mae, transmission_corr
        On the object, in T.
    attenuation_mae, attenuation_corr
        On the object, in -ln T with T no smaller than the view's noise floor.
    background_transmission_mae, background_attenuation_mae
        Beside the object.
    object_pixels
        Number of pixels compared on the object.
    """

    name: str
    fitted: bool
    gain: float
    transmission_mae: float
    transmission_corr: float
    attenuation_mae: float
    attenuation_corr: float
    background_transmission_mae: float
    background_attenuation_mae: float
    object_pixels: int

    @property
    def verdict(self) -> Literal["good", "bad", "not seen"]:
        """Whether the parts are where the image shows them."""
        if not self.object_pixels:
            return "not seen"
        noise = float(np.nan_to_num(self.background_transmission_mae))
        # a slab that hardly varies correlates badly even where it is right
        fits = self.transmission_mae <= WITHIN_NOISE * noise
        return "good" if fits or self.transmission_corr >= GOOD_CORRELATION else "bad"

    @property
    def good(self) -> bool:
        """Whether the parts are where the image shows them."""
        return self.verdict == "good"


def audit_view(
    view: XRayView,
    lengths: PathLengths,
    lac_per_cm: Float[np.ndarray, "parts"],
    *,
    gain: float | None,
    floor: float,
) -> ViewAudit:
    """Compare one radiograph with the model of one attenuation coefficient for each part.

    Parameters
    ----------
    view
        The measured image.
    lengths
        Path lengths of the parts in this view.
    lac_per_cm
        Shape (parts,): the attenuation to check.
    gain
        Open-field factor; None for an audit view, which takes it from its background.
    floor
        Smallest transmission that is told from none: three times the noise of the dark image.
    """
    fitted = gain is not None
    if gain is None:
        gain = _background_gain(view, lengths)
    model = lengths.image(lac_per_cm, gain)
    return audit_image(view, lengths, model, gain=gain, floor=floor, fitted=fitted)


def audit_image(
    view: XRayView,
    lengths: PathLengths,
    model: Image,
    *,
    gain: float,
    floor: float,
    fitted: bool = True,
) -> ViewAudit:
    """Compare one radiograph with a model image of it.

    Parameters
    ----------
    view
        The measured image.
    lengths
        Path lengths of the parts in this view.
    model
        Shape (rows, columns): transmission.
    gain
        Open-field factor of the model.
    floor
        As of :func:`audit_view`.
    fitted
        Whether the model was fitted to this view.
    """
    on_object, background = _pixel_sets(view, lengths)
    inside = _errors(view.transmission[on_object], model[on_object], floor)
    outside = _errors(view.transmission[background], model[background], floor)
    return ViewAudit(
        name=view.name,
        fitted=fitted,
        gain=gain,
        transmission_mae=inside[0],
        transmission_corr=inside[1],
        attenuation_mae=inside[2],
        attenuation_corr=inside[3],
        background_transmission_mae=outside[0],
        background_attenuation_mae=outside[2],
        object_pixels=int(on_object.sum()),
    )


def _pixel_sets(
    view: XRayView, lengths: PathLengths
) -> tuple[Bool[np.ndarray, "rows columns"], Bool[np.ndarray, "rows columns"]]:
    """Split the valid pixels into those on the object and those beside it."""
    hit = np.zeros(view.transmission.shape, dtype=bool)
    hit.flat[lengths.pixels] = True
    broken = np.zeros_like(hit)
    broken.flat[lengths.pixels[lengths.broken]] = True
    return hit & view.valid & ~broken, ~hit & view.valid


def _background_gain(view: XRayView, lengths: PathLengths) -> float:
    """Median transmission beside the object; 1 where there is nothing beside it."""
    _, background = _pixel_sets(view, lengths)
    return float(np.median(view.transmission[background])) if background.any() else 1.0


def _errors(
    measured: Float[np.ndarray, "n"], model: Float[np.ndarray, "n"], floor: float
) -> tuple[float, float, float, float]:
    """MAE and correlation in transmission, MAE and correlation in attenuation."""
    if not measured.size:
        return (np.nan,) * 4
    pair = np.stack([measured, model]).astype(np.float64)
    attenuation = -np.log(np.maximum(pair, floor))
    return (_mae(pair), _correlation(pair), _mae(attenuation), _correlation(attenuation))


def _mae(pair: Float[np.ndarray, "2 n"]) -> float:
    return float(np.abs(pair[0] - pair[1]).mean())


def _correlation(pair: Float[np.ndarray, "2 n"]) -> float:
    if (np.ptp(pair, axis=1) < 1e-6).any():  # constant but for rounding to single precision
        return np.nan
    return float(np.corrcoef(pair)[0, 1])


@dataclass(frozen=True, slots=True)
class CTAudit:
    """Attenuation of an object against a CT of it.

    The model of a voxel is the attenuation of each part times the share of the voxel it fills.
    The first three figures are over the labelled voxels of the CT, or over all where none are.

    Parameters
    ----------
    voxel_mae_per_cm
        Mean absolute difference of model and CT.
    voxel_mae_rel
        The same by the mean of the CT.
    mass_ratio
        Sum of the model by the sum of the CT.
    com_l1_cm
        Sum of the three absolute differences of the attenuation-weighted centre.
    mass_ratio_whole_grid
        Sum of the model by the sum of the CT over every voxel.
    """

    voxel_mae_per_cm: float
    voxel_mae_rel: float
    mass_ratio: float
    com_l1_cm: float
    mass_ratio_whole_grid: float


def audit_ct(
    meshes: Sequence[trimesh.Trimesh], lac_per_cm: Sequence[float], ct: CTReference
) -> CTAudit:
    """Compare parts that do not overlap with a CT.

    Parameters
    ----------
    meshes
        In the frame of the CT.
    lac_per_cm
        One for each mesh.
    ct
        The reference; its voxels need not be cubes.
    """
    model = _on_ct_grid(meshes, lac_per_cm, ct)
    inside = np.ones(model.shape, dtype=bool) if ct.labels is None else ct.labels > 0
    reference = np.where(inside, ct.mu_per_cm, 0).astype(np.float64)
    mae = float(np.abs(model - ct.mu_per_cm)[inside].mean())
    apart = _centre(np.where(inside, model, 0), ct) - _centre(reference, ct)
    return CTAudit(
        voxel_mae_per_cm=mae,
        voxel_mae_rel=mae / float(ct.mu_per_cm[inside].mean()),
        mass_ratio=float(model[inside].sum() / reference.sum()),
        com_l1_cm=float(np.abs(apart).sum()),
        mass_ratio_whole_grid=float(model.sum() / ct.mu_per_cm.sum(dtype=np.float64)),
    )


def _on_ct_grid(
    meshes: Sequence[trimesh.Trimesh], lac_per_cm: Sequence[float], ct: CTReference
) -> Float[np.ndarray, "x y z"]:
    """Voxel means of the parts' attenuation, in the CT's voxels stretched to cubes."""
    in_voxels = [
        trimesh.Trimesh((mesh.vertices - ct.origin_cm) / ct.spacing_cm, mesh.faces, process=False)
        for mesh in meshes
    ]
    cube = CubeGrid(np.zeros(3), 1.0, max(ct.mu_per_cm.shape))
    model = np.zeros(ct.mu_per_cm.shape)
    fills = part_fractions(in_voxels, range(len(meshes)), cube)
    for fill, lac in zip(fills, lac_per_cm, strict=True):
        part = model[fill.where]  # cut where the part reaches beyond a CT that is no cube
        x, y, z = part.shape
        part += lac * fill.share[:x, :y, :z]
    return model


def _centre(weight: Float[np.ndarray, "x y z"], ct: CTReference) -> Vec3:
    means = [
        np.arange(weight.shape[axis]) @ weight.sum(axis=tuple({0, 1, 2} - {axis}))
        for axis in range(3)
    ]
    return np.asarray(ct.origin_cm + ct.spacing_cm * np.array(means) / weight.sum())


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


def noise_floor(capture: Capture, view: str) -> float:
    """Smallest transmission that is told from none: three times the noise of the dark image."""
    return max(3 * capture.noise_sd.get(view, 0.0), SMALLEST_TRANSMISSION)


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
    """
    meshes = [part.mesh for part in obj.parts]  # they do not overlap, so any order will do
    lac = np.array([part.lac_per_cm for part in obj.parts])
    lac = np.nan_to_num(lac)  # a part that no ray met has none, and darkens no pixel
    gains: Mapping[str, float] = obj.meta["fit"]["gain"]
    refined = {view.name: view.geometry for view in obj.views}
    turned = obj.meta.get("poly", {}).get("pose")
    views = []
    for view in (*capture.views, *capture.audit_views):
        geometry = refined.get(view.name, view.geometry)
        if view.name not in refined and turned is not None:
            geometry = posed(geometry, Pose.from_dict(turned), shifted_rows=False)
        lengths = path_lengths(meshes, range(len(meshes)), geometry, subrays)
        floor, gain = noise_floor(capture, view.name), gains.get(view.name)
        if "poly" not in obj.meta:
            views.append(audit_view(view, lengths, lac, gain=gain, floor=floor))
            continue
        fitted, (_, beside) = gain is not None, _pixel_sets(view, lengths)
        model, gain = replayed(obj, capture, view, geometry, lengths, beside)
        views.append(audit_image(view, lengths, model, gain=gain, floor=floor, fitted=fitted))
    return ObjectAudit(
        obj.object_id, tuple(views), None if ct is None else audit_ct(meshes, lac.tolist(), ct)
    )
