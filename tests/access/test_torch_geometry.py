"""The geometry of radiographs as tensors: the same projection as the values have."""

from __future__ import annotations

import inspect

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from xden1k.access.geometry import (
    GEOMETRY_PARTS,
    geometry_tensors,
    project,
    projection_matrix,
    view_geometry,
)
from xden1k.errors import DataError
from xden1k.values.views import ViewGeometry


@st.composite
def geometries(draw: st.DrawFn) -> ViewGeometry:
    """A detector behind the origin, skewed and turned, in a beam of either kind."""
    noise = np.random.default_rng(draw(st.integers(0, 2**32)))
    turn, _ = np.linalg.qr(noise.normal(size=(3, 3)))
    across, down, away = turn
    pixel = draw(st.floats(0.01, 0.3))
    shape = draw(st.integers(2, 1200)), draw(st.integers(2, 1200))
    column = pixel * (across + 0.05 * noise.normal(size=3))
    row = pixel * draw(st.floats(0.5, 2)) * (down + 0.05 * noise.normal(size=3))
    middle = 30 * away + (shape[1] - 1) / 2 * column + (shape[0] - 1) / 2 * row
    corner = 60 * away - middle
    cone = draw(st.booleans())
    return ViewGeometry(
        beam="cone" if cone else "parallel",
        pixel00_cm=corner,
        column_step_cm=column,
        row_step_cm=row,
        shape=shape,
        source_cm=-draw(st.floats(50, 150)) * away if cone else None,
        direction=None if cone else draw(st.floats(0.1, 10)) * away,
    )


def points(seed: int, count: int = 20) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-10, 10, (count, 3))


@settings(deadline=None, max_examples=40)
@given(geometries(), st.integers(0, 1000))
def test_points_are_seen_where_the_geometry_says(geometry: ViewGeometry, seed: int) -> None:
    cloud = points(seed)
    expected = geometry.project(cloud)[:, :2]
    parts = geometry_tensors(geometry)
    seen = project(torch.tensor(cloud, dtype=torch.float32), parts["projection"])
    assert seen.dtype == torch.float32
    np.testing.assert_allclose(seen, expected, atol=0.01)
    exact = projection_matrix(*(parts[name].double() for name in GEOMETRY_PARTS[:4]))
    np.testing.assert_allclose(project(torch.tensor(cloud), exact), expected, atol=5e-3)


@settings(deadline=None, max_examples=20)
@given(geometries())
def test_a_geometry_is_what_its_tensors_say(geometry: ViewGeometry) -> None:
    sample = {f"xray_pa_{name}": part for name, part in geometry_tensors(geometry).items()}
    back = view_geometry(sample | {"xray_pa": torch.zeros(geometry.shape)}, "pa")
    assert (back.beam, back.shape) == (geometry.beam, geometry.shape)
    cloud = points(3)
    np.testing.assert_allclose(back.project(cloud), geometry.project(cloud), atol=0.01, rtol=1e-5)


def test_the_axes_of_a_batch_broadcast() -> None:
    two = torch.stack([geometry_tensors(view)["projection"] for view in (CONE, FLAT)])
    cloud = torch.tensor(points(1), dtype=torch.float32)
    both = project(cloud, two)
    assert both.shape == (2, 20, 2)
    for view, seen in zip((CONE, FLAT), both, strict=True):
        np.testing.assert_allclose(seen, view.project(cloud.double().numpy())[:, :2], atol=1e-2)
    assert project(cloud.expand(5, 2, 20, 3), two).shape == (5, 2, 20, 2)


@pytest.mark.parametrize("beam", ["cone", "parallel"])
def test_gradients_are_those_of_finite_differences(beam: str) -> None:
    parts = geometry_tensors(CONE if beam == "cone" else FLAT)
    start, *steps = (parts[name].double() for name in GEOMETRY_PARTS[:4])
    leaves = [torch.tensor(points(2, 3)), start[:3].clone(), *steps]

    def seen(cloud: torch.Tensor, place: torch.Tensor, *rest: torch.Tensor) -> torch.Tensor:
        return project(cloud, projection_matrix(torch.cat([place, start[3:]]), *rest))

    for leaf in leaves:
        leaf.requires_grad_()
    assert torch.autograd.gradcheck(seen, leaves, rtol=1e-3)


@pytest.mark.slow
def test_a_pose_is_found_by_descent() -> None:
    matrix = geometry_tensors(CONE)["projection"]
    cloud = torch.tensor(points(5), dtype=torch.float32)
    target = project(cloud + torch.tensor([0.3, 0.0, -0.2]), matrix)
    offset = torch.zeros(3, requires_grad=True)
    descent = torch.optim.LBFGS([offset], max_iter=20, line_search_fn="strong_wolfe")

    def loss() -> torch.Tensor:
        descent.zero_grad()
        value = (project(cloud + offset, matrix) - target).square().mean()
        value.backward()
        return value

    descent.step(loss)
    np.testing.assert_allclose(offset.detach(), [0.3, 0, -0.2], atol=1e-2)


def test_what_lies_behind_the_source_is_not_a_number() -> None:
    matrix = geometry_tensors(CONE)["projection"]
    seen = project(torch.tensor([[0.0, -101, 0], [0, 0, 0]]), matrix)
    assert seen.isnan().all(dim=-1).tolist() == [True, False]


def test_autocast_and_half_precision_leave_pixels_sharp() -> None:
    matrix = geometry_tensors(CONE)["projection"]
    cloud = torch.tensor(points(6), dtype=torch.float32)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        assert torch.equal(project(cloud, matrix), project(cloud, matrix))
        assert project(cloud, matrix).dtype == torch.float32
    np.testing.assert_allclose(
        project(cloud.half(), matrix), project(cloud.half().float(), matrix), atol=1e-3
    )


def test_a_sample_without_geometry_is_told_so() -> None:
    sample = {"object_id": "mug-0001", "xray_pa": torch.zeros(3, 3)}
    with pytest.raises(DataError, match=r"mug-0001 has no xray_pa_source, xray_pa_pixel00_cm"):
        view_geometry(sample, "pa")
    with pytest.raises(DataError, match=r"view must be one of \['pa', 'lat'\], got 'ap'"):
        view_geometry(sample, "ap")


CONE = ViewGeometry(
    beam="cone",
    pixel00_cm=np.array([-20.0, 20, 21]),
    column_step_cm=np.array([0.2, 0, 0]),
    row_step_cm=np.array([0.01, 0, -0.2]),
    shape=(210, 200),
    source_cm=np.array([1.0, -100, 2]),
)
FLAT = ViewGeometry(
    beam="parallel",
    pixel00_cm=np.array([-20.0, 20, 21]),
    column_step_cm=np.array([0.2, 0, 0]),
    row_step_cm=np.array([0, 0.1, -0.2]),
    shape=(210, 200),
    direction=np.array([0.1, 3.0, 0]),
)


def test_project_says_which_shapes_it_wants() -> None:
    unchecked = inspect.unwrap(project)  # the slow suite checks annotations before
    with pytest.raises(DataError, match=r"wanted, got \(5, 3\) and \(192, 192\)"):
        unchecked(torch.zeros(5, 3), torch.zeros(192, 192))
    with pytest.raises(DataError, match=r"wanted, got \(3,\) and \(3, 4\)"):
        unchecked(torch.zeros(3), torch.zeros(3, 4))
