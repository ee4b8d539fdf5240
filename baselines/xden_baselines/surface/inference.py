"""What the network says of an object's pictures."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import torch
from jaxtyping import Float32

from xden_baselines.learning.clock import torch_threads
from xden_baselines.surface.network import STRIDE, PixelNetwork, as_input
from xden_baselines.views.pictures import Pictures

__all__ = ["named"]


def named(
    network: PixelNetwork, pictures: Pictures, threads: int, device: str
) -> Iterator[Float32[np.ndarray, "rows columns materials"]]:
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
    rows, columns = pictures.masks.shape[1:]
    for view in range(len(pictures)):
        with torch_threads(threads), torch.inference_mode():
            colors = torch.from_numpy(pictures.colors[[view]]).to(device) / 255
            masks = torch.from_numpy(pictures.masks[[view]]).to(device).float()
            shares = network(as_input(colors, masks)).softmax(dim=1)[0].movedim(0, -1)
        coarse = shares.cpu().numpy()
        yield coarse.repeat(STRIDE, axis=0).repeat(STRIDE, axis=1)[:rows, :columns]
