"""Choices of the polychromatic fit: what is modelled, and how far each thing is trusted."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

from xden1k.errors import DataError

__all__ = ["PolySettings"]


@dataclass(frozen=True, slots=True)
class PolySettings:
    """Choices of the polychromatic fit.

    Parameters
    ----------
    gain, stray, pose
        Whether each view has an unknown gain, unknown stray light, and the object an unknown pose.
    edge_weights
        Whether pixels beside an edge count less.
    blocks
        Whether outlines and thin parts are compared in blocks of several pixels, averaged over
        many rays. Without, they are compared pixel by pixel with the ray through its centre.
    composition
        How far what parts are made of may differ from the library's materials, as a multiple of
        what is usual; 0 for not at all.
    edge_error_cm
        How far the image of a surface may be off, on the panel.
    model_share
        Error of -ln T that coefficients, spectrum and scale leave, as a share of it.
    stray_share
        Error of the scatter's shape, as a share of it.
    floor, clear_floor
        Error of T that is left anywhere: where little light comes through, and where much does.
    worth_a_part
        Independent observations that the pixels of two views are worth, for each part: their errors
        hang together, so that thousands of pixels do not tell thousands of times as much as one.
        A further view adds as much as each of the two.
    size
        Whether the size of the object, beside that of its meshes, is sought along with its pose.
    mixture_share
        Share of the variance between materials that remain possible within which the images may
        move a density, once they have told them apart.
    extra_filter_mm_cu, filter_sd_mm_cu
        Copper in the beam beside the told filters, negative where there is less than told, and its
        standard deviation: shared by all objects of a scanner (:mod:`xden_builder.poly.hardness`).
    image_errors, most_image_errors
        Multiple of ``model_share``, ``stray_share`` and ``clear_floor`` by which this object's
        images err, and the most that it may become where residuals say so
        (:mod:`xden_builder.poly.misfit`).

    Raises
    ------
    DataError
        If a number is not finite, or is negative where none can be.
    """

    gain: bool = True
    stray: bool = True
    pose: bool = True
    size: bool = True
    edge_weights: bool = True
    blocks: bool = True
    composition: float = 1.0
    edge_error_cm: float = 0.02
    model_share: float = 0.01
    stray_share: float = 0.15
    floor: float = 0.003
    clear_floor: float = 0.003
    worth_a_part: float = 30.0
    mixture_share: float = 0.1
    extra_filter_mm_cu: float = 0.0
    filter_sd_mm_cu: float = 0.0
    image_errors: float = 1.0
    most_image_errors: float = 1.0

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not math.isfinite(value):
                raise DataError(f"{each.name} must be a finite number, got {value:g}")
            if value < 0 and each.name != "extra_filter_mm_cu":
                raise DataError(f"{each.name} must not be negative, got {value:g}")
        if not (self.floor and self.clear_floor and self.worth_a_part):
            raise DataError("floors and worth_a_part must be above zero")
        if not (self.image_errors and self.most_image_errors >= 1):
            raise DataError("image_errors must be above zero and most_image_errors at least 1")
