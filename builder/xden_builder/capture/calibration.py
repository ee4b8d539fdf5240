"""Raw images into transmission: dark and open field, polarity, dead and saturated pixels.

T = (value - dark) / (flat - dark) stays the same when all three are turned over. The polarity only
decides which end of the range is saturation, on which side of the dark the open field must lie, and
what the dark would hold where none was taken.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Shaped

from xden1k.errors import DataError
from xden1k.values.arrays import Image, Mask
from xden1k.values.views import XRayView
from xden_builder.capture.formats import read_image
from xden_builder.capture.images import ImageFile, Polarity
from xden_builder.capture.saturation import Field, brighter_than_light
from xden_builder.capture.scanner import ViewFile
from xden_builder.physics.source import Detector

__all__ = ["CalibratedView", "calibrate", "read_sized"]

LEAST_OPEN_FIELD = 0.01
"""A pixel whose open field is a smaller share of the median one is dead or collimated."""
BRIGHT, LIT_SHARE, LEAST_LIT = 0.98, 0.2, 0.05
"""Of an open field: the quantile that is bright, as what share of it a pixel is lit, and how many
must be: behind a collimator none are."""
FLAGGED_DEAD_SHARE = 0.01
"""Every detector has some dead pixels; a larger share is flagged."""
MOST_MEDIAN_TRANSMISSION = 2.0
"""Air is about 1: a larger median is a wrong quantity, polarity or open field."""
LEAST_COUNTS_SHARE = 1e-3
"""Share of the open field: floating-point pixels that are all less are no counts."""
OPAQUE = 0.02
"""Transmission below which hardly any light comes straight through."""
BELOW_DARK, BELOW_DARK_SIGMAS, BELOW_DARK_LEAST = 0.005, 4.0, 100
"""A dark image is too bright if so many opaque pixels lie so much below it in the median, and so
many of its standard errors: light that is scattered makes them brighter, noise neither."""
CONVERTER_BITS = range(8, 17)
PILED_SHARE = 0.001
PILED_LEAST = 200
PILED = 5.0
NEXT_VALUES = 8
"""A converter ends where so large a share of the pixels, and so many, hold a value that one ends
at, this many times as many as any of the next few values below: noise piles nothing up."""
FLOOR_SIGMAS = 3.0
"""No transmission above so many standard deviations of the noise: the image is empty."""


@dataclass(frozen=True, slots=True, eq=False)
class CalibratedView:
    """A radiograph as transmission, and what was noticed on the way.

    Parameters
    ----------
    view
        Transmission, not a number where a pixel is not valid.
    flags
        ``VIEW:saturated`` where a pixel is, ``VIEW:saturated_flat`` where one of the open field is,
        ``VIEW:dark_too_bright`` where opaque pixels lie clearly below the dark in the median,
        ``VIEW:dead_pixels`` where over 1 % have no open field or are brighter than light,
        ``VIEW:polarity_not_as_dicom`` where the scanner file says the contrary of the image's
        header.
    noise_sd
        Standard deviation of the transmission behind something opaque: the spread of the dark
        image, rounding of integers included, over the median open field. A fixed pattern of the
        detector adds to it, averaging many dark frames hides some. None without a dark image.
    open_field
        Shape (rows, columns): light of the bare beam above the dark, in the image's own units;
        None where no flat image was taken.
    at_least
        Shape (rows, columns): transmission that a saturated pixel reaches at least, not a number
        elsewhere; None where no pixel is saturated.
    """

    view: XRayView
    flags: tuple[str, ...]
    noise_sd: float | None
    open_field: Image | None = None
    at_least: Image | None = None


def calibrate(
    name: str, stored: ViewFile, object_folder: Path, captures: Path, detector: Detector
) -> CalibratedView:
    """Read one view as transmission.

    Parameters
    ----------
    name
        Of the view.
    stored
        What the scanner file says of it.
    object_folder, captures
        What the path of the image, and those of flat and dark, are relative to.
    detector
        Without its ``bits``, or where they are too many, a pixel of linear counts is called
        saturated if values pile up where a converter of fewer bits ends.

    Raises
    ------
    DataError
        If a file is missing or damaged, a shape differs from the scanner file's, or the image is
        empty, saturated wherever it is not dead, or not what ``quantity`` and ``polarity`` say.
    MissingExtraError
        If a package that decoding needs is not installed.
    """
    image = _read_sized(object_folder / stored.image, stored)
    values = image.pixels.astype(np.float64)
    if values.min() == values.max():
        raise DataError(
            f"{image.path}: the image is empty or saturated: every pixel holds {values[0, 0]:g}"
        )
    if stored.quantity == "counts":
        return _from_counts(name, image, stored, captures, detector.bits)
    if image.pixels.dtype.kind != "f":
        raise DataError(
            f"{image.path}: {stored.quantity} needs floating-point pixels, got "
            f"{image.pixels.dtype}: integers are counts"
        )
    with np.errstate(over="ignore"):  # infinity is refused as a transmission below
        transmission = values if stored.quantity == "transmission" else np.exp(-values)
    none = np.zeros(transmission.shape, dtype=np.bool_)
    too_bright = brighter_than_light(transmission, none)
    transmission[too_bright] = np.nan
    flags = (f"{name}:dead_pixels",) if too_bright.mean() > FLAGGED_DEAD_SHARE else ()
    return _checked(name, image.path, stored, transmission, none, None, flags)


def _from_counts(
    name: str, image: ImageFile, stored: ViewFile, captures: Path, bits: int | None
) -> CalibratedView:
    if image.intensity_relation in ("LOG", "DISP"):
        raise DataError(
            f"{image.path}: counts must be linear in photons, but the header says "
            f"PixelIntensityRelationship {image.intensity_relation}"
        )
    polarity = stored.polarity or image.polarity
    assert polarity is not None  # read_scanner leaves it to DICOM images only
    assert stored.flat is not None  # and demands a flat of counts
    flat = _level(stored.flat, captures, stored)
    dark = _dark(image, stored, captures, polarity, bits)
    light = flat - dark if polarity == "linear" else dark - flat
    usual_light = _usual_light(light, f"{image.path}: views.{name}.polarity is {polarity}")
    if (
        image.pixels.dtype.kind == "f"
        and np.abs(image.pixels).max() < LEAST_COUNTS_SHARE * usual_light
    ):
        raise DataError(
            f"{image.path}: expected counts like those of the flat, about {usual_light:.3g}, got "
            f"fractions of at most {image.pixels.max():.3g}: tell views.{name}.quantity as "
            "transmission or attenuation"
        )
    dead = light <= LEAST_OPEN_FIELD * usual_light
    saturated = _saturated(image, polarity, bits) & ~dead
    transmission = np.full_like(flat, np.nan)
    np.divide(image.pixels - dark, flat - dark, out=transmission, where=~dead)
    too_bright = brighter_than_light(transmission, saturated)
    transmission[too_bright], saturated = np.nan, saturated & ~too_bright
    has_frame = isinstance(stored.dark, str)
    noise_sd = _noise_counts(image, dark) / usual_light if has_frame else None
    taken = isinstance(stored.flat, str)
    raised = {
        "saturated": saturated.any(),
        "saturated_flat": taken and _at_bright_end(flat, image, polarity, bits).any(),
        "dark_too_bright": _lies_below(transmission),
        "dead_pixels": (dead | too_bright).mean() > FLAGGED_DEAD_SHARE,
        "polarity_not_as_dicom": image.polarity not in (None, polarity),
    }
    flags = tuple(f"{name}:{flag}" for flag, is_raised in raised.items() if is_raised)
    seen = _checked(name, image.path, stored, transmission, saturated, noise_sd, flags)
    return replace(seen, open_field=light.astype(np.float32) if taken else None)


def _lies_below(transmission: Field) -> bool:
    """Whether what lets no light through lets less than none through, by more than noise."""
    opaque = transmission[transmission < OPAQUE]
    if opaque.size < BELOW_DARK_LEAST:
        return False
    error = BELOW_DARK_SIGMAS * float(opaque.std()) / np.sqrt(opaque.size)
    return bool(np.median(opaque) < -BELOW_DARK - error)


def _usual_light(light: Field, said: str) -> float:
    """Return the median open field above the dark, which must be one, where any light falls."""
    sample = _sample(light)
    low, bright = np.quantile(sample, (1 - BRIGHT, BRIGHT))
    lit = sample[sample > max(LIT_SHARE * bright, 0)]
    if lit.size < LEAST_LIT * sample.size or -low > LIT_SHARE * bright:  # noise alone is both
        raise DataError(
            f"{said}, but most of the open field (flat) is no brighter than the dark: expected the "
            "flat brighter, so flat and dark are exchanged, or it is the other polarity"
        )
    return float(np.median(lit))


def _checked(
    name: str,
    path: Path,
    stored: ViewFile,
    transmission: Field,
    saturated: Mask,
    noise_sd: float | None,
    flags: tuple[str, ...],
) -> CalibratedView:
    """Refuse what no radiograph of an object looks like."""
    told = ~np.isnan(transmission)
    if not (told & ~saturated).any():
        raise DataError(f"{path}: the image is saturated: {saturated.mean():.0%} of its pixels")
    median, brightest = np.quantile(_sample(transmission[told]), (0.5, 0.99), method="lower")
    if brightest <= FLOOR_SIGMAS * (noise_sd or 0.0):
        raise DataError(
            f"{path}: the image is empty: its brightest transmission is {brightest:.2g}"
        )
    if median > MOST_MEDIAN_TRANSMISSION:
        raise DataError(
            f"{path}: the median transmission is {median:.3g}, but air is about 1: expected "
            f"another quantity, polarity or open field in scanner.toml, views.{name}"
        )
    with np.errstate(over="ignore"):  # XRayView refuses infinity
        image = transmission.astype(np.float32)
    nothing = np.float32(np.nan)
    return CalibratedView(
        XRayView(name, np.where(saturated, nothing, image), told & ~saturated, stored.geometry),
        flags,
        noise_sd,
        at_least=np.where(saturated, image, nothing) if saturated.any() else None,
    )


def _read_sized(path: Path, stored: ViewFile) -> ImageFile:
    """Read an image that must have the shape of the scanner file."""
    return read_sized(path, stored.geometry.shape, " (shape in scanner.toml)")


def read_sized(path: Path, shape: tuple[int, int], why: str) -> ImageFile:
    """Read an image that must have a shape.

    Raises
    ------
    DataError
        If it has another; the line goes on with why after what was expected.
    """
    image = read_image(path)
    if image.pixels.shape != shape:
        expected, got = (f"{rows} x {columns}" for rows, columns in (shape, image.pixels.shape))
        raise DataError(f"{path}: expected {expected} pixels{why}, got {got}")
    return image


def _level(source: str | float, captures: Path, stored: ViewFile) -> Field:
    """Return an open field or a dark as an image, whether it is one or a single value."""
    if isinstance(source, str):
        return _read_sized(captures / source, stored).pixels.astype(np.float64)
    return np.full(stored.geometry.shape, source)


def _dark(
    image: ImageFile, stored: ViewFile, captures: Path, polarity: Polarity, bits: int | None
) -> Field:
    """Return what the converter holds without light; without a dark, the end of its range."""
    if stored.dark is not None:
        return _level(stored.dark, captures, stored)
    bits = bits or image.bits
    if polarity == "inverted" and bits is None:
        raise DataError(f"{image.path}: inverted counts need dark, dark_value or detector.bits")
    low, high = image.converter_range(bits or 1)
    return np.full(stored.geometry.shape, low if polarity == "linear" else high)


def _saturated(image: ImageFile, polarity: Polarity, bits: int | None) -> Mask:
    """Return where the image is at the bright end of the converter, whose range it must keep."""
    if bits is not None:
        low, high = image.converter_range(bits)
        if image.pixels.min() < low or image.pixels.max() > high:
            raise DataError(
                f"{image.path}: {bits} bits hold {low:g} to {high:g}, but the pixels are "
                f"{image.pixels.min():g} to {image.pixels.max():g}"
            )
    return _at_bright_end(image.pixels, image, polarity, bits)


def _at_bright_end(
    values: Shaped[np.ndarray, "rows columns"],
    image: ImageFile,
    polarity: Polarity,
    bits: int | None,
) -> Mask:
    """Return which values are as bright as the converter of an image can tell."""
    if polarity == "inverted":
        low = -np.inf if bits is None else image.converter_range(bits)[0]
        return np.asarray(values <= low)
    high = np.inf if bits is None else image.converter_range(bits)[1]
    return np.asarray(values >= min(high, _piled_up(values, image)))


def _piled_up(values: Shaped[np.ndarray, "rows columns"], image: ImageFile) -> float:
    """Return the largest value if it is where a converter ends, and stands for what was brighter.

    Files of 16 bits hold values of a converter of fewer as they are, or moved to the upper bits.
    Infinity where no such end is seen.
    """
    top = float(values.max())
    if top not in {
        image.converter_range(bits)[1] * up
        for bits in CONVERTER_BITS
        for up in (1, 2 ** (16 - bits))
    }:
        return np.inf
    _, counts = np.unique(values, return_counts=True)
    least = max(PILED_LEAST, PILED_SHARE * values.size)
    beside = counts[-1 - NEXT_VALUES : -1].max(initial=0)
    return top if counts[-1] > least and counts[-1] > PILED * beside else np.inf


def _noise_counts(image: ImageFile, dark: Field) -> float:
    """Return the spread of the dark between neighbours, which leaves slow shading out."""
    steps = np.abs(_sample(np.diff(dark, axis=1)))
    spread = float(np.median(steps)) * 1.4826 / np.sqrt(2) if steps.size else 0.0
    rounding = 1 / 12 if image.pixels.dtype.kind in "iu" else 0.0
    return float(np.sqrt(spread**2 + rounding))


def _sample(values: Float[np.ndarray, "..."]) -> Float[np.ndarray, "_"]:
    """Return evenly spaced values, enough for a quantile: sorting megapixels would take longest."""
    return values.ravel()[:: 1 + values.size // 100_000]
