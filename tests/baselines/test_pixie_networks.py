"""The networks: size, shape, and that every weight takes part."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
import torch

from xden_baselines.learning.clock import torch_threads
from xden_baselines.pixie.networks import STRIDE, CpuNet, FullNet, count_parameters


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    with torch_threads(1):
        yield


def everywhere(network: torch.nn.Module, volume: torch.Tensor) -> torch.Tensor:
    inside = torch.ones_like(volume[:, 0], dtype=torch.bool)
    return network(volume, inside, torch.ones(len(volume), 2))


def test_the_sizes_are_those_the_documentation_names() -> None:
    with torch.device("meta"):
        assert count_parameters(CpuNet(22, 25, 2)) == 397_266
        assert count_parameters(FullNet(768, 25, 16)) == 53_440_368


@pytest.mark.parametrize("network", [CpuNet(5, 2, 3), FullNet(5, 2, 3, base=8)])
@pytest.mark.parametrize("edge", [STRIDE, 3 * STRIDE])
def test_the_grid_stays_whatever_its_size(network: torch.nn.Module, edge: int) -> None:
    with torch.inference_mode():
        assert everywhere(network, torch.ones(2, 5, edge, edge, edge)).shape == (
            2,
            3,
            edge,
            edge,
            edge,
        )


@pytest.mark.parametrize("network", [CpuNet(5, 2, 3), FullNet(5, 2, 3, base=8)])
def test_no_weight_is_idle(network: torch.nn.Module) -> None:
    generator = torch.Generator().manual_seed(0)
    for weight in network.parameters():
        torch.nn.init.normal_(weight, std=0.1, generator=generator)
    volume = torch.randn(2, 5, 16, 16, 16, generator=generator)
    everywhere(network, volume).square().mean().backward()
    idle = [name for name, weight in network.named_parameters() if not weight.grad.abs().max() > 0]
    assert idle == []


@pytest.mark.parametrize("network", [CpuNet(5, 2, 3), FullNet(5, 2, 3, base=8)])
def test_a_fresh_network_answers_zero(network: torch.nn.Module) -> None:
    with torch.inference_mode():
        assert not everywhere(network, torch.ones(1, 5, 16, 16, 16)).any()


def test_far_voxels_reach_each_other_through_the_coarse_levels() -> None:
    network = CpuNet(1, 2, 1)
    generator = torch.Generator().manual_seed(0)
    for weight in network.parameters():
        torch.nn.init.normal_(weight, std=0.3, generator=generator)
    volume = torch.zeros(1, 1, 32, 32, 32, requires_grad=True)
    everywhere(network, volume)[0, 0, 16, 16, 16].backward()
    assert volume.grad is not None
    assert volume.grad[0, 0, 4, 16, 16] != 0


@pytest.mark.parametrize("network", [CpuNet(5, 2, 3), FullNet(5, 2, 3, base=8)])
def test_the_answer_is_zero_in_the_air(network: torch.nn.Module) -> None:
    generator = torch.Generator().manual_seed(0)
    for weight in network.parameters():
        torch.nn.init.normal_(weight, std=0.1, generator=generator)
    inside = torch.zeros(1, 16, 16, 16, dtype=torch.bool)
    inside[:, 3:9] = True
    with torch.inference_mode():
        answer = network(torch.ones(1, 5, 16, 16, 16), inside, torch.ones(1, 2))
    assert not answer[:, :, ~inside[0]].any()
    assert answer[:, :, inside[0]].all()
