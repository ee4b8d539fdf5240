"""Where a radiograph was taken from, as tensors; projecting points through them.

One form serves both beams. The source is a homogeneous point: ``(x, y, z, 1)`` for a focal spot,
``(-direction, 0)``, a point at infinity, for a parallel beam. With it, the detector's pixel (0, 0)
and its two steps, a point x is seen at

    K = inverse of [column step | row step | w * pixel00 - source]     (w: last of the source)
    (a, b, e) = K (x - pixel00);  column = a / (1 + w e);  row = b / (1 + w e)

which is one 3 x 4 matrix (Hartley and Zisserman, Multiple View Geometry, 2004, Eq. 6.1). Columns
and rows count pixel *centres*: (0, 0) is the middle of the first pixel, and the image reaches from
-0.5 to columns - 0.5.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from xden1k.errors import DataError
from xden1k.values.views import ViewGeometry

__all__ = [
    "GEOMETRY_PARTS",
    "VIEWS",
    "geometry_tensors",
    "project",
    "projection_matrix",
    "view_geometry",
]

VIEWS: Final = ("pa", "lat")
GEOMETRY_PARTS: Final = ("source", "pixel00_cm", "column_step_cm", "row_step_cm", "projection")
"""What a sample holds of each view: ``xray_pa_source`` and so on."""


def geometry_tensors(geometry: ViewGeometry) -> dict[str, Float[Tensor, "..."]]:
    """Return the tensors of a view, by :data:`GEOMETRY_PARTS`.

    Returns
    -------
    dict of str to Tensor
        float32: ``source`` (4,), cm, homogeneous; ``pixel00_cm``, ``column_step_cm``,
        ``row_step_cm`` (3,); ``projection`` (3, 4).
    """
    weight = 0.0 if geometry.source_cm is None else 1.0
    start = -geometry.matrix[:, 2] if geometry.source_cm is None else geometry.source_cm
    # As projection_matrix, in float64.
    inverse = np.linalg.inv(geometry.matrix)
    matrix = np.column_stack([inverse, -inverse @ geometry.pixel00_cm])
    matrix[2] *= weight
    matrix[2, 3] += 1.0
    steps = (geometry.pixel00_cm, geometry.column_step_cm, geometry.row_step_cm)
    values = (np.append(start, weight), *steps, matrix)
    return {
        name: torch.from_numpy(value.astype(np.float32))
        for name, value in zip(GEOMETRY_PARTS, values, strict=True)
    }


def projection_matrix(
    source: Float[Tensor, "*batch 4"],
    pixel00_cm: Float[Tensor, "*batch 3"],
    column_step_cm: Float[Tensor, "*batch 3"],
    row_step_cm: Float[Tensor, "*batch 3"],
) -> Float[Tensor, "*batch 3 4"]:
    """Projection matrix of a view: what :func:`project` takes. Differentiable.

    Parameters
    ----------
    source
        Shape (..., 4): focal spot and 1; or for a parallel beam its direction, negated, and 0.
    pixel00_cm, column_step_cm, row_step_cm
        Shape (..., 3): centre of pixel (0, 0), step to the next column, step to the next row.

    Examples
    --------
    >>> vectors = [[0.0, -7, 0, 1], [0.0, 1, 0], [0.5, 0, 0], [0, 0, -0.5]]
    >>> matrix = projection_matrix(*(torch.tensor(vector) for vector in vectors))
    >>> project(torch.tensor([[1.0, 1, 0], [1, -3, 0]]), matrix).tolist()
    [[2.0, 0.0], [4.0, 0.0]]
    """
    weight = source[..., 3:]
    beam = weight * pixel00_cm - source[..., :3]
    inverse = torch.linalg.inv(torch.stack([column_step_cm, row_step_cm, beam], dim=-1))
    offset = -(inverse * pixel00_cm[..., None, :]).sum(-1)
    scaled = torch.cat([torch.ones_like(offset[..., :2]), weight], dim=-1)
    one = torch.zeros_like(offset) + torch.tensor([0.0, 0, 1]).to(offset)
    return torch.cat([inverse * scaled[..., None], (offset * scaled + one)[..., None]], dim=-1)


def project(
    points_cm: Float[Tensor, "*batch points 3"], projection: Float[Tensor, "*views 3 4"]
) -> Float[Tensor, "*joint points 2"]:
    """Columns and rows at which points are seen in a radiograph.

    Differentiable in both arguments, and at least float32 whatever autocast says; with the
    float32 matrices of a sample right to a hundredth of a pixel. Leading axes broadcast.

    Parameters
    ----------
    points_cm
        Shape (..., n, 3): points in the object frame, such as ``mesh_vertices``.
    projection
        Shape (..., 3, 4): ``xray_pa_projection`` or ``xray_lat_projection``.

    Returns
    -------
    Tensor
        Shape (..., n, 2): column and row, fractions of pixels; (0, 0) is the *centre* of the first
        pixel. Not a number for points that lie behind the source.

    Raises
    ------
    DataError
        If a shape is another.

    Examples
    --------
    >>> flat = torch.tensor([[2.0, 0, 0, 0], [0, 0, -2, 0], [0, 0, 0, 1]])
    >>> project(torch.tensor([[1.0, 5, -0.25]]), flat).tolist()
    [[2.0, 0.5]]
    """
    if points_cm.ndim < 2 or points_cm.shape[-1] != 3 or projection.shape[-2:] != (3, 4):
        shapes = f"{tuple(points_cm.shape)} and {tuple(projection.shape)}"
        raise DataError(f"points (..., n, 3) and a projection (..., 3, 4) are wanted, got {shapes}")
    points, matrix = points_cm[..., :, None, :], projection[..., None, :, :]
    if points.dtype.itemsize < 4:
        points = points.float()
    # No matmul: autocast would make it half precision, and TF32 cut it to ten bits.
    seen = (points * matrix[..., :3]).sum(-1) + matrix[..., 3]
    depth = seen[..., 2:]
    return seen[..., :2] / torch.where(depth > 0, depth, torch.nan)


def view_geometry(sample: Mapping[str, Any], view: str) -> ViewGeometry:
    """Geometry of one view of a sample, as the projectors of :mod:`xden1k.rays` take it.

    Parameters
    ----------
    sample
        Of :class:`xden1k.XDen1K`, with the image and the geometry of the view.
    view
        ``pa`` or ``lat``.

    Raises
    ------
    DataError
        If the sample lacks a field that is needed.
    """
    source, pixel00, column, row, image = (
        part.detach().cpu().double().numpy()
        for part in fields_of(sample, view, (*GEOMETRY_PARTS[:4], ""))
    )
    cone = bool(source[3])
    return ViewGeometry(
        beam="cone" if cone else "parallel",
        pixel00_cm=pixel00,
        column_step_cm=column,
        row_step_cm=row,
        shape=(image.shape[0], image.shape[1]),
        source_cm=source[:3] if cone else None,
        direction=None if cone else -source[:3],
    )


def fields_of(sample: Mapping[str, Any], view: str, parts: tuple[str, ...]) -> list[Tensor]:
    """Return fields of one view of a sample: ``source`` is ``xray_pa_source``, "" the image.

    Raises
    ------
    DataError
        If the view is no view, or the sample lacks one.
    """
    if view not in VIEWS:
        raise DataError(f"view must be one of {list(VIEWS)}, got {view!r}")
    names = [f"xray_{view}_{part}" if part else f"xray_{view}" for part in parts]
    if missing := [name for name in names if name not in sample]:
        raise DataError(
            f"{sample.get('object_id', 'the sample')} has no {', '.join(missing)}: without "
            "geometry a radiograph cannot be kept in its place; ask for these fields, if the "
            "object has radiographs"
        )
    return [sample[name] for name in names]
