"""Masses against the scale: where each weighed object lies on a chart."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from xden_builder.triage.card import Card
from xden_builder.triage.findings import Findings

__all__ = ["Chart", "chart"]

WIDTH: Final = 640
HEIGHT: Final = 220
LEFT: Final = 56
BOTTOM: Final = 34
MARGIN: Final = 12
FARTHEST: Final = 2.0
"""Ratio of the masses at the edge: what is farther off is drawn there."""
RATIOS: Final = (0.5, 0.8, 1.0, 1.25, 2.0)


@dataclass(frozen=True, slots=True)
class Dot:
    """One object: its place, and the ends of its standard deviation, in pixels."""

    object_id: str
    severity: str
    words: str
    x: float
    y: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class Chart:
    """Mass by the images over that on the scale, against the latter; both logarithmic.

    Parameters
    ----------
    width, height, left, bottom, margin
        Of the drawing, in pixels.
    dots
        The objects.
    ratios, masses
        Label and place of the lines across, and of those upwards.
    """

    width: int
    height: int
    left: int
    bottom: int
    margin: int
    dots: tuple[Dot, ...]
    ratios: tuple[tuple[str, float], ...]
    masses: tuple[tuple[str, float], ...]


def chart(cards: Iterable[Card]) -> Chart | None:
    """Place every object that was weighed; None where none was.

    The mass by the images is that of a fit without the scale where there is one, else the mass.
    """
    weighed = [card.findings for card in cards if _masses(card.findings)]
    if not weighed:
        return None
    logs = [math.log10(found.weighed_mass_g) for found in weighed if found.weighed_mass_g]
    low, high = math.floor(min(logs)), math.floor(max(logs)) + 1

    def across(log_mass: float) -> float:
        return LEFT + (WIDTH - LEFT - MARGIN) * (log_mass - low) / (high - low)

    return Chart(
        *(WIDTH, HEIGHT, LEFT, BOTTOM, MARGIN),
        dots=tuple(_dot(found, across(log)) for found, log in zip(weighed, logs, strict=True)),
        ratios=tuple((f"{ratio:g}", _upwards(ratio)) for ratio in RATIOS),
        masses=tuple((f"{10.0**log:g} g", across(log)) for log in range(low, high + 1)),
    )


def _masses(found: Findings) -> tuple[float, float, float] | None:
    """Return the mass by the images, its standard deviation, and the mass on the scale."""
    weighing = found.weighing or {}
    by_images = weighing.get("by_images_g", found.mass_g)
    sd = weighing.get("by_images_sd_g", found.mass_sd_g)
    if not found.weighed_mass_g or math.isnan(by_images):
        return None
    return by_images, 0.0 if math.isnan(sd) else sd, found.weighed_mass_g


def _dot(found: Findings, x: float) -> Dot:
    masses = _masses(found)
    assert masses is not None
    by_images, sd, weighed = masses
    return Dot(
        object_id=found.object_id,
        severity=found.severity or "",
        words=f"{found.object_id}: {by_images:.4g} ± {sd:.2g} g by the images, {weighed:.4g} g",
        x=x,
        y=_upwards(by_images / weighed),
        low=_upwards((by_images - sd) / weighed),
        high=_upwards((by_images + sd) / weighed),
    )


def _upwards(ratio: float) -> float:
    """Place of a ratio, in pixels from the top."""
    share = math.log(max(ratio, 1 / FARTHEST)) / math.log(FARTHEST)
    middle = (HEIGHT - BOTTOM + MARGIN) / 2
    return middle - min(share, 1.0) * (middle - MARGIN)
