"""Where torch can compute."""

from __future__ import annotations

import torch

from xden1k.errors import DataError

__all__ = ["check_device"]


def check_device(device: str) -> None:
    """Refuse a device that torch cannot use here.

    Parameters
    ----------
    device
        As torch names it: ``cpu``, ``cuda``, ``cuda:1``, ``mps``.

    Raises
    ------
    DataError
        If there is none of that name.
    """
    try:
        torch.zeros(1, device=device).item()
    except (RuntimeError, AssertionError) as err:  # the second from builds without CUDA
        raise DataError(
            f"torch has no device {device!r} here: set device=cpu, or find a GPU"
        ) from err
