"""What the network says of an object's pictures."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from jaxtyping import Bool, Float32, UInt8

from xden_baselines.learning.clock import torch_threads
from xden_baselines.surface.network import STRIDE, PixelNetwork, as_input
from xden_baselines.views.pictures import Pictures

__all__ = ["named", "shares"]

Shares = Float32[np.ndarray, "rows columns materials"]


def named(network: PixelNetwork, pictures: Pictures, threads: int, device: str) -> Iterator[Shares]:
    """Give for each view how probable each material is at each pixel.

    Parameters
    ----------
    network
        In evaluation mode, on the device.
    pictures
        Of one object.
    threads
        Of torch.
    device
        ``cpu`` or ``cuda``.
    """
    for view in range(len(pictures)):
        yield shares(network, pictures.colors[view], pictures.masks[view], threads, device)


def shares(
    network: PixelNetwork,
    picture: UInt8[np.ndarray, "rows columns 3"],
    mask: Bool[np.ndarray, "rows columns"],
    threads: int,
    device: str,
) -> Shares:
    """Return how probable each material is at each pixel of a picture: as :func:`named`."""
    rows, columns = mask.shape
    with torch_threads(threads), torch.inference_mode():
        colors = torch.from_numpy(picture[None]).to(device) / 255
        masks = torch.from_numpy(mask[None]).to(device).float()
        found = network(as_input(colors, masks)).softmax(dim=1)[0].movedim(0, -1)
    coarse = found.cpu().numpy()
    whole: Shares = coarse.repeat(STRIDE, axis=0).repeat(STRIDE, axis=1)[:rows, :columns]
    return whole
