"""Processes that train one network together, as ``torchrun`` starts them on one machine.

Every process draws the same batches and computes the gradients of its own objects; their sum is
what one process would have had, but for rounding.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import timedelta
from typing import Final, TypeVar

import torch
from torch import distributed

from xden1k.errors import DataError
from xden_baselines.xfield.batches import Batch

__all__ = ["ALONE", "Crew", "joined"]

Item = TypeVar("Item")

LONGEST_WAIT: Final = timedelta(days=2)
"""While the first process prepares what the others then find in the cache."""


@dataclass(frozen=True, slots=True)
class Crew:
    """One of so many processes.

    Parameters
    ----------
    rank
        Which, from 0.
    count
        How many there are.
    """

    rank: int = 0
    count: int = 1

    @property
    def first(self) -> bool:
        """Whether it is the one that keeps what is trained."""
        return self.rank == 0

    def device(self, name: str) -> str:
        """Name the process's own device; of ``cuda`` the card of its rank."""
        return f"cuda:{self.rank}" if name == "cuda" and self.count > 1 else name

    def share(self, items: Sequence[Item]) -> list[Item]:
        """Take every so-manieth item."""
        return list(items[self.rank :: self.count])

    def share_of(self, batch: Batch) -> Batch:
        """Take every so-manieth object, perhaps none."""
        return batch.objects(slice(self.rank, None, self.count))

    def in_order(self, found: list[Item]) -> list[Item]:
        """Give what all processes found for their shares, in the order of the whole."""
        if self.count == 1:
            return found
        each: list[list[Item]] = [[] for _ in range(self.count)]
        distributed.all_gather_object(each, found)
        whole = sum(map(len, each))
        return [each[number % self.count][number // self.count] for number in range(whole)]

    def add_gradients(self, model: torch.nn.Module) -> None:
        """Give every process the sum of all gradients; a weight that has none anywhere stays so."""
        if self.count == 1:
            return
        weights = [one for one in model.parameters() if one.requires_grad]
        known = torch.tensor([one.grad is not None for one in weights], device=weights[0].device)
        anywhere = known.int()
        distributed.all_reduce(anywhere, distributed.ReduceOp.MAX)
        for one, needed in zip(weights, anywhere.tolist(), strict=True):
            if not needed:
                continue
            if one.grad is None:
                one.grad = torch.zeros_like(one)
            distributed.all_reduce(one.grad)

    def wait(self) -> None:
        """Wait until all processes are here."""
        if self.count > 1:
            distributed.barrier()

    @contextmanager
    def first_one_first(self) -> Iterator[None]:
        """Let the first process do what is in this block before the others do it."""
        if not self.first:
            self.wait()
        yield
        if self.first:
            self.wait()


ALONE: Final = Crew()


@contextmanager
def joined(device: str) -> Iterator[Crew]:
    """Join the processes that ``torchrun`` has started; without it, be alone.

    Raises
    ------
    DataError
        If they are on several machines, or there are more than GPUs.
    """
    count = int(os.environ.get("WORLD_SIZE", "1"))
    if count == 1:
        yield ALONE
        return
    if count != int(os.environ["LOCAL_WORLD_SIZE"]):
        raise DataError("processes on several machines share no cache: run torchrun on one alone")
    crew = Crew(int(os.environ["RANK"]), count)
    on_gpu = device == "cuda"
    if on_gpu and torch.cuda.device_count() < count:
        raise DataError(
            f"torchrun started {count} processes, but there are {torch.cuda.device_count()} GPUs"
        )
    if on_gpu:
        torch.cuda.set_device(crew.rank)
    backend = "cpu:gloo,cuda:nccl" if on_gpu else "gloo"
    distributed.init_process_group(backend, timeout=LONGEST_WAIT)
    try:
        yield crew
    finally:
        distributed.destroy_process_group()
