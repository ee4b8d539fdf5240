"""X-Field's network: planes, blocks, variants, and that points are answered one by one."""

from __future__ import annotations

import math
from dataclasses import fields, replace

import pytest
import torch
from jaxtyping import Float
from torch import Tensor

from xden_baselines.pixie.networks import count_parameters
from xden_baselines.xfield.blocks import FiLM, PointVoxel
from xden_baselines.xfield.network import Inputs, XField
from xden_baselines.xfield.planes import (
    PLANES,
    grid_means,
    grid_samples,
    plane_means,
    plane_samples,
)
from xden_baselines.xfield.rays import projected, sampled
from xden_baselines.xfield.sizes import SIZES
from xden_baselines.xfield.variants import VARIANTS

on_a_gpu = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA GPU")
COUNTS = {
    ("tiny", "geometry-density"): 103_137,
    ("tiny", "geometry-contrastive"): 104_112,
    ("tiny", "cross"): 166_802,
    ("tiny", "pixel"): 138_625,
    ("tiny", "both"): 173_410,
    ("tiny", "rays"): 104_689,
    ("tiny", "voxel"): 414_529,
    ("small", "pixel"): 1_462_769,
    ("small", "cross"): 1_721_634,
    ("medium", "pixel"): 5_938_097,
    ("paper-lite", "cross"): 33_478_146,
    ("paper", "geometry-density"): 94_474_753,
    ("paper", "cross"): 131_947_810,
    ("paper", "both"): 132_154_354,
}


@pytest.mark.parametrize(("size", "variant"), COUNTS)
def test_no_weight_comes_or_goes_unnoticed(size: str, variant: str) -> None:
    with torch.device("meta"):
        assert count_parameters(XField(variant=variant, size=size)) == COUNTS[size, variant]


def places(batch: int = 2, points: int = 30) -> Float[Tensor, "batch points 3"]:
    return torch.rand(batch, points, 3) * 2 - 1


def inputs(batch: int = 2) -> Inputs:
    """Random objects between a source at y = -5 and one at x = -5, in units of the cube."""
    size = SIZES["tiny"]
    views = torch.tensor(
        [
            [[3.0, 0, 0, 0], [0, 0, -3.0, 0], [0, 1, 0, 5]],
            [[0, -3.0, 0, 0], [0, 0, -3.0, 0], [1, 0, 0, 5]],
        ]
    )
    image = (batch, 2, size.crop_px, size.crop_px)
    return Inputs(
        surface=torch.cat([places(batch, size.points), places(batch, size.points)], dim=-1),
        transmission=torch.rand(image),
        chord=torch.rand(image),
        projection=views.expand(batch, -1, -1, -1),
        half_cm=torch.linspace(2, 9, batch),
    )


@pytest.fixture(autouse=True)
def _same_numbers() -> None:
    torch.manual_seed(0)


def test_a_plane_that_holds_a_ramp_returns_the_coordinate() -> None:
    asked = places() * 0.9
    ramp = (torch.arange(8.0) * 2 + 1) / 8 - 1
    for plane, axes in enumerate(PLANES):
        for which, axis in enumerate(axes):
            planes = torch.zeros(2, 3, 1, 8, 8)
            planes[:, plane, 0] = ramp[:, None] if which == 0 else ramp[None, :]
            found = plane_samples(planes, asked)[..., 0]
            inner = asked[..., axis].clamp(ramp[0], ramp[-1])
            assert torch.allclose(found, inner, atol=1e-5), (plane, axis)


def test_an_image_that_is_not_square_is_read_by_column_and_row() -> None:
    at = torch.tensor([[[-0.5, 0.25]]])
    columns = ((torch.arange(8.0) * 2 + 1) / 8 - 1).expand(4, 8)
    rows = ((torch.arange(4.0) * 2 + 1) / 4 - 1)[:, None].expand(4, 8)
    found = sampled(torch.stack([columns, rows])[None], at)
    assert torch.allclose(found, at)


def test_a_grid_that_holds_a_ramp_returns_the_coordinate() -> None:
    asked = places() * 0.8
    ramp = (torch.arange(8.0) * 2 + 1) / 8 - 1
    grid = torch.stack(torch.meshgrid(ramp, ramp, ramp, indexing="ij")).expand(2, -1, -1, -1, -1)
    assert torch.allclose(grid_samples(grid, asked), asked, atol=1e-5)


def test_scatter_means_are_those_of_a_loop() -> None:
    features, where = torch.randn(1, 40, 2), places(1, 40)
    found_planes = plane_means(features, where, 4)[0]
    found_grid = grid_means(features, where, 4)[0]
    cells = [[min(int((c + 1) * 2), 3) for c in point] for point in where[0].tolist()]
    for plane, (row, column) in enumerate(PLANES):
        for r in range(4):
            for c in range(4):
                mine = [
                    f
                    for f, k in zip(features[0], cells, strict=True)
                    if (k[row], k[column]) == (r, c)
                ]
                mean = torch.stack(mine).mean(0) if mine else torch.zeros(2)
                assert torch.allclose(found_planes[plane, :, r, c], mean, atol=1e-6)
    voxel = cells[0]
    mine = [f for f, k in zip(features[0], cells, strict=True) if k == voxel]
    assert torch.allclose(found_grid[:, *voxel], torch.stack(mine).mean(0), atol=1e-6)


def test_scatter_means_keep_constants_where_there_are_points() -> None:
    found = grid_means(torch.full((1, 50, 1), 3.0), places(1, 50), 2)
    assert ((found == 0) | (found - 3).abs().lt(1e-5)).all()


@pytest.mark.parametrize("device", ["cpu", pytest.param("cuda", marks=on_a_gpu)])
def test_scatter_means_of_many_points_in_bf16_are_means_over_all(device: str) -> None:
    features = torch.cat([torch.ones(1, 400, 1), torch.zeros(1, 800, 1)], dim=1)
    where = torch.full((1, 1200, 3), 0.5, device=device)
    found = plane_means(features.bfloat16().to(device), where, 2)[0, :, 0, 1, 1]
    assert found.tolist() == pytest.approx([1 / 3] * 3, abs=1e-5)


def test_points_meet_radiographs_in_bf16_where_they_do_in_float32() -> None:
    shown, asked = inputs(), places()
    with torch.autocast("cpu", dtype=torch.bfloat16):
        found = projected(shown.projection, asked)
    assert torch.equal(found, projected(shown.projection, asked))


@on_a_gpu
@pytest.mark.parametrize("variant", VARIANTS)
def test_a_gpu_answers_what_a_cpu_does(variant: str) -> None:
    model, shown, asked = XField(variant=variant, size="tiny").eval(), inputs(), places()
    with torch.inference_mode():
        wanted = model(shown, asked)
        there = Inputs(*(getattr(shown, one.name).cuda() for one in fields(Inputs)))
        found = model.cuda()(there, asked.cuda())
    assert torch.allclose(found.density_g_cm3.cpu(), wanted.density_g_cm3, atol=2e-3)
    assert torch.allclose(found.embedding.cpu(), wanted.embedding, atol=2e-2)


def test_the_order_of_points_changes_nothing_but_theirs() -> None:
    block = PointVoxel(6, 8, 4).eval()
    features, where = torch.randn(1, 30, 6), places(1, 30)
    order = torch.randperm(30)
    found = block(features, where)[:, order]
    assert torch.allclose(block(features[:, order], where[:, order]), found, atol=1e-5)


def test_scale_changes_nothing_before_it_is_learned() -> None:
    features = torch.randn(2, 2, 5, 3, 3)
    assert torch.equal(FiLM(5)(features, torch.tensor([0.5, 40.0])), features)


@pytest.mark.parametrize(
    "variant", ["geometry-density", "geometry-contrastive", "cross-no-attention"]
)
def test_geometry_does_not_look_at_radiographs(variant: str) -> None:
    model, shown, asked = XField(variant=variant, size="tiny").eval(), inputs(), places()
    none = replace(
        shown,
        transmission=shown.transmission[:, :0],
        chord=shown.chord[:, :0],
        projection=shown.projection[:, :0],
    )
    with torch.inference_mode():
        one, two = model(shown, asked), model(none, asked)
    assert torch.equal(one.embedding, two.embedding)
    assert torch.equal(one.density_g_cm3, two.density_g_cm3)


@pytest.mark.parametrize("variant", [name for name, one in VARIANTS.items() if one.xray])
def test_every_part_of_the_network_learns_from_both_views(variant: str) -> None:
    model, shown = XField(variant=variant, size="tiny"), inputs()
    shown = replace(shown, transmission=shown.transmission.requires_grad_())
    field = model.field(shown)
    out = model.at(field, places())
    total = out.density_g_cm3.square().sum() + out.embedding.sum(-1).square().sum()
    if model.third is not None:
        total = total + model.third(field.shape).sum()
    total.backward()
    assert shown.transmission.grad is not None
    assert (shown.transmission.grad.abs().sum((2, 3)) > 0).all()
    assert out.density_g_cm3.shape[-1] == VARIANTS[variant].density
    assert out.embedding.shape[-1] == 16 * VARIANTS[variant].parts
    idle = [name for name, one in model.named_parameters() if one.grad is None]
    assert not idle


@pytest.mark.parametrize(("variant", "told"), [("cross", True), ("cross-no-scale", False)])
def test_tokens_of_radiographs_are_told_the_scale(variant: str, told: bool) -> None:
    model = XField(variant=variant, size="tiny").eval()
    assert model.context is not None
    for weights in model.context.film.parameters():
        torch.nn.init.normal_(weights)
    levels, half_cm = torch.rand(1, 2, SIZES["tiny"].view_widths[-1], 8, 8), torch.tensor([[3.0]])
    with torch.inference_mode():
        small, large = (model.context(levels, half_cm[0] * factor) for factor in (1, 4))
    assert torch.equal(small, large) != told


def test_a_paper_without_a_third_view_decodes_none() -> None:
    assert XField(variant="cross", size="tiny").third is not None
    assert XField(variant="cross-no-third", size="tiny").third is None


def test_points_are_answered_one_by_one() -> None:
    model, shown, asked = XField(variant="both", size="tiny").eval(), inputs(), places(2, 21)
    with torch.inference_mode():
        field = model.field(shown)
        whole = model.at(field, asked)
        parts = [model.at(field, chunk) for chunk in torch.split(asked, 8, dim=1)]
    for one in fields(whole):
        joined = torch.cat([getattr(part, one.name) for part in parts], dim=1)
        assert torch.allclose(getattr(whole, one.name), joined, atol=1e-5), one.name


def test_objects_of_a_batch_do_not_mix() -> None:
    model, shown, asked = XField(variant="both", size="tiny").eval(), inputs(), places()
    first = Inputs(*(getattr(shown, one.name)[:1] for one in fields(shown)))
    with torch.inference_mode():
        together, alone = model(shown, asked), model(first, asked[:1])
    assert torch.allclose(together.density_g_cm3[:1], alone.density_g_cm3, atol=1e-4)


def test_an_embedding_has_length_one() -> None:
    with torch.inference_mode():
        out = XField(variant="rays", size="tiny")(inputs(), places())
    assert torch.allclose(out.embedding.norm(dim=-1), torch.ones(2, 30))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"variant": "triplane"}, "variant must be one of .*'pixel'.*, got 'triplane'"),
        ({"size": "huge"}, "size must be one of .*'tiny'.*, got 'huge'"),
        ({"format": "xfield/2"}, "format must be one of"),
        ({"unit_g_cm3": 1.0}, "unit_g_cm3 must be one of .4.0., got 1.0"),
        ({"views": ["lat", "pa"]}, "views must be one of"),
    ],
)
def test_another_format_unit_or_order_of_views_is_refused(wrong: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        XField(**{"variant": "pixel", "size": "tiny"} | wrong)


def test_sizes_fit_together() -> None:
    for size in SIZES.values():
        assert len(size.point_widths) == len(size.point_grids)
        assert size.plane % size.tokens == 0
        assert size.crop_px % 2 ** (len(size.view_widths) + 1) == 0
        assert math.gcd(*size.point_widths) % 8 == 0
