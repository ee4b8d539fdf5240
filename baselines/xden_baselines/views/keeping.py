"""Pictures that were drawn before, kept in the user's cache.

A piece is named by a checksum of all that decides its pixels: the renderer and its version, the
rig, and the object's parts. Pieces of objects that have changed are therefore never found again,
and go when the cache is full (``XDEN1K_CACHE_GB``). Cameras are not kept: the rig gives them.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Callable

import numpy as np

from xden1k.format.cache import PieceCache, cache_folder, cache_limit
from xden1k.values.types import DensityObject
from xden_baselines.views.cameras import Camera
from xden_baselines.views.pictures import BACKGROUND, Pictures

__all__ = ["keep", "name_of"]

FOLDER = "pictures"


def name_of(obj: DensityObject, recipe: str) -> str:
    """Name the pictures of an object by their content.

    Parameters
    ----------
    obj
        What they show.
    recipe
        How they are drawn: renderer, version and rig.
    """
    digest = hashlib.sha256(f"{recipe}\n{obj.object_id}\n".encode())
    for part in obj.parts:
        digest.update(f"{part.name}\n{part.material}\n{part.color_rgb}\n".encode())
        for array in (part.mesh.vertices, part.mesh.faces):
            digest.update(f"{array.dtype} {array.shape}\n".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
    return f"{digest.hexdigest()}.npz"


def keep(name: str, cameras: tuple[Camera, ...], draw: Callable[[], Pictures]) -> Pictures:
    """Return pictures from the cache; draw and keep them if they are not there.

    Safe where several processes draw the same: a piece appears whole, and both would write the
    same bytes.

    Parameters
    ----------
    name
        As :func:`name_of` gives it.
    cameras
        Theirs.
    draw
        Draws them.

    Raises
    ------
    DataError
        If ``XDEN1K_CACHE_GB`` is not a number, or they cannot be drawn.
    """
    cache = PieceCache(cache_folder() / FOLDER, cache_limit())
    piece = cache.get(name)
    if piece is not None:
        return _unpacked(piece, cameras)
    pictures = draw()
    cache.put(name, _packed(pictures))
    return pictures


def _packed(pictures: Pictures) -> bytes:
    """Only what is on the object."""
    file, masks = io.BytesIO(), pictures.masks
    np.savez_compressed(
        file,
        masks=np.packbits(masks),
        colors=pictures.colors[masks],
        distance_cm=pictures.distance_cm[masks],
    )
    return file.getvalue()


def _unpacked(piece: bytes, cameras: tuple[Camera, ...]) -> Pictures:
    with np.load(io.BytesIO(piece), allow_pickle=False) as found:
        shape = (len(cameras), *cameras[0].shape)
        masks = np.unpackbits(found["masks"], count=int(np.prod(shape))).astype(bool).reshape(shape)
        colors = np.full((*shape, 3), BACKGROUND, dtype=np.uint8)
        colors[masks] = found["colors"]
        distance_cm = np.full(shape, np.inf, dtype=np.float32)
        distance_cm[masks] = found["distance_cm"]
    return Pictures(colors, masks, distance_cm, cameras)
