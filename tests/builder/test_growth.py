"""Growth is measured on objects of the sizes it names, and on nothing but the case's own memory."""

import json
import os
import resource

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from xden1k.rays import path_lengths
from xden_builder.cli import cli
from xden_builder.speed import growth
from xden_builder.speed.growth import AXES, BASE, Case, Cost, along, cases, costs, draw_growth
from xden_builder.speed.scenes import nested_parts, two_views
from xden_builder.workers import WorkerDiedError


def made_up(case):
    work = case.pixels**2 * case.parts / 1e6
    return Cost(case, work, 2 * work, 200.0, 200.0 + work, 200.0 + 2 * work)


class Deadly(Case):
    """Ends the process that receives it."""

    def __reduce__(self):
        return os._exit, (1,)


@pytest.mark.parametrize(("faces", "parts"), [(600, 1), (2_000, 2), (3_000, 7)])
def test_objects_have_the_faces_and_parts_they_are_asked_for(faces, parts):
    meshes = nested_parts(faces, parts)
    assert len(meshes) == parts
    assert all(mesh.is_volume for mesh in meshes)
    assert sum(len(mesh.faces) for mesh in meshes) == pytest.approx(faces, rel=0.01)


def test_lenses_lie_apart_within_a_casing_that_the_same_pixels_see():
    few, many = (nested_parts(4_000 * parts, parts) for parts in (2, 9))
    for view in two_views(128):
        for meshes in (few, many):
            inner = path_lengths(meshes[:-1], range(len(meshes) - 1), view)
            lengths = path_lengths(meshes, range(len(meshes)), view)
            assert not inner.shared_cm.any()
            assert (lengths.lengths_cm[..., :-1] > 0).any(axis=(0, 1)).all()
            shared_cm, inner_cm = lengths.shared_cm.sum(), inner.lengths_cm.sum()
            assert shared_cm == pytest.approx(inner_cm, rel=1e-5)  # all within the casing
        np.testing.assert_array_equal(
            *(path_lengths(meshes, range(len(meshes)), view).pixels for meshes in (few, many))
        )


def test_each_case_varies_one_thing_and_is_measured_once():
    assert len(cases()) == len(set(cases())) == sum(map(len, AXES.values())) - len(AXES) + 1
    for axis, values in AXES.items():
        assert tuple(getattr(case, axis) for case in along(axis)) == values
        assert BASE in along(axis)


@pytest.mark.slow
def test_memory_is_that_of_the_case_and_not_of_who_asks():
    held = np.ones(12_500_000)
    who_asks_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    (cost,) = costs([Case(pixels=128, faces=400, parts=3)])
    assert 50 < cost.start_mb <= cost.lengths_mb <= cost.fit_mb < who_asks_mb
    assert who_asks_mb > held.nbytes / 1e6
    assert min(cost.lengths_s, cost.fit_s) > 0


def test_a_process_that_dies_is_named():
    with pytest.raises(WorkerDiedError, match=r"pixels=64, faces=20, parts=1\): its process died"):
        growth._in_fresh_process(Deadly(64, 20, 1))


@pytest.mark.slow
def test_growth_is_drawn(tmp_path):
    draw_growth([made_up(case) for case in cases()], tmp_path / "growth.png")
    picture = np.asarray(Image.open(tmp_path / "growth.png").convert("RGB"))
    assert picture.shape == (792, 1320, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50


def test_command_prints_a_line_for_each_size_and_draws(monkeypatch, tmp_path):
    monkeypatch.setattr(growth, "costs", lambda chosen: map(made_up, chosen))
    plot = tmp_path / "growth.png"
    shown = CliRunner().invoke(cli, ["speed", "--growth", "-o", str(plot)])
    assert shown.exit_code == 0
    assert plot.stat().st_size > 10_000
    lines = shown.output.splitlines()[2:]
    assert [tuple(line.split()[:2]) for line in lines] == [
        (axis, f"{value:,}") for axis, values in AXES.items() for value in values
    ]
    printed = CliRunner().invoke(cli, ["speed", "--growth", "--json"])
    assert json.loads(printed.output) == [made_up(case).to_dict() for case in cases()]


def test_a_plot_without_growth_is_refused(tmp_path):
    refused = CliRunner().invoke(cli, ["speed", "-o", str(tmp_path / "growth.png")])
    assert refused.exit_code == 2
    assert "it needs --growth" in refused.output
