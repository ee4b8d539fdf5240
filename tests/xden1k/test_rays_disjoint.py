"""Ways through parts that share no space: those of sorted crossings, whatever the view."""

import dataclasses

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from xden1k.errors import DataError
from xden1k.rays import disjoint_path_lengths, disjoint_regions, kernels, path_lengths
from xden1k.rays.lattice import Lattice
from xden1k.values.views import ViewGeometry

SIZE = 40
ROUNDING_CM = 1e-5
PANEL = ViewGeometry(
    beam="cone",
    pixel00_cm=np.array([-9.7, 30.0, 9.9]),
    column_step_cm=np.array([0.5, 0.0, 0.0]),
    row_step_cm=np.array([0.0, 0.0, -0.5]),
    shape=(SIZE, SIZE),
    source_cm=np.array([0.3, -100.0, 0.7]),
)
PARALLEL = dataclasses.replace(
    PANEL, beam="parallel", source_cm=None, direction=np.array([0.02, 1.0, -0.05])
)
seeds = st.integers(0, 2**32 - 1)
MIRRORED = [
    dataclasses.replace(
        view,
        pixel00_cm=np.array([9.7, 30.0, 9.9]),
        column_step_cm=-view.column_step_cm,
    )
    for view in (PANEL, PARALLEL)
]
views = st.sampled_from([PANEL, PARALLEL, *MIRRORED])


def turned(mesh, rng, shift=1.0):
    pose = trimesh.transformations.random_rotation_matrix(rng.random(3))
    pose[:3, 3] = shift * rng.uniform(-1, 1, 3)
    return mesh.copy().apply_transform(pose)


def frames(lengths):
    """Lengths of each ray of the whole detector, zero where none is told."""
    whole = np.zeros((lengths.shape[0] * lengths.shape[1], *lengths.lengths_cm.shape[1:]))
    whole[lengths.pixels] = lengths.lengths_cm
    return whole


@settings(max_examples=40)
@given(
    seed=seeds,
    view=views,
    subrays=st.integers(1, 4),
    on_a_turned_lattice=st.booleans(),
    shift=st.sampled_from([1.0, 12.0]),
)
def test_parts_cut_to_what_they_own_have_the_lengths_of_sorted_crossings(
    seed, view, subrays, on_a_turned_lattice, shift
):
    """By 12 cm they reach out of the detector, or lie beside it."""
    rng = np.random.default_rng(seed)
    hollow = trimesh.creation.annulus(1.5, 2.5, 4.0, sections=20)
    solids = [trimesh.creation.box((3, 2, 5)), trimesh.creation.icosphere(2, 2.0), hollow]
    meshes = [turned(solid, rng, shift) for solid in solids]
    order = rng.permutation(3).tolist()
    sorted_ones = path_lengths(meshes, order, view, subrays, turned=on_a_turned_lattice)
    regions = disjoint_regions(meshes, order)
    summed = disjoint_path_lengths(regions, view, subrays, turned=on_a_turned_lattice)
    assert frames(summed) == pytest.approx(frames(sorted_ones), abs=ROUNDING_CM)
    assert np.isin(summed.pixels, sorted_ones.pixels).all()


@given(seed=seeds, view=views)
def test_one_mesh_is_met_just_where_sorted_crossings_meet_it(seed, view):
    rng = np.random.default_rng(seed)
    mesh = turned(trimesh.creation.torus(3.0, 1.0, 12, 9), rng)
    summed, sorted_ones = disjoint_path_lengths([mesh], view, 2), path_lengths([mesh], [0], view, 2)
    assert summed.pixels.tolist() == sorted_ones.pixels.tolist()
    assert summed.lengths_cm == pytest.approx(sorted_ones.lengths_cm, abs=ROUNDING_CM)


@pytest.mark.parametrize("view", [PANEL, PARALLEL])
def test_a_plate_across_the_beam_is_as_long_as_its_slant(view):
    plate = trimesh.creation.box((30.0, 0.5, 30.0))
    rows, columns = np.indices(view.shape).astype(float)
    centres = view.pixel_centres_cm(rows, columns)
    along = centres - view.source_cm if view.beam == "cone" else view.direction
    slant = np.linalg.norm(along, axis=-1) / along[..., 1] * np.ones(view.shape)
    seen = disjoint_path_lengths([plate], view)
    assert len(seen.pixels) == SIZE * SIZE
    assert seen.lengths_cm[:, 0, 0] == pytest.approx(0.5 * slant.ravel(), rel=1e-6)


@pytest.mark.parametrize("view", [PANEL, PARALLEL])
def test_rays_along_edges_and_through_vertices_leave_nothing_over(view):
    """A crossing too many or too few would be as long as the way to the source."""
    upright = dataclasses.replace(
        view,
        pixel00_cm=np.array([-10.0, 30.0, 10.0]),
        **({"source_cm": np.array([0.0, -100.0, 0.0])} if view.beam == "cone" else {}),
        **({"direction": np.array([0.0, 1.0, 0.0])} if view.beam == "parallel" else {}),
    )
    box = trimesh.creation.box((4.0, 4.0, 4.0)).subdivide().subdivide()
    seen = disjoint_path_lengths([box], upright, 2)
    assert float(seen.lengths_cm.max()) < 4.0 * 1.02
    covered = frames(seen).reshape(*upright.shape, -1).mean(axis=2) > 0
    rows, columns = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    assert covered[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1].all()


def test_slivers_thinner_than_rounding_add_no_length():
    corners = [[0, 0, 0], [0, 0, 5], [1e-13, 0, 2.5], [0, 1e-13, 2.5]]
    sliver = trimesh.Trimesh(corners, [[0, 1, 2], [1, 0, 3], [0, 2, 3], [2, 1, 3]], process=False)
    lengths = disjoint_path_lengths([sliver], PANEL, 4).lengths_cm
    assert not lengths.size or float(lengths.max()) < 1e-9


def test_space_that_one_mesh_covers_twice_counts_twice():
    box = trimesh.creation.box((3.0, 2.0, 3.0))
    twice = trimesh.util.concatenate([box, box.copy()])
    once, both = disjoint_path_lengths([box], PANEL), disjoint_path_lengths([twice], PANEL)
    assert both.lengths_cm == pytest.approx(2 * once.lengths_cm, abs=ROUNDING_CM)


@pytest.mark.parametrize("on_a_turned_lattice", [False, True])
@pytest.mark.parametrize("subrays", [1, 2, 3, 8])
def test_each_ray_of_a_pixel_has_a_number_of_its_own(subrays, on_a_turned_lattice):
    lattice = Lattice.of(subrays, turned=on_a_turned_lattice)
    whole, found = 2 * lattice.rays, []
    for row, column in lattice.places.tolist():
        places = kernels.over_pixel(row, column, lattice.along, lattice.across)
        below, beside = (place % whole for place in places)
        key = kernels.key_of(below, beside, lattice.along, lattice.across)
        found.append(int(lattice.numbers[key]))
    assert found == list(range(lattice.rays))


def test_what_leaves_the_detector_is_cut_off_there():
    wide = trimesh.creation.box((60.0, 1.0, 60.0))
    seen = disjoint_path_lengths([wide], PANEL, 3, turned=True)
    assert seen.pixels.tolist() == list(range(SIZE * SIZE))


def test_an_empty_mesh_among_others_is_met_by_no_ray():
    box = trimesh.creation.box((3.0, 3.0, 3.0))
    seen = disjoint_path_lengths([trimesh.Trimesh(), box], PANEL)
    assert not seen.lengths_cm[:, :, 0].any()
    assert seen.lengths_cm[:, :, 1].any()
    assert not len(disjoint_path_lengths([trimesh.Trimesh()], PANEL).pixels)


def test_bad_input_is_refused_with_its_part_and_place():
    near = trimesh.creation.box((1.0, 1.0, 1.0)).apply_translation((0, -100, 0))
    with pytest.raises(DataError, match=r"part 1: \d+ of 12 triangles reach behind the X-ray"):
        disjoint_path_lengths([trimesh.creation.box((1, 1, 1)), near], PANEL)
    with pytest.raises(DataError, match="subrays must be at least 1, got 0"):
        disjoint_path_lengths([near], PANEL, 0)
