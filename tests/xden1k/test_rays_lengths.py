"""Path lengths against half-space clipping and ray/triangle sums, and the laws they obey."""

import dataclasses
import importlib
import sys
from itertools import pairwise

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from xden1k.errors import DataError, MissingExtraError
from xden1k.rays import PathLengths, kernels, path_lengths
from xden1k.rays import lengths as lengths_module
from xden1k.rays.lattice import Lattice
from xden1k.values.views import ViewGeometry

SIZE = 48
NONE = np.zeros(0, dtype=np.int64)
seeds = st.integers(0, 2**32 - 1)
beams = st.sampled_from(["cone", "parallel"])


def view(beam="cone", *, size=SIZE, tilt=0.0, seed=0, flip_rows=False, mirror=False):
    """A panel 30 cm behind the object, source 100 cm before it; tilted panels have skewed steps."""
    rng = np.random.default_rng(seed)
    column = np.array([20 / size, 0, 0]) * (-1 if mirror else 1)
    row = np.array([0, 0, -20 / size]) * (-1 if flip_rows else 1)
    column, row = (step + tilt * rng.normal(size=3) * 20 / size for step in (column, row))
    middle = np.array([0.1, 30.0, -0.2])
    source = {"source_cm": np.array([0.3, -100.0, 0.7])}
    direction = {"direction": np.array([0.02, 1.0, -0.05])}
    return ViewGeometry(
        beam=beam,
        pixel00_cm=middle - (size - 1) / 2 * (column + row),
        column_step_cm=column,
        row_step_cm=row,
        shape=(size, size),
        **(source if beam == "cone" else direction),
    )


def turned(mesh, seed, shift=1.0):
    rng = np.random.default_rng(seed)
    pose = trimesh.transformations.random_rotation_matrix(rng.random(3))
    pose[:3, 3] = shift * rng.uniform(-1, 1, 3)
    return mesh.copy().apply_transform(pose)


def rays(geometry):
    """Origins and unit directions of the rays through all pixel centres."""
    rows, columns = np.indices(geometry.shape).reshape(2, -1).astype(float)
    targets = geometry.pixel_centres_cm(rows, columns)
    if geometry.beam == "parallel":
        along = np.broadcast_to(geometry.direction, targets.shape)
        starts = targets - 200 * along / np.linalg.norm(geometry.direction)
    else:
        along, starts = (
            targets - geometry.source_cm,
            np.broadcast_to(geometry.source_cm, targets.shape),
        )
    return starts, along / np.linalg.norm(along, axis=1, keepdims=True)


def span_in_convex(mesh, geometry):
    """Where each ray enters and leaves, clipped by the half-space of each face."""
    starts, along = rays(geometry)
    enter, leave = np.full(len(starts), -np.inf), np.full(len(starts), np.inf)
    for a, b, c in mesh.triangles:
        normal = np.cross(b - a, c - a)
        height, slope = (a - starts) @ normal, along @ normal
        with np.errstate(divide="ignore"):
            meet = height / slope
        enter = np.where(slope < 0, np.maximum(enter, meet), enter)
        leave = np.where(slope > 0, np.minimum(leave, meet), leave)
    return enter, np.maximum(enter, leave)


def length_in_convex(mesh, geometry):
    enter, leave = span_in_convex(mesh, geometry)
    return (leave - enter).reshape(geometry.shape)


def crossing(triangle, starts, along):
    """Which rays cross a triangle, and how far away; positive on leaving (Moeller, Trumbore)."""
    a, b, c = triangle
    across = np.cross(along, c - a)
    volume = across @ (b - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = ((starts - a) * across).sum(axis=1) / volume
        q = np.cross(starts - a, b - a)
        v = (along * q).sum(axis=1) / volume
        hit = (u >= 0) & (v >= 0) & (u + v <= 1)
        return hit, -np.sign(volume) * (q @ (c - a)) / volume


def length_by_triangle_sums(mesh, geometry):
    """Sum of signed distances over all triangles hit."""
    total = np.zeros(geometry.shape).ravel()
    for triangle in mesh.triangles:
        hit, distance = crossing(triangle, *rays(geometry))
        total[hit] += distance[hit]
    return total.reshape(geometry.shape)


def owned_lengths(meshes, order, geometry):
    """Cut each ray at all surfaces of convex parts; ask for each piece's middle who is there."""
    spans = [span_in_convex(mesh, geometry) for mesh in meshes]
    cuts = np.sort(np.concatenate([np.stack(span) for span in spans]), axis=0)
    owned, shared = np.zeros((len(meshes), cuts.shape[1])), np.zeros(cuts.shape[1])
    for start, stop in pairwise(cuts):
        middle = (start + stop) / 2
        there = [(enter < middle) & (middle < leave) for enter, leave in spans]
        shared += np.where(np.sum(there, axis=0) > 1, stop - start, 0)
        free = np.ones(len(middle), dtype=bool)
        for part in order:
            owned[part] += np.where(free & there[part], stop - start, 0)
            free &= ~there[part]
    return owned.reshape(-1, *geometry.shape), shared.reshape(geometry.shape)


def frame(lengths: PathLengths, part=0):
    """Lengths of one part as an image: mean over the rays."""
    image = np.zeros(lengths.shape)
    image.flat[lengths.pixels] = lengths.lengths_cm[:, :, part].astype(float).mean(axis=1)
    return image


SOLIDS = {
    "box": trimesh.creation.box((3.0, 2.0, 5.0)),
    "thin plate": trimesh.creation.box((6.0, 0.01, 6.0)),
    "polygonal cylinder": trimesh.creation.cylinder(1.7, 4.0, sections=24),
    "cone": trimesh.creation.cone(2.0, 4.0, sections=20),
    "faceted sphere": trimesh.creation.icosphere(2, 2.5),
}


@pytest.mark.parametrize("name", SOLIDS)
@settings(max_examples=12, deadline=None)
@given(seed=seeds, beam=beams, flip_rows=st.booleans(), mirror=st.booleans(), tilted=st.booleans())
def test_convex_solids_are_exact_in_any_pose_and_geometry(
    name, seed, beam, flip_rows, mirror, tilted
):
    geometry = view(beam, tilt=0.3 * tilted, seed=seed, flip_rows=flip_rows, mirror=mirror)
    mesh = turned(SOLIDS[name], seed)
    lengths = path_lengths([mesh], [0], geometry)
    assert not lengths.broken.any()
    np.testing.assert_allclose(frame(lengths), length_in_convex(mesh, geometry), atol=2e-6)


@pytest.mark.parametrize("beam", ["cone", "parallel"])
def test_bodies_with_holes_agree_with_triangle_sums(beam):
    geometry = view(beam, tilt=0.2, seed=4)
    for mesh in (
        trimesh.creation.torus(2.5, 0.8, major_sections=24, minor_sections=12),
        trimesh.creation.annulus(1.5, 2.5, 3.0, sections=20),
    ):
        posed = turned(mesh, seed=7)
        np.testing.assert_allclose(
            frame(path_lengths([posed], [0], geometry)),
            length_by_triangle_sums(posed, geometry),
            atol=2e-6,
        )


def test_every_subray_is_the_ray_of_the_refined_detector():
    geometry, mesh = view(tilt=0.2), turned(SOLIDS["box"], seed=3)
    lengths = path_lengths([mesh], [0], geometry, subrays=3)
    wanted = length_in_convex(mesh, geometry.refined(3))
    by_pixel = wanted.reshape(SIZE, 3, SIZE, 3).swapaxes(1, 2).reshape(SIZE * SIZE, 9)
    assert lengths.lengths_cm.shape[1:] == (9, 1)
    np.testing.assert_allclose(lengths.lengths_cm[:, :, 0], by_pixel[lengths.pixels], atol=2e-6)
    np.testing.assert_array_equal(lengths.pixels, np.flatnonzero(by_pixel.any(axis=1)))


@settings(max_examples=10)
@given(seed=seeds, beam=beams, order=st.permutations(range(4)))
def test_nested_and_crossing_parts_belong_to_the_strongest(seed, beam, order):
    geometry = view(beam, size=24)
    scales = {"box": 1.0, "polygonal cylinder": 1.0, "cone": 0.4, "faceted sphere": 0.3}
    shapes = [SOLIDS[name].copy().apply_scale(scale) for name, scale in scales.items()]
    meshes = [turned(shape, seed + part) for part, shape in enumerate(shapes)]
    lengths = path_lengths(meshes, order, geometry)
    owned, shared = owned_lengths(meshes, order, geometry)
    for part in range(4):
        np.testing.assert_allclose(frame(lengths, part), owned[part], atol=4e-6)
    np.testing.assert_allclose(lengths.shared_cm, shared.flat[lengths.pixels], atol=4e-6)
    assert not lengths.broken.any()


def test_overlapping_shells_of_one_part_count_once():
    shells = [turned(SOLIDS["box"], seed) for seed in (1, 2)]
    geometry = view()
    both = path_lengths([trimesh.util.concatenate(shells)], [0], geometry)
    apart = path_lengths(shells, [0, 1], geometry)
    np.testing.assert_allclose(frame(both), frame(apart, 0) + frame(apart, 1), atol=2e-6)
    assert not both.shared_cm.any()


@settings(max_examples=10, deadline=None)
@given(seed=seeds, beam=beams)
def test_moving_scanner_and_object_together_changes_nothing(seed, beam):
    geometry, mesh = view(beam), turned(SOLIDS["faceted sphere"], seed)
    offset = np.random.default_rng(seed).uniform(-50, 50, 3)
    moved = mesh.copy().apply_translation(offset)
    there = path_lengths([moved], [0], geometry.moved(offset))
    np.testing.assert_allclose(frame(there), frame(path_lengths([mesh], [0], geometry)), atol=2e-6)


def test_a_cone_tends_to_a_parallel_beam_as_its_source_recedes():
    mesh, flat = turned(SOLIDS["faceted sphere"], seed=5), view("parallel")
    wanted = frame(path_lengths([mesh], [0], flat))
    errors = []
    for distance in (1e3, 1e4, 1e5):
        source = flat.pixel_centres_cm(*np.array([[SIZE / 2.0], [SIZE / 2.0]]))[0]
        far = ViewGeometry(
            beam="cone",
            pixel00_cm=flat.pixel00_cm,
            column_step_cm=flat.column_step_cm,
            row_step_cm=flat.row_step_cm,
            shape=flat.shape,
            source_cm=source - distance * flat.matrix[:, 2],
        )
        errors.append(np.abs(frame(path_lengths([mesh], [0], far)) - wanted).mean())
    assert errors[0] > 5 * errors[1] > 25 * errors[2]
    assert errors[2] < 1e-3


@pytest.mark.parametrize("beam", ["cone", "parallel"])
def test_rays_along_edges_and_through_vertices_leave_closed_meshes_closed(beam):
    # faces of the box lie in planes of rays, and pixel centres on its corners
    box = trimesh.creation.box((4.0, 2.0, 6.0))
    emitter = (
        {"source_cm": np.array([2.0, -50.0, 3.0])}
        if beam == "cone"
        else {"direction": np.array([0.0, 1.0, 0.0])}
    )
    geometry = ViewGeometry(
        beam=beam,
        pixel00_cm=np.array([-8.0, 1.0, 8.0]),
        column_step_cm=np.array([1.0, 0.0, 0.0]),
        row_step_cm=np.array([0.0, 0.0, -1.0]),
        shape=(17, 17),
        **emitter,
    )
    lengths = path_lengths([box], [0], geometry)
    assert not lengths.broken.any()
    assert lengths.lengths_cm.min() >= 0
    if beam == "parallel":  # each ray on the rim belongs to one side: 4 x 6 squares of 1 cm
        assert len(lengths.pixels) == 24
        np.testing.assert_allclose(lengths.lengths_cm, 2.0, atol=1e-12)


def test_unmerged_vertices_open_no_seam():
    mesh = turned(SOLIDS["faceted sphere"], seed=9)
    soup = trimesh.Trimesh(**trimesh.triangles.to_kwargs(mesh.triangles), process=False)
    whole, torn = (path_lengths([each], [0], view(), subrays=2) for each in (mesh, soup))
    np.testing.assert_array_equal(torn.lengths_cm, whole.lengths_cm)
    assert not torn.broken.any()


def test_a_dropped_face_is_flagged_just_where_it_is_missing():
    mesh, geometry = turned(SOLIDS["faceted sphere"], seed=2), view(size=128)
    open_mesh = trimesh.Trimesh(mesh.vertices, np.delete(mesh.faces, 17, axis=0), process=False)
    lengths = path_lengths([open_mesh], [0], geometry)
    shadow = crossing(mesh.triangles[17], *rays(geometry))[0].reshape(geometry.shape)
    flagged = np.zeros(geometry.shape, dtype=bool)
    flagged.flat[lengths.pixels[lengths.broken]] = True
    assert flagged.sum() > 3
    np.testing.assert_array_equal(flagged, shadow)
    np.testing.assert_allclose(
        frame(lengths)[~flagged], length_in_convex(mesh, geometry)[~flagged], atol=2e-6
    )


def test_subrays_average_intensity_towards_the_share_of_the_pixel_covered():
    plate = trimesh.creation.box((0.6, 2.0, 1.0))  # covers .43 by .39 of the only pixel
    pixel = ViewGeometry(
        beam="parallel",
        pixel00_cm=np.array([0.37, 5.0, 0.61]),
        column_step_cm=np.array([1.0, 0.0, 0.0]),
        row_step_cm=np.array([0.0, 0.0, -1.0]),
        shape=(1, 1),
        direction=np.array([0.0, 1.0, 0.0]),
    )
    wanted = 1 - 0.43 * 0.39 * (1 - np.exp(-3.0 * 2.0))
    for subrays in (2, 3, 10, 100):
        lengths = path_lengths([plate], [0], pixel, subrays)
        error = abs(float(lengths.transmission(np.array([3.0]))[0]) - wanted)
        assert error < 1 / subrays
    averaged_lengths = np.exp(-3.0 * float(lengths.lengths_cm.mean()))
    assert abs(averaged_lengths - wanted) > 0.4


def test_transmission_multiplies_parts_and_the_image_shows_gain_in_air():
    meshes = [turned(SOLIDS["box"], 1), turned(SOLIDS["cone"], 2)]
    lac, lengths = np.array([0.2, 0.7]), path_lengths(meshes, [1, 0], view())
    wanted = 1.1 * np.exp(-(0.2 * frame(lengths, 0) + 0.7 * frame(lengths, 1)))
    image = lengths.image(lac, gain=1.1)
    assert image.dtype == np.float32
    np.testing.assert_allclose(image, wanted, rtol=1e-6)
    np.testing.assert_allclose(lengths.transmission(lac, 1.1), wanted.flat[lengths.pixels])


def test_cutting_the_work_into_bands_changes_nothing(monkeypatch):
    meshes = [turned(SOLIDS["box"], 1), turned(SOLIDS["cone"], 2)]
    whole = path_lengths(meshes, [1, 0], view(), subrays=2)
    monkeypatch.setattr(lengths_module, "CROSSINGS_AT_ONCE", 500)
    cut = path_lengths(meshes, [1, 0], view(), subrays=2)
    for name in ("pixels", "lengths_cm", "shared_cm", "broken"):
        np.testing.assert_array_equal(getattr(cut, name), getattr(whole, name))


def test_what_leaves_the_detector_is_cut_off_there():
    mesh, geometry = SOLIDS["box"].copy().apply_translation([7.0, 0, -7.0]), view()
    lengths = path_lengths([mesh], [0], geometry, subrays=2)
    rows, columns = np.divmod(lengths.pixels, SIZE)
    assert rows.max() == columns.max() == SIZE - 1
    np.testing.assert_allclose(
        frame(path_lengths([mesh], [0], geometry)), length_in_convex(mesh, geometry), atol=2e-6
    )


@pytest.mark.parametrize("offset", [[50.0, 0, 0], [-50.0, 0, 0], [0, 0, 50.0], [0, 0, -50.0]])
def test_nothing_in_view_gives_no_pixels(offset):
    away = SOLIDS["box"].copy().apply_translation(offset)
    for meshes in ([], [trimesh.Trimesh()], [away]):
        lengths = path_lengths(meshes, range(len(meshes)), view(), subrays=3)
        assert lengths.lengths_cm.shape == (0, 9, len(meshes))
        assert (lengths.image(np.ones(len(meshes))) == 1).all()


def test_an_empty_mesh_among_others_is_met_by_no_ray():
    meshes = [trimesh.Trimesh(), turned(SOLIDS["box"], 1)]
    lengths = path_lengths(meshes, [0, 1], view())
    assert not lengths.lengths_cm[:, :, 0].any()
    np.testing.assert_allclose(frame(lengths, 1), length_in_convex(meshes[1], view()), atol=2e-6)


def test_bad_input_is_refused_with_its_part_and_place():
    box = SOLIDS["box"]
    behind = box.copy().apply_translation([0.0, -100.0, 0.0])
    with pytest.raises(DataError, match=r"part 1: \d+ of 12 triangles .* source at \[0.3, -100.0"):
        path_lengths([box, behind], [0, 1], view())
    with pytest.raises(DataError, match=r"each of 0 to 1 once, got \[0, 0\]"):
        path_lengths([box, box], [0, 0], view())
    with pytest.raises(DataError, match=r"subrays must be at least 1, got 0"):
        path_lengths([box], [0], view(), subrays=0)
    with pytest.raises(DataError, match=r"1 parts need as many coefficients, got 2"):
        path_lengths([box], [0], view()).transmission(np.ones(2))
    far = np.where(box.vertices > 2, np.inf, box.vertices)
    lost = trimesh.Trimesh(far, box.faces, process=False)
    with pytest.raises(DataError, match=r"part 0: a vertex is not finite"):
        path_lengths([lost], [0], view("parallel"))


def test_without_numba_the_pip_command_is_given(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    with pytest.raises(MissingExtraError, match=r"pip install .*\[build\]'"):
        importlib.reload(kernels)


@pytest.mark.parametrize("shape", [(16, 40), (40, 16)])
def test_rows_and_columns_of_an_oblong_detector_are_not_confused(shape):
    geometry = dataclasses.replace(view(), shape=shape)
    mesh = turned(trimesh.creation.icosphere(2, 5.0), seed=6)  # beyond the shorter side
    lengths = path_lengths([mesh], [0], geometry, subrays=2)
    wanted = length_in_convex(mesh, geometry.refined(2))
    by_pixel = wanted.reshape(shape[0], 2, shape[1], 2).swapaxes(1, 2).reshape(-1, 4)
    np.testing.assert_array_equal(lengths.pixels, np.flatnonzero(by_pixel.any(axis=1)))
    np.testing.assert_allclose(lengths.lengths_cm[:, :, 0], by_pixel[lengths.pixels], atol=2e-6)


@settings(max_examples=40, deadline=None)
@given(
    rows=st.tuples(st.integers(-30, 60), st.integers(1, 50)),
    columns=st.tuples(st.integers(-30, 60), st.integers(1, 50)),
    subrays=st.integers(1, 4),
)
def test_a_window_grows_to_no_more_than_the_pixels_it_touches(rows, columns, subrays):
    shape = (7, 11)
    window = (rows[0], sum(rows), columns[0], sum(columns))
    grown = Lattice.of(subrays, turned=False).window(window, shape)
    for axis, size in enumerate(shape):
        touched = set(range(*window[2 * axis : 2 * axis + 2]))
        pixels = [
            pixel
            for pixel in range(size)
            if touched & set(range(pixel * subrays, (pixel + 1) * subrays))
        ]
        first, end = grown[2 * axis : 2 * axis + 2]
        assert [ray // subrays for ray in range(first, end, subrays)] == pixels
        assert end - first == len(pixels) * subrays


@settings(max_examples=40, deadline=None)
@given(seed=seeds, subrays=st.integers(1, 3), limit=st.integers(1, 400))
def test_bands_tile_the_window_and_hold_about_as_many_crossings_as_allowed(seed, subrays, limit):
    counts = np.random.default_rng(seed).integers(0, 9, (subrays * 12, 5), dtype=np.int32)
    window = (6, 6 + len(counts), 20, 25)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lengths_module, "CROSSINGS_AT_ONCE", limit)
        lattice = Lattice.of(subrays, turned=False)
        bands = [band for band, _ in lengths_module._bands(counts, window, lattice, NONE, 5)]
    assert [band[2:] for band in bands] == [(20, 25)] * len(bands)
    assert [bands[0][0], *(band[1] for band in bands)] == [*(band[0] for band in bands), window[1]]
    assert all((band[1] - band[0]) % subrays == 0 < band[1] - band[0] for band in bands)
    held = [int(counts[band[0] - 6 : band[1] - 6].sum()) for band in bands]
    largest_row = counts.reshape(12, -1).sum(axis=1).max()
    assert max(held) < limit + largest_row
    assert len(bands) <= counts.sum() // limit + 1


def test_a_band_takes_the_memory_that_the_module_says():
    assert f"{10 * lengths_module.CROSSINGS_AT_ONCE / 1e6:.0f} MB" in lengths_module.__doc__


def test_too_few_coefficients_are_counted_by_part_not_by_ray():
    meshes = [turned(SOLIDS["box"], seed) for seed in (1, 2)]
    lengths = path_lengths(meshes, [0, 1], view(size=8), subrays=3)
    with pytest.raises(DataError, match=r"^2 parts need as many coefficients, got 1$"):
        lengths.transmission(np.ones(1))


def test_coefficients_of_single_precision_are_summed_in_double():
    lengths = path_lengths([turned(SOLIDS["box"], 1)], [0], view())
    lac = np.array([0.3], dtype=np.float32)
    np.testing.assert_array_equal(
        lengths.transmission(lac), lengths.transmission(lac.astype(np.float64))
    )


def test_path_lengths_are_a_frozen_value_that_equals_only_itself():
    one, other = (path_lengths([SOLIDS["box"]], [0], view(size=8)) for _ in range(2))
    assert one != other  # arrays have no one truth to compare by
    assert not hasattr(one, "__dict__")
    with pytest.raises(dataclasses.FrozenInstanceError):
        one.shape = (1, 1)


def test_hundreds_of_crossings_of_one_ray_are_walked_in_their_order():
    plates = [
        trimesh.creation.box((2, 0.01, 2)).apply_translation((0, y, 0)) for y in range(-60, 60)
    ]
    shuffled = np.random.default_rng(1).permutation(len(plates))
    comb = trimesh.util.concatenate([plates[number] for number in shuffled])
    straight = dataclasses.replace(view("parallel"), direction=np.array([0.0, 1.0, 0.0]))
    found = path_lengths([comb], [0], straight)
    assert not found.broken.any()
    np.testing.assert_allclose(found.lengths_cm, 1.2, rtol=1e-5)


@pytest.mark.parametrize("subrays", [1, 2, 3, 4, 5, 8])
def test_each_ray_of_a_turned_lattice_is_one_pixels_and_they_lie_evenly_about_its_centre(subrays):
    lattice, view_of = Lattice.of(subrays, turned=True), view("parallel")
    along, across = lattice.along, lattice.across
    fine = lattice.seen(view_of)
    for row, column in ((0, 0), (3, 7), (11, 2)):
        mine = np.add(
            lattice.places, (along * row - across * column, along * column + across * row)
        )
        assert {lattice.pixel(*each) for each in mine.tolist()} == {(row, column)}
        at_cm = fine.pixel_centres_cm(*mine.T.astype(float))
        centre_cm = view_of.pixel_centres_cm(np.array([float(row)]), np.array([float(column)]))
        np.testing.assert_allclose(at_cm.mean(axis=0), centre_cm[0], atol=1e-12)
    assert len({tuple(each) for each in lattice.places.tolist()}) == lattice.rays


@settings(max_examples=20, deadline=None)
@given(seed=seeds, beam=beams, subrays=st.integers(1, 4))
def test_lengths_along_a_turned_lattice_are_those_of_its_rays(seed, beam, subrays):
    mesh, panel = turned(trimesh.creation.icosphere(1, 4.0), seed), view(beam, size=12, tilt=0.2)
    lengths = path_lengths([mesh], [0], panel, subrays, turned=True)
    lattice = Lattice.of(subrays, turned=True)
    fine, (rows, columns) = lattice.seen(panel), np.divmod(lengths.pixels, 12)
    for number in range(lattice.rays):
        below, beside = lattice.places[number]
        row = lattice.along * rows - lattice.across * columns + below
        column = lattice.along * columns + lattice.across * rows + beside
        for pixel in range(0, len(rows), 17):
            corner = fine.pixel_centres_cm(
                np.array([float(row[pixel])]), np.array([float(column[pixel])])
            )[0]
            alone = dataclasses.replace(panel, pixel00_cm=corner, shape=(1, 1))
            (wanted,) = length_in_convex(mesh, alone).ravel()
            assert lengths.lengths_cm[pixel, number, 0] == pytest.approx(wanted, abs=2e-5)


@settings(max_examples=40, deadline=None)
@given(edge=st.floats(-0.45, 0.45), upright=st.booleans())
def test_an_edge_along_the_raster_is_seen_as_finely_as_a_turned_lattice_has_rays(edge, upright):
    panel = dataclasses.replace(
        view("parallel", size=9), direction=np.array([0.0, 1.0, 0.0]), pixel00_cm=np.zeros(3)
    )
    pitch = np.linalg.norm(panel.column_step_cm)
    reach = (4 + edge) * pitch  # into pixel 4 from its middle, along columns or rows
    half = trimesh.creation.box((400.0, 2.0, 400.0))
    half.apply_translation([reach - 200.0, 0, 0] if upright else [0, 0, 200.0 - reach])
    shares = {}
    for is_turned in (False, True):
        lengths = path_lengths([half], [0], panel, 4, turned=is_turned)
        covered = np.zeros(81)
        covered[lengths.pixels] = lengths.lengths_cm[:, :, 0].mean(axis=1) / 2
        image = covered.reshape(9, 9)
        shares[is_turned] = image[:, 4] if upright else image[4]
    np.testing.assert_allclose(shares[True], edge + 0.5, atol=0.51 / 17)
    assert np.ptp(shares[False]) == 0


def test_a_turned_lattice_is_cut_off_where_the_detector_ends():
    mesh = trimesh.creation.icosphere(2, 14.0)
    lengths = path_lengths([mesh], [0], view(size=16), 3, turned=True)
    assert lengths.pixels.tolist() == list(range(256))
    assert (lengths.lengths_cm.min(axis=1) > 0).all()
