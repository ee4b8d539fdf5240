"""What a fit is told and what it answers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

import numpy as np
from jaxtyping import Float64

from xden1k.errors import DataError

__all__ = [
    "DEFAULT",
    "DEFAULT_ADAM",
    "PAPER_OBJECTIVE",
    "AdamSettings",
    "FitSettings",
    "LacFit",
]

Gain = Literal["free", "fixed"]
Weights = Literal["edge", "none"]


@dataclass(frozen=True, slots=True)
class FitSettings:
    """Choices of the fit.

    Parameters
    ----------
    gain
        ``free``: one open-field factor for each view, told by its air; ``fixed``: 1.
    weights
        ``edge``: a pixel counts by the inverse of its variance, which is noise, a general model
        error, and the misplacement of edges; ``none``: all alike.
    edge_error_px
        How far edges of the model may be off, in pixels (``edge`` only).
    model_error
        What the model leaves out (scatter, beam hardening), in transmission (``edge`` only). It
        also keeps the darkest pixels, where such errors are largest, from ruling the fit.
    reweightings
        Rounds of weights from the model and fit with these weights (``edge`` only).
    upper_per_cm
        Bound on every coefficient; 0 is the lower one. Lead has 63 at 100 keV, gold 100.
    air_margin_px
        Air nearer than this to the object's silhouette is left out.
    air_clip_sd
        Air further than so many robust standard deviations off its median is left out: collimator
        edges, markers, dead pixels.
    max_iterations
        Steps of each Levenberg-Marquardt run.

    Raises
    ------
    DataError
        If a word is unknown or a number out of range.
    """

    gain: Gain = "free"
    weights: Weights = "edge"
    edge_error_px: float = 0.3
    model_error: float = 0.003
    reweightings: int = 3
    upper_per_cm: float = 200.0
    air_margin_px: int = 3
    air_clip_sd: float = 5.0
    max_iterations: int = 50

    def __post_init__(self) -> None:
        for name, words in (("gain", get_args(Gain)), ("weights", get_args(Weights))):
            if getattr(self, name) not in words:
                raise DataError(f"{name} must be one of {words}, got {getattr(self, name)!r}")
        for name in ("edge_error_px", "model_error", "air_margin_px"):
            if not getattr(self, name) >= 0:
                raise DataError(f"{name} must not be negative, got {getattr(self, name)}")
        for name in ("reweightings", "upper_per_cm", "air_clip_sd", "max_iterations"):
            if not getattr(self, name) > 0:
                raise DataError(f"{name} must be positive, got {getattr(self, name)}")


DEFAULT: Final = FitSettings()
PAPER_OBJECTIVE: Final = FitSettings(
    gain="fixed", weights="none", air_margin_px=0, air_clip_sd=np.inf
)
"""The paper's Eq. 7: all pixels of both frames alike, no gain."""


@dataclass(frozen=True, slots=True)
class AdamSettings:
    """Choices of the Adam solver; the paper names none of them.

    Parameters
    ----------
    gain
        Whether each view has an open-field factor; the paper's have none.
    start_per_cm
        Coefficient every part starts from.
    learning_rate_per_cm
        First step of each coefficient. It is halved whenever the loss has not fallen for
        ``patience`` steps, since a constant one circles the optimum at its own size.
    patience
        Steps.
    tolerance
        The fit ends when the loss has changed by less than this share over ``patience`` steps.
    max_steps
        Or after so many steps.
    target_loss
        Or as soon as the loss is at most this: to measure the time to an equal loss.
    upper_per_cm
        Bound on every coefficient; 0 is the lower one.

    Raises
    ------
    DataError
        If a number is not positive.
    """

    gain: bool = False
    start_per_cm: float = 0.2
    learning_rate_per_cm: float = 0.1
    patience: int = 10
    tolerance: float = 1e-7
    max_steps: int = 2000
    target_loss: float | None = None
    upper_per_cm: float = PAPER_OBJECTIVE.upper_per_cm

    def __post_init__(self) -> None:
        for name in (
            "start_per_cm",
            "learning_rate_per_cm",
            "patience",
            "tolerance",
            "max_steps",
            "upper_per_cm",
        ):
            if not getattr(self, name) > 0:
                raise DataError(f"{name} must be positive, got {getattr(self, name)}")


DEFAULT_ADAM: Final = AdamSettings()


@dataclass(frozen=True, slots=True, eq=False)
class LacFit:
    """One linear attenuation coefficient for each part.

    Parameters
    ----------
    lac_per_cm
        Shape (K,); nan for a part that no ray meets.
    lac_sd_per_cm
        Shape (K,): standard deviation, the larger of what the noise and what the residuals say;
        nan for a part that no ray meets. An error of the model that looks like attenuation, such
        as a part drawn too small, is not in it.
    gain
        Shape (V,): open-field factor of each view.
    loss
        Weighted sum of squared residuals of transmission.
    iterations
        Steps taken.
    flags
        For each part: ``hidden`` (no ray meets it), ``uncertain`` (sd above 10 %), ``starved``
        (most of its information comes from pixels darker than three times the noise),
        ``edge_only`` (most comes from pixels on outlines, so it is as good as the alignment),
        ``at_bound`` (0 or the upper bound).
    report
        Of JSON's types: solver, convergence, and for each view the gain, its standard deviation,
        chi² per pixel, the correlation of the model with the measurement over the object, the
        noise and how many pixels were used. None where a number is not known or not finite.
    """

    lac_per_cm: Float64[np.ndarray, "k"]
    lac_sd_per_cm: Float64[np.ndarray, "k"]
    gain: Float64[np.ndarray, "v"]
    loss: float
    iterations: int
    flags: tuple[frozenset[str], ...]
    report: Mapping[str, Any]
