"""Ways to disturb the radiographs of an object, to see how much a method needs of them.

What a method is told of the geometry stays as it is, but for :class:`Misplaced`. Disturbed are
transmissions, never their logarithms. Needs the extra ``build``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final, Protocol

import numpy as np
from jaxtyping import Float64
from scipy.ndimage import affine_transform, binary_dilation, gaussian_filter
from scipy.spatial.transform import Rotation

from xden1k.errors import DataError
from xden1k.folder import DatasetFolder
from xden1k.rays import path_lengths
from xden1k.values.arrays import Image, Mask, Vec3
from xden1k.values.types import FIELD_SIZE, DensityObject
from xden1k.values.views import ViewGeometry, XRayView

__all__ = [
    "Averaged",
    "Disturbance",
    "Enlarged",
    "Exchanged",
    "Misplaced",
    "Noisier",
    "Shifted",
    "noise_sd",
]

BESIDE_PX: Final = 5
"""So far from the shadow a pixel is beside the object."""
FEWEST: Final = 200
"""Pixels beside an object, of which noise can be told."""
CLIPPED_SD: Final = 4.0
"""What is farther out is no noise: an edge of something, a dead line."""
SHOWN: Final = 0.005
"""Transmission by which an object is darker than what is beside it, if it is shown."""
STEPS: Final = ((0, 1), (0, -1), (1, 0), (-1, 0))

Views = tuple[XRayView, ...]


class Disturbance(Protocol):
    """What is done to the radiographs of every object."""

    @property
    def words(self) -> str:
        """Clause of which radiographs are the subject."""
        ...

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
class Shifted:
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
        return tuple(self._shifted(view, *rng.choice(STEPS)) for view in obj.views)

    def _shifted(self, view: XRayView, down: int, right: int) -> XRayView:
        rows, columns = (
            np.clip(np.arange(size) - self.pixels * step, 0, size - 1)
            for size, step in zip(view.geometry.shape, (down, right), strict=True)
        )
        at = np.ix_(rows, columns)
        return replace(view, transmission=view.transmission[at], valid=view.valid[at])


@dataclass(frozen=True, slots=True)
class Enlarged:
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
        return _resampled(view, scale, centre - scale * centre, view)


@dataclass(frozen=True, slots=True)
class Noisier:
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
        beside = view.valid & ~binary_dilation(_shadow(obj, view.geometry), iterations=BESIDE_PX)
        where = f"{obj.object_id}, view {view.name}"
        if not (sd := noise_sd(view.transmission, beside, where)):
            raise DataError(f"{where}: no noise beside the object, so none to be made more of")
        open_field = float(np.median(view.transmission[beside]))
        more = sd * np.sqrt((self.factor**2 - 1) * view.transmission.clip(0, None) / open_field)
        noise = rng.standard_normal(view.geometry.shape) * more
        return replace(view, transmission=(view.transmission + noise).astype(np.float32))


@dataclass(frozen=True, slots=True)
class Averaged:
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
        inside = view.valid & _shadow(obj, view.geometry)
        if not inside.any():
            raise DataError(f"{obj.object_id}, view {view.name}: no valid pixel shows the object")
        mean = np.float32(view.transmission[inside].mean(dtype=np.float64))
        return replace(view, transmission=np.where(inside, mean, view.transmission))


@dataclass(frozen=True, slots=True)
class Exchanged:
    """Replaced by another object's, at the receiver's scale.

    The square that encloses the giver's cube in its image comes to lie where the receiver's is, so
    that sizes do not give the exchange away; what is beyond the giver's image repeats its edge.

    Parameters
    ----------
    folder
        The dataset.
    givers
        Whose radiographs each object gets.
    """

    folder: DatasetFolder
    givers: Mapping[str, str]

    @classmethod
    def drawn(cls, folder: DatasetFolder, splits: Sequence[str], seed: int) -> Exchanged:
        """Draw who gets whose, within each split: each gives once, none to itself.

        Two objects exchange givers where one would be shown nothing: a radiograph that is hardly
        darker on it than beside it, of which no method could say anything.

        Raises
        ------
        DataError
            If a split has a single object, or an object is shown nothing by any other.
        """
        rng, givers = np.random.default_rng(seed), dict[str, str]()
        for split in splits:
            ids = sorted(folder.ids(split))
            if len(ids) < 2:
                raise DataError(f"{folder.root}: the split {split} has nobody to exchange with")
            order = [ids[place] for place in rng.permutation(len(ids))]
            drawn = dict(zip(order, [*order[1:], order[0]], strict=True))
            for one in ids:
                if not _is_shown(folder, one, drawn[one]):
                    others = [ids[place] for place in rng.permutation(len(ids))]
                    _exchange(folder, drawn, one, others)
            givers |= drawn
        return cls(folder, givers)

    @property
    def words(self) -> str:
        """Clause of which radiographs are the subject."""
        return "are those of another object of the split, at the scale of its own"

    def __call__(self, obj: DensityObject, rng: np.random.Generator) -> Views:
        """Return the radiographs of the giver, as if they were of the receiver's size."""
        giver = self.folder.object(self.givers[obj.object_id])
        pairs = zip(giver.views, obj.views, strict=True)
        return tuple(_in_place_of(giver, theirs, obj, own) for theirs, own in pairs)


@dataclass(frozen=True, slots=True)
class Misplaced:
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


def _shadow(obj: DensityObject, geometry: ViewGeometry) -> Mask:
    """Pixels whose ray meets the object."""
    meshes = [part.mesh for part in obj.parts]
    shadow = np.zeros(geometry.shape, dtype=np.bool_)
    shadow.flat[path_lengths(meshes, range(len(meshes)), geometry).pixels] = True
    return shadow


def _cube(obj: DensityObject) -> tuple[Vec3, float]:
    """Centre and half the edge of the cube of an object's grids, cm."""
    half_cm = obj.voxel_size_cm * FIELD_SIZE / 2
    return obj.origin_cm + half_cm - obj.voxel_size_cm / 2, half_cm


def _in_place_of(
    giver: DensityObject, theirs: XRayView, receiver: DensityObject, own: XRayView
) -> XRayView:
    """Show the giver where, and as large as, the receiver is."""
    centre, side = _square(giver, theirs.geometry)
    own_centre, own_side = _square(receiver, own.geometry)
    scale = side / own_side
    return _resampled(theirs, scale, centre - scale * own_centre, own)


def _is_shown(folder: DatasetFolder, receiver_id: str, giver_id: str) -> bool:
    """Whether a giver's radiographs are darker on the receiver than beside it."""
    receiver, giver = folder.object(receiver_id), folder.object(giver_id)
    for theirs, own in zip(giver.views, receiver.views, strict=True):
        new, shadow = _in_place_of(giver, theirs, receiver, own), _shadow(receiver, own.geometry)
        on, beside = (new.transmission[new.valid & where] for where in (shadow, ~shadow))
        if on.size and beside.size and not on.mean() < np.median(beside) - SHOWN:
            return False
    return True


def _exchange(
    folder: DatasetFolder, givers: dict[str, str], blind: str, others: Sequence[str]
) -> None:
    """Let an object that is shown nothing take the giver of the first other with which that helps.

    Raises
    ------
    DataError
        If there is none.
    """
    for other in others:
        theirs, own = givers[other], givers[blind]
        if blind in (other, theirs) or other == own:
            continue
        if _is_shown(folder, blind, theirs) and _is_shown(folder, other, own):
            givers[blind], givers[other] = theirs, own
            return
    raise DataError(f"{blind}: no other object's radiographs show anything where it is")


def _square(
    obj: DensityObject, geometry: ViewGeometry
) -> tuple[Float64[np.ndarray, "2"], Float64[np.ndarray, "2"]]:
    """Centre and sides, in rows and columns, of the square in cm around the projected cube."""
    centre_cm, half_cm = _cube(obj)
    corners = centre_cm + half_cm * np.array(list(product((-1, 1), repeat=3)))
    places = geometry.project(corners)[:, 1::-1]
    steps = np.linalg.norm([geometry.row_step_cm, geometry.column_step_cm], axis=1)
    lowest, highest = places.min(axis=0), places.max(axis=0)
    return (lowest + highest) / 2, float(((highest - lowest) * steps).max()) / steps


def _resampled(
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
