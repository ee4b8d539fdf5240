"""Ways to disturb the radiographs of an object, to see how much a method needs of them.

What a method is told of the geometry stays as it is, but for :class:`Misplaced`. Disturbed are
transmissions, never their logarithms. Needs the extra ``build``.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from itertools import product
from typing import Final, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import affine_transform, binary_dilation, gaussian_filter
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden1k.rays import path_lengths
from xden1k.values.arrays import Image, Mask, Vec3
from xden1k.values.types import FIELD_SIZE, DensityObject
from xden1k.values.views import ViewGeometry, XRayView

__all__ = [
    "Averaged",
    "Disturbance",
    "Enlarged",
    "Misplaced",
    "Noisier",
    "Shifted",
    "noise_sd",
    "resampled",
    "shadow_of",
    "square_around",
]

BESIDE_PX: Final = 5
"""So far from the shadow a pixel is beside the object."""
FEWEST: Final = 200
"""Pixels beside an object, of which noise can be told."""
CLIPPED_SD: Final = 4.0
"""What is farther out is no noise: an edge of something, a dead line."""
STEPS: Final = ((0, 1), (0, -1), (1, 0), (-1, 0))

Views = tuple[XRayView, ...]


@runtime_checkable
class Disturbance(Protocol):
    """What is done to the radiographs of every object."""

    @property
    def words(self) -> str:
        """Clause of which radiographs are the subject."""
        ...

    @property
    def left_out(self) -> Collection[str]:
        """Ids of objects that cannot be disturbed so, which the copy lacks."""
        return ()

    def __call__(self, obj: DensityObject, rng: np.random.Generator) -> Views:
        """Return the radiographs of an object as they are in the copy.

        Parameters
        ----------
        obj
            With its radiographs.
        rng
            The object's own.

        Raises
        ------
        DataError
            If they cannot be disturbed so.
        """
        ...


@dataclass(frozen=True, slots=True)
class Shifted(Disturbance):
    """Shifted as a whole along rows or columns, either way, drawn for each view.

    What comes in at an edge repeats it.

    Parameters
    ----------
    pixels
        How far.
    """

    pixels: int

    @property
    def words(self) -> str:
        """Clause of which radiographs are the subject."""
        return f"were shifted by {self.pixels} px, each along its rows or columns"

    def __call__(self, obj: DensityObject, rng: np.random.Generator) -> Views:
        """Return the shifted radiographs."""
        return tuple(self._shifted(view, *rng.choice(STEPS).tolist()) for view in obj.views)

    def _shifted(self, view: XRayView, down: int, right: int) -> XRayView:
        rows, columns = (
            np.clip(np.arange(size) - self.pixels * step, 0, size - 1)
            for size, step in zip(view.geometry.shape, (down, right), strict=True)
        )
        at = np.ix_(rows, columns)
        return replace(view, transmission=view.transmission[at], valid=view.valid[at])


@dataclass(frozen=True, slots=True)
class Enlarged(Disturbance):
    """Enlarged about the image's centre.

    Parameters
    ----------
    factor
        Below 1 makes them smaller; what comes in at an edge repeats it.
    """

    factor: float

    @property
    def words(self) -> str:
        """Clause of which radiographs are the subject."""
        return f"were enlarged by a factor of {self.factor:g} about their centres"

    def __call__(self, obj: DensityObject, rng: np.random.Generator) -> Views:
        """Return the enlarged radiographs."""
        return tuple(self._enlarged(view) for view in obj.views)

    def _enlarged(self, view: XRayView) -> XRayView:
        centre = (np.array(view.geometry.shape) - 1) / 2
        scale = np.full(2, 1 / self.factor)
        return resampled(view, scale, centre - scale * centre, view)


@dataclass(frozen=True, slots=True)
class Noisier(Disturbance):
    """With more noise: white, its variance in proportion to the transmission, as counting has it.

    How much there is, is measured beside the object; electronic noise is not told from quanta.

    Parameters
    ----------
    factor
        Of the standard deviation, 1 or more.
    """

    factor: float

    @property
    def words(self) -> str:
        """Clause of which radiographs are the subject."""
        return f"have {self.factor:g} times the noise that was measured beside each object"

    def __call__(self, obj: DensityObject, rng: np.random.Generator) -> Views:
        """Return the radiographs with noise added.

        Raises
        ------
        DataError
            If there is no noise beside the object, or nothing is beside it.
        """
        return tuple(self._noisier(obj, view, rng) for view in obj.views)

    def _noisier(self, obj: DensityObject, view: XRayView, rng: np.random.Generator) -> XRayView:
        beside = view.valid & ~binary_dilation(shadow_of(obj, view.geometry), iterations=BESIDE_PX)
        where = f"{obj.object_id}, view {view.name}"
        if not (sd := noise_sd(view.transmission, beside, where)):
            raise DataError(f"{where}: no noise beside the object, so none to be made more of")
        open_field = float(np.median(view.transmission[beside]))
        more = sd * np.sqrt((self.factor**2 - 1) * view.transmission.clip(0, None) / open_field)
        noise = rng.standard_normal(view.geometry.shape) * more
        return replace(view, transmission=(view.transmission + noise).astype(np.float32))


@dataclass(frozen=True, slots=True)
class Averaged(Disturbance):
    """Replaced within the object's own shadow by their mean transmission there."""

    @property
    def words(self) -> str:
        """Clause of which radiographs are the subject."""
        return "have, within each object's shadow, its mean transmission everywhere"

    def __call__(self, obj: DensityObject, rng: np.random.Generator) -> Views:
        """Return the averaged radiographs.

        Raises
        ------
        DataError
            If no valid pixel is in a shadow.
        """
        return tuple(self._averaged(obj, view) for view in obj.views)

    def _averaged(self, obj: DensityObject, view: XRayView) -> XRayView:
        inside = view.valid & shadow_of(obj, view.geometry)
        if not inside.any():
            raise DataError(f"{obj.object_id}, view {view.name}: no valid pixel shows the object")
        mean = np.float32(view.transmission[inside].mean(dtype=np.float64))
        return replace(view, transmission=np.where(inside, mean, view.transmission))


@dataclass(frozen=True, slots=True)
class Misplaced(Disturbance):
    """Unchanged, while meshes and grids are turned and moved against them: mesh errors.

    About the centre of the object's cube, axis and direction drawn for each object. The geometry
    that the dataset tells is moved, which is the same.

    Parameters
    ----------
    degrees, cm
        How far.
    """

    degrees: float
    cm: float

    @property
    def words(self) -> str:
        """Clause of which radiographs are the subject."""
        return (
            f"are as they were, but told as if each object were turned by {self.degrees:g} degrees "
            f"and moved by {self.cm:g} cm"
        )

    def __call__(self, obj: DensityObject, rng: np.random.Generator) -> Views:
        """Return the radiographs with another geometry."""
        axis, offset_cm = _direction(rng), self.cm * _direction(rng)
        turn = Rotation.from_rotvec(np.radians(self.degrees) * axis).as_matrix()
        centre_cm, _ = _cube(obj)
        return tuple(
            replace(view, geometry=_turned(view.geometry, turn, centre_cm).moved(offset_cm))
            for view in obj.views
        )


def noise_sd(transmission: Image, beside: Mask, where: str = "image") -> float:
    """Measure white noise where nothing is seen, by second differences along rows.

    Its standard deviation. Whatever changes evenly over three pixels, such as stray light, does
    not count, nor what is farther out than noise is.

    Parameters
    ----------
    transmission
        Shape (rows, columns).
    beside
        Shape (rows, columns): where to look.
    where
        For the message.

    Raises
    ------
    DataError
        If there is too little to look at.

    Examples
    --------
    >>> ramp = np.tile(np.linspace(0.9, 1.1, 64, dtype=np.float32), (64, 1))
    >>> noisy = ramp + np.random.default_rng(0).normal(0, 0.01, ramp.shape).astype(np.float32)
    >>> round(noise_sd(noisy, noisy > 0), 3)
    0.01
    """
    bends = np.diff(transmission.astype(np.float64), n=2, axis=1)
    bends = bends[beside[:, 2:] & beside[:, 1:-1] & beside[:, :-2]]
    if len(bends) < FEWEST:
        raise DataError(f"{where}: {len(bends)} pixels beside the object, too few to see its noise")
    kept = -1
    while kept != len(bends):
        kept = len(bends)
        bends = bends[np.abs(bends) <= CLIPPED_SD * np.sqrt(np.mean(bends**2))]
    return float(np.sqrt(np.mean(bends**2) / 6))  # 1 + 4 + 1


def shadow_of(obj: DensityObject, geometry: ViewGeometry) -> Mask:
    """Pixels whose ray meets the object."""
    meshes = [part.mesh for part in obj.parts]
    shadow = np.zeros(geometry.shape, dtype=np.bool_)
    shadow.flat[path_lengths(meshes, range(len(meshes)), geometry).pixels] = True
    return shadow


def _cube(obj: DensityObject) -> tuple[Vec3, float]:
    """Centre and half the edge of the cube of an object's grids, cm."""
    half_cm = obj.voxel_size_cm * FIELD_SIZE / 2
    return obj.origin_cm + half_cm - obj.voxel_size_cm / 2, half_cm


def square_around(
    obj: DensityObject, geometry: ViewGeometry
) -> tuple[Float64[np.ndarray, "2"], Float64[np.ndarray, "2"]]:
    """Centre and sides, in rows and columns, of the square in cm around the projected cube."""
    centre_cm, half_cm = _cube(obj)
    corners = centre_cm + half_cm * np.array(list(product((-1, 1), repeat=3)))
    places = geometry.project(corners)[:, 1::-1]
    steps = np.linalg.norm([geometry.row_step_cm, geometry.column_step_cm], axis=1)
    lowest, highest = places.min(axis=0), places.max(axis=0)
    return (lowest + highest) / 2, float(((highest - lowest) * steps).max()) / steps


def resampled(
    view: XRayView,
    scale: Float64[np.ndarray, "2"],
    first: Float64[np.ndarray, "2"],
    like: XRayView,
) -> XRayView:
    """Read a view at other places: row and column ``scale * (row, column) + first`` of it.

    Linear, of valid pixels alone; where pixels become larger, over as much as they cover.

    Parameters
    ----------
    view
        What to read.
    scale, first
        Shape (2,): along rows' and columns' numbers.
    like
        Whose geometry and name the result has.
    """
    blur = np.maximum(scale - 1, 0) / 2

    def read(image: Image) -> Image:
        smooth = gaussian_filter(image, blur, mode="nearest") if blur.any() else image
        shape = like.geometry.shape
        return np.asarray(affine_transform(smooth, scale, first, shape, order=1, mode="nearest"))

    valid = view.valid.astype(np.float32)
    weight = read(valid)
    light = read(np.where(view.valid, view.transmission, np.float32(0)))
    known = weight > 0.5
    transmission = np.divide(light, weight, out=np.zeros_like(light), where=known)
    return replace(like, transmission=transmission, valid=known)


def _turned(
    geometry: ViewGeometry, turn: Float64[np.ndarray, "3 3"], about_cm: Vec3
) -> ViewGeometry:
    """Turn detector and beam about a point."""
    source, direction = geometry.source_cm, geometry.direction
    return replace(
        geometry,
        pixel00_cm=turn @ (geometry.pixel00_cm - about_cm) + about_cm,
        column_step_cm=turn @ geometry.column_step_cm,
        row_step_cm=turn @ geometry.row_step_cm,
        source_cm=None if source is None else turn @ (source - about_cm) + about_cm,
        direction=None if direction is None else turn @ direction,
    )


def _direction(rng: np.random.Generator) -> Vec3:
    """Draw a unit vector, evenly over the sphere."""
    vector = rng.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))
