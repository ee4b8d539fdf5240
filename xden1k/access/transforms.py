"""Transforms of torch samples after which everything in a sample still belongs together.

Each takes a sample of :class:`xden1k.XDen1K` and returns a new one; the tensors of the old one are
left alone. Whatever the sample holds is carried along: crop a radiograph, and its geometry follows;
turn an object, and meshes, grids, centre of mass, inertia and the scanner around it turn with it,
so that the meshes still project onto the radiographs. What could only be carried along in part is
refused: a radiograph without geometry, or grids by an angle, unless they are made anew.

Random ones draw from torch's generator, which ``DataLoader`` seeds in each worker, or from one that
is given.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import permutations
from typing import Any, Final

import torch
from jaxtyping import Float
from torch import Tensor

from xden1k.access.dataset import Sample
from xden1k.access.geometry import GEOMETRY_PARTS, VIEWS, fields_of, project
from xden1k.errors import DataError, require
from xden1k.format.codec import MAX_TRANSMISSION
from xden1k.values.types import FIELD_SIZE

__all__ = [
    "Compose",
    "CropViews",
    "GainViews",
    "NoiseViews",
    "RandomRotation",
    "RandomTurn",
    "Rotate",
    "Turn",
    "cube_turns",
]

Range = tuple[float, float]

_FIELD_GRIDS: Final = ("density", "apparent_density", "occupancy", "envelope")
_GRIDS: Final = (*_FIELD_GRIDS, "labels")
_FRAME: Final = ("grid_origin_cm", "voxel_size_cm")
_MESH: Final = ("mesh_vertices", "mesh_faces", "face_part")
_LEAST: Final = MAX_TRANSMISSION / 65535
"""Least transmission of a valid pixel; 0 is invalid."""


class Compose:
    """Several transforms, one after the other.

    Parameters
    ----------
    transforms
        Each is given what the one before it returned.
    """

    def __init__(self, transforms: Sequence[Callable[[Sample], Sample]]) -> None:
        self.transforms = tuple(transforms)

    def __repr__(self) -> str:
        return f"Compose({list(self.transforms)})"

    def __call__(self, sample: Mapping[str, Any]) -> Sample:
        """Return the transformed sample."""
        made = dict(sample)
        for transform in self.transforms:
            made = transform(made)
        return made


class CropViews:
    """Cut the radiographs to one size; their geometry follows.

    Where an image is smaller than the size, it gets invalid pixels around it (transmission 0).

    Parameters
    ----------
    size
        Rows and columns of what is left, or one number for both.
    where
        ``object``: the middle of the projected meshes is in the middle (needs ``mesh_vertices``
        and ``xray_..._projection``); ``centre``: of the image; ``random``: anywhere in the image.
    generator
        Of the random place.

    Raises
    ------
    DataError
        If the size is no size; when called, if a radiograph has no geometry in the sample.
    """

    def __init__(
        self,
        size: int | tuple[int, int],
        where: str = "object",
        *,
        generator: torch.Generator | None = None,
    ) -> None:
        self.size = (size, size) if isinstance(size, int) else tuple(size)
        self.where = where
        self.generator = generator
        if len(self.size) != 2 or min(self.size) < 1:
            raise DataError(f"size must be rows and columns of at least 1, got {size}")
        if where not in ("object", "centre", "random"):
            raise DataError(f"where must be object, centre or random, got {where!r}")

    def __repr__(self) -> str:
        return f"CropViews({self.size}, {self.where!r})"

    def __call__(self, sample: Mapping[str, Any]) -> Sample:
        """Return the sample with its radiographs cut."""
        made = dict(sample)
        for view in _views_of(sample):
            _need_geometry(sample, view)
            image = sample[f"xray_{view}"]
            first = self._first(sample, view, image.shape)
            made[f"xray_{view}"] = _cut(image, first, self.size)
            if f"xray_{view}_valid" in sample:
                made[f"xray_{view}_valid"] = _cut(sample[f"xray_{view}_valid"], first, self.size)
            made |= _shifted_geometry(sample, view, first)
        return made

    def _first(self, sample: Mapping[str, Any], view: str, shape: torch.Size) -> tuple[int, int]:
        """Row and column that become the first."""
        free = [have - want for have, want in zip(shape, self.size, strict=True)]
        if self.where == "random":
            row, column = (_integer(abs(room), self.generator) for room in free)
            return row if free[0] > 0 else -row, column if free[1] > 0 else -column
        if self.where == "centre":
            return free[0] // 2, free[1] // 2
        (matrix,) = fields_of(sample, view, ("projection",))
        if "mesh_vertices" not in sample:
            raise DataError(f"{_name(sample)} has no mesh_vertices: where its object is is unknown")
        seen = project(sample["mesh_vertices"], matrix)
        column, row = ((seen.amin(0) + seen.amax(0)) / 2).tolist()
        rows, columns = self.size
        return round(row - (rows - 1) / 2), round(column - (columns - 1) / 2)


class NoiseViews:
    """Add the noise of fewer photons to the radiographs.

    The transmission T of a valid pixel becomes Poisson(N T) / N, which is the noise of a detector
    that counts N photons where there is air, on top of what noise there is. Where pixels are
    invalid nothing changes, and a valid pixel is never 0.

    Parameters
    ----------
    photons
        N, or the least and the most: drawn evenly by its logarithm for each view.
    generator
        Of the noise.

    Raises
    ------
    DataError
        If a number is not positive, or the range is none.
    """

    def __init__(self, photons: float | Range, *, generator: torch.Generator | None = None) -> None:
        self.photons = _range("photons", photons)
        self.generator = generator

    def __repr__(self) -> str:
        return f"NoiseViews({self.photons})"

    def __call__(self, sample: Mapping[str, Any]) -> Sample:
        """Return the sample with noisier radiographs."""
        made = dict(sample)
        for view in _views_of(sample):
            image = sample[f"xray_{view}"]
            low, high = (math.log(value) for value in self.photons)
            photons = math.exp(low + (high - low) * _unit(self.generator))
            counts = torch.poisson(image.clamp(min=0) * photons, generator=self.generator)
            made[f"xray_{view}"] = _kept_valid(image, counts / photons)
        return made


class GainViews:
    """Multiply each radiograph by a factor, as a tube that drifts does.

    Parameters
    ----------
    gain
        The least and the most: drawn evenly for each view.
    generator
        Of the factors.

    Raises
    ------
    DataError
        If a factor is not positive, or the range is none.
    """

    def __init__(self, gain: Range, *, generator: torch.Generator | None = None) -> None:
        self.gain = _range("gain", gain)
        self.generator = generator

    def __repr__(self) -> str:
        return f"GainViews({self.gain})"

    def __call__(self, sample: Mapping[str, Any]) -> Sample:
        """Return the sample with brighter or darker radiographs."""
        made = dict(sample)
        for view in _views_of(sample):
            image = sample[f"xray_{view}"]
            low, high = self.gain
            factor = low + (high - low) * _unit(self.generator)
            made[f"xray_{view}"] = _kept_valid(image, image * factor)
        return made


def cube_turns(*, mirrors: bool = True) -> Float[Tensor, "turns 3 3"]:
    """Every way to put a cube onto itself: the 24 rotations, then the 24 mirrored ones.

    Parameters
    ----------
    mirrors
        False = the 24 rotations alone.

    Returns
    -------
    Tensor
        float32 (48, 3, 3) or (24, 3, 3), the identity first; each turns points by ``turn @ x``.

    Examples
    --------
    >>> turns = cube_turns()
    >>> turns.shape, turns.det().sum().item()
    (torch.Size([48, 3, 3]), 0.0)
    """
    orders = torch.eye(3)[torch.tensor(list(permutations(range(3))))]
    signs = torch.cartesian_prod(*[torch.tensor([1.0, -1.0])] * 3)
    every = (signs[:, None, :, None] * orders).reshape(48, 3, 3)
    proper = every.det() > 0
    return torch.cat([every[proper], *([every[~proper]] if mirrors else [])])


class Turn:
    """Turn or mirror the object, and the scanner with it, by one of the 48 of :func:`cube_turns`.

    About the frame's origin, and exact: voxels are moved, none is interpolated. The radiographs
    stay as they are and their geometry turns. Faces of a mirrored mesh still look outwards.

    Parameters
    ----------
    turn
        Shape (3, 3): one entry of each row and column is 1 or -1, the others are 0.

    Raises
    ------
    DataError
        If it is none of the 48; when called, if a radiograph has no geometry in the sample, or a
        grid's place is known and its voxel size is not.
    """

    def __init__(self, turn: Tensor | Sequence[Sequence[float]]) -> None:
        self.turn = torch.as_tensor(turn, dtype=torch.float32).cpu()
        self._check()

    def _check(self) -> None:
        sizes = self.turn.abs()
        lines = (sizes.sum(0), sizes.sum(1)) if self.turn.shape == (3, 3) else ()
        ones = torch.ones(3)
        is_turn = lines and all(torch.equal(line, ones) for line in lines)
        if not is_turn or not torch.equal(sizes, sizes.round()):
            raise DataError(
                f"a turn of the cube is one of cube_turns(), got {self.turn.tolist()}; "
                "Rotate takes any rotation"
            )

    def __repr__(self) -> str:
        return f"Turn({self.turn.int().tolist()})"

    def __call__(self, sample: Mapping[str, Any]) -> Sample:
        """Return the turned sample."""
        made = _moved(sample, self.turn)
        axes = self.turn.abs().argmax(dim=1).tolist()
        back = [axis for axis in range(3) if self.turn[axis].sum() < 0]
        for name in _GRIDS:
            if name in sample:
                made[name] = sample[name].permute(axes).flip(back).contiguous()
        if "grid_origin_cm" in sample:
            made["grid_origin_cm"] = self._origin(sample, back)
        return made

    def _origin(self, sample: Mapping[str, Any], back: list[int]) -> Tensor:
        """Return the centre of the voxel that is first now: of the last one, where an axis is."""
        if "voxel_size_cm" not in sample:
            raise DataError(f"{_name(sample)} has no voxel_size_cm, which grid_origin_cm needs")
        origin = sample["grid_origin_cm"]
        extent = (FIELD_SIZE - 1) * sample["voxel_size_cm"]
        flipped = torch.zeros_like(origin)
        flipped[back] = extent
        return _times(self.turn, origin) - flipped


class RandomTurn:
    """:class:`Turn` by one of the 24 rotations of the cube, or of all 48, drawn evenly.

    Parameters
    ----------
    mirrors
        Also the mirrored ones. Everyday objects have a hand: screws and scissors do not come
        mirrored.
    generator
        Of the draw.
    """

    def __init__(self, *, mirrors: bool = False, generator: torch.Generator | None = None) -> None:
        self.mirrors = mirrors
        self.generator = generator

    def __repr__(self) -> str:
        return f"RandomTurn(mirrors={self.mirrors})"

    def __call__(self, sample: Mapping[str, Any]) -> Sample:
        """Return the turned sample."""
        turns = cube_turns(mirrors=self.mirrors)
        return Turn(turns[_integer(len(turns) - 1, self.generator)])(sample)


class Rotate:
    """Rotate the object, and the scanner with it, about the frame's origin.

    Meshes, centre of mass, inertia and geometry are rotated exactly; the radiographs stay as they
    are. Voxels cannot be rotated and hold the same means: a sample with grids is refused unless
    they are made anew, from the rotated meshes, as the builder made the stored ones (some
    tenths of a second; needs the extra ``build``). They then fill another cube.

    Parameters
    ----------
    rotation
        Shape (3, 3): turns points by ``rotation @ x``.
    remake_grids
        Make labels, occupancy, envelope and densities anew, and the cube they fill.

    Raises
    ------
    DataError
        If it is no rotation; when called, if the sample has grids that are not to be made anew,
        lacks what they are made of, or has a radiograph without geometry.
    MissingExtraError
        When called, if grids are to be made and the extra ``build`` is not installed.
    """

    def __init__(
        self,
        rotation: Tensor | Sequence[Sequence[float]],
        *,
        remake_grids: bool = False,
    ) -> None:
        self.rotation = torch.as_tensor(rotation, dtype=torch.float64).cpu()
        self.remake_grids = remake_grids
        product = self.rotation @ self.rotation.T if self.rotation.shape == (3, 3) else None
        if product is None or not torch.allclose(product, torch.eye(3).double(), atol=1e-5):
            raise DataError(f"no rotation, its rows are not orthonormal: {self.rotation.tolist()}")
        if self.rotation.det() < 0:
            raise DataError(
                f"no rotation but a mirror: {self.rotation.tolist()}; Turn mirrors exactly"
            )

    def __repr__(self) -> str:
        return f"Rotate({self.rotation.tolist()}, remake_grids={self.remake_grids})"

    def __call__(self, sample: Mapping[str, Any]) -> Sample:
        """Return the rotated sample."""
        grids = [name for name in (*_GRIDS, *_FRAME) if name in sample]
        if grids and not self.remake_grids:
            raise DataError(
                f"{_name(sample)}: {', '.join(grids)} cannot be rotated and stay true: leave them "
                "out (fields=), use Turn, or let remake_grids=True make them from the meshes"
            )
        made = _moved(sample, self.rotation)
        return made | _remade_grids(made, grids) if grids else made


class RandomRotation:
    """:class:`Rotate` about a random axis by an angle up to a limit.

    The axis is drawn evenly over the sphere, the angle evenly.

    Parameters
    ----------
    degrees
        The largest angle.
    remake_grids
        As for :class:`Rotate`.
    generator
        Of the draw.

    Raises
    ------
    DataError
        If the angle is not in 0 to 180.
    """

    def __init__(
        self,
        degrees: float,
        *,
        remake_grids: bool = False,
        generator: torch.Generator | None = None,
    ) -> None:
        if not 0 <= degrees <= 180:
            raise DataError(f"degrees must be 0 to 180, got {degrees}")
        self.degrees = degrees
        self.remake_grids = remake_grids
        self.generator = generator

    def __repr__(self) -> str:
        return f"RandomRotation({self.degrees}, remake_grids={self.remake_grids})"

    def __call__(self, sample: Mapping[str, Any]) -> Sample:
        """Return the rotated sample."""
        axis = torch.randn(3, dtype=torch.float64, generator=self.generator)
        x, y, z = (axis / axis.norm() * math.radians(self.degrees) * _unit(self.generator)).tolist()
        across = torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]], dtype=torch.float64)
        return Rotate(torch.linalg.matrix_exp(across), remake_grids=self.remake_grids)(sample)


def _moved(sample: Mapping[str, Any], matrix: Tensor) -> Sample:
    """Apply an orthogonal matrix to everything but grids, which are left as they are."""
    made = dict(sample)
    for view in _views_of(sample):
        _need_geometry(sample, view)
    for view in VIEWS:
        for name in (f"xray_{view}_{part}" for part in GEOMETRY_PARTS[1:4]):
            if name in sample:
                made[name] = _times(matrix, sample[name])
        if (name := f"xray_{view}_source") in sample:
            source = sample[name]
            made[name] = torch.cat([_times(matrix, source[:3]), source[3:]])
        if (name := f"xray_{view}_projection") in sample:
            seen = sample[name]
            made[name] = torch.cat([_times(matrix, seen[:, :3]), seen[:, 3:]], dim=1)
    for name in ("mesh_vertices", "com_cm"):
        if name in sample:
            made[name] = _times(matrix, sample[name])
    if "inertia_g_cm2" in sample:
        made["inertia_g_cm2"] = _times(matrix, _times(matrix, sample["inertia_g_cm2"]).T)
    if "mesh_faces" in sample and matrix.det() < 0:
        made["mesh_faces"] = sample["mesh_faces"].flip(1)
    return made


def _times(matrix: Tensor, rows: Tensor) -> Tensor:
    """Turn each row, in float64, so that turns of the cube are exact and others do not add up."""
    return (rows.double() @ matrix.to(rows.device, torch.float64).T).to(rows.dtype)


def _remade_grids(sample: Mapping[str, Any], names: Sequence[str]) -> Sample:
    """Make the grids of a sample anew from its meshes, as the builder does."""
    figures = {"density": "part_density", "apparent_density": "part_apparent_density"}
    needed = [*_MESH, *(figures[name] for name in names if name in figures)]
    if missing := [name for name in needed if name not in sample]:
        raise DataError(f"{_name(sample)} has no {', '.join(missing)}, of which grids are made")
    require("numba", "build")
    require("manifold3d", "build")
    from xden1k.rays.grids import object_grids
    from xden1k.rays.voxels import density_grid

    meshes = _meshes(*(sample[name].cpu().numpy() for name in _MESH))
    grids = object_grids(meshes, range(len(meshes)))
    values: dict[str, Any] = {
        "labels": grids.labels,
        "occupancy": grids.occupancy,
        "envelope": grids.envelope,
        "grid_origin_cm": grids.field.origin_cm,
        "voxel_size_cm": grids.field.voxel_size_cm,
    }
    for name, figure in figures.items():
        if name in names:
            known = sample[figure][1:].tolist()
            grid = density_grid(grids.fills, known, grids.field)
            values[name] = grid if math.isfinite(sum(known)) else grid * math.nan
    return {
        name: torch.as_tensor(values[name], dtype=sample[name].dtype, device=sample[name].device)
        for name in names
    }


def _meshes(vertices: Any, faces: Any, owner: Any) -> list[Any]:
    import trimesh

    return [
        trimesh.Trimesh(vertices, faces[owner == number], process=False)
        for number in range(1, int(owner.max()) + 1)
    ]


def _views_of(sample: Mapping[str, Any]) -> list[str]:
    """Name the views whose radiograph is in the sample."""
    views = [view for view in VIEWS if f"xray_{view}" in sample]
    for view in views:
        image = sample[f"xray_{view}"]
        if not isinstance(image, Tensor) or image.ndim != 2:
            raise DataError(
                f"a transform takes one sample, not a batch: xray_{view} must have shape (rows, "
                f"columns), got {tuple(getattr(image, 'shape', [type(image).__name__]))}; give it "
                "to XDen1K(transform=...)"
            )
    return views


def _need_geometry(sample: Mapping[str, Any], view: str) -> None:
    if not any(f"xray_{view}_{part}" in sample for part in GEOMETRY_PARTS):
        fields_of(sample, view, ("projection",))


def _cut(image: Tensor, first: tuple[int, int], size: tuple[int, ...]) -> Tensor:
    made = image.new_zeros(size)
    inner, outer = [], []
    for start, length, have in zip(first, size, image.shape, strict=True):
        low, high = max(start, 0), min(start + length, have)
        outer.append(slice(low, max(low, high)))
        inner.append(slice(low - start, max(low, high) - start))
    made[tuple(inner)] = image[tuple(outer)]
    return made


def _shifted_geometry(sample: Mapping[str, Any], view: str, first: tuple[int, int]) -> Sample:
    """Geometry of an image whose first pixel is another; what of it the sample has."""
    row, column = first
    made: Sample = {}
    if (name := f"xray_{view}_projection") in sample:
        matrix = sample[name].clone()
        matrix[:2] -= torch.tensor([[column], [row]]).to(matrix) * matrix[2]
        made[name] = matrix
    if f"xray_{view}_pixel00_cm" in sample:
        parts = fields_of(sample, view, GEOMETRY_PARTS[1:4])
        pixel00, column_step, row_step = (part.double() for part in parts)
        moved = pixel00 + column * column_step + row * row_step
        made[f"xray_{view}_pixel00_cm"] = moved.to(parts[0].dtype)
    return made


def _kept_valid(old: Tensor, new: Tensor) -> Tensor:
    """Leave invalid pixels at 0, and let no valid one become 0."""
    return torch.where(old > 0, new.clamp(min=_LEAST), old)


def _range(name: str, value: float | Range) -> Range:
    low, high = value if isinstance(value, tuple) else (value, value)
    if not 0 < low <= high < math.inf:
        raise DataError(f"{name} must be positive, the least first, got {value}")
    return float(low), float(high)


def _unit(generator: torch.Generator | None) -> float:
    return float(torch.rand((), generator=generator))


def _integer(last: int, generator: torch.Generator | None) -> int:
    """Draw a number from 0 to ``last``."""
    return int(torch.randint(last + 1, (), generator=generator))


def _name(sample: Mapping[str, Any]) -> str:
    return str(sample.get("object_id", "the sample"))
