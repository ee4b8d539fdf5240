"""Who owns what, cuts that agree with it, and the outer surface."""

from itertools import combinations

import numpy as np
import pytest
import trimesh
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from xden1k.errors import DataError
from xden1k.rays import disjoint_regions, outer_surface, ownership_order, path_lengths
from xden1k.rays.regions import NEGLIGIBLE
from xden1k.values.mass import mass_of_meshes
from xden1k.values.views import ViewGeometry

seeds = st.integers(0, 2**32 - 1)
VIEW = ViewGeometry(
    beam="cone",
    pixel00_cm=np.array([-6.0, 30.0, 6.0]),
    column_step_cm=np.array([0.2, 0.0, 0.01]),
    row_step_cm=np.array([0.0, 0.0, -0.2]),
    shape=(60, 60),
    source_cm=np.array([0.3, -100.0, 0.7]),
)


def posed(meshes, seed):
    """Turn and shift several meshes as one body: faces that met still meet, up to rounding."""
    rng = np.random.default_rng(seed)
    pose = trimesh.transformations.random_rotation_matrix(rng.random(3))
    pose[:3, 3] = rng.uniform(-1, 1, 3)
    return [mesh.copy().apply_transform(pose) for mesh in meshes]


def scattered(seed, count=3):
    """Return boxes, cylinders and balls which overlap more often than not."""
    rng = np.random.default_rng(seed)
    shapes = [
        trimesh.creation.box((2.0, 1.5, 3.0)),
        trimesh.creation.cylinder(0.6, 4.0, sections=12),
        trimesh.creation.icosphere(1, 1.2),
    ]
    return [posed([shape], rng.integers(2**32))[0] for shape in shapes[:count]]


def overlaps(meshes):
    """Return the share of the smaller one's volume that each pair has in common."""
    for pair in combinations(meshes, 2):
        common = trimesh.boolean.intersection(pair, engine="manifold")
        volume = common.volume if len(common.faces) else 0.0
        yield volume / min(mesh.volume for mesh in pair)


def assume_no_slight_overlap(meshes):
    """Leave out bodies of which a sliver overlaps that counts as none."""
    assume(not any(0 < share < 2 * NEGLIGIBLE for share in overlaps(meshes)))


def difference(outer, inner):
    return trimesh.boolean.difference([outer, inner], engine="manifold")


def cup():
    """Return a cup with an outer volume of a 48-sided prism of radius 2 and height 5."""
    hollow = trimesh.creation.cylinder(1.8, 5, sections=48).apply_translation([0, 0, 0.3])
    return difference(trimesh.creation.cylinder(2, 5, sections=48), hollow)


def lid(sections=36):
    return trimesh.creation.cylinder(2, 0.4, sections=sections).apply_translation([0, 0, 2.7])


def plates(edge=4.0, thick=0.2):
    """Return six plates, butted, that enclose a cube."""
    long, short, shift = edge, edge - 2 * thick, edge / 2 - thick / 2
    sizes = [(short, short, thick), (short, thick, long), (thick, long, long)]
    return [
        trimesh.creation.box(np.array(size)).apply_translation(side * shift * np.eye(3)[2 - axis])
        for axis, size in enumerate(sizes)
        for side in (-1, 1)
    ]


def test_the_smaller_part_owns_unless_a_priority_says_otherwise():
    big, middle, small = (trimesh.creation.box((edge,) * 3) for edge in (3, 2, 1))
    meshes = [big, middle, small]
    assert ownership_order(meshes) == [2, 1, 0]
    assert ownership_order(meshes, [None, None, None]) == [2, 1, 0]
    assert ownership_order(meshes, [5, None, None]) == [0, 2, 1]
    assert ownership_order(meshes, [None, None, -1]) == [1, 0, 2]
    assert ownership_order(meshes, [0, None, None]) == [2, 1, 0]
    assert ownership_order(meshes, [1, 3, 2]) == [1, 2, 0]
    assert ownership_order([big, big.copy()]) == [0, 1]
    assert ownership_order([big, trimesh.Trimesh()]) == [1, 0]


def test_ownership_refuses_what_has_no_volume_to_compare():
    box = trimesh.creation.box()
    inside_out = trimesh.Trimesh(box.vertices, box.faces[:, ::-1])
    with pytest.raises(DataError, match=r"part 1 is wound inwards: its volume is -1 cm³"):
        ownership_order([box, inside_out])
    with pytest.raises(DataError, match=r"1 meshes need as many priorities, got 2"):
        ownership_order([box], [1, 2])


@settings(max_examples=15, deadline=None)
@given(seed=seeds, order=st.permutations(range(3)))
def test_cut_parts_have_the_path_lengths_that_overlapping_ones_own(seed, order):
    meshes = scattered(seed)
    assume_no_slight_overlap(meshes)
    regions = disjoint_regions(meshes, order)
    owned = path_lengths(meshes, order, VIEW)
    cut = path_lengths(regions, order[::-1], VIEW)
    np.testing.assert_array_equal(cut.pixels, owned.pixels)
    np.testing.assert_allclose(cut.lengths_cm, owned.lengths_cm, atol=1e-5)
    assert cut.shared_cm.max() < 1e-5
    union = path_lengths([outer_surface(meshes)], [0], VIEW)
    filled = np.zeros(VIEW.shape)
    filled.flat[union.pixels] = union.lengths_cm[:, 0, 0]
    total = cut.lengths_cm.astype(float).sum(axis=(1, 2))
    # the outer surface also fills what three bodies may enclose, and lies a little further out
    assert (filled.flat[cut.pixels] >= total - 1e-5).all()
    assert abs(filled.flat[cut.pixels] - total).mean() < 1e-3


@settings(max_examples=15, deadline=None)
@given(seed=seeds)
def test_volumes_of_cut_parts_sum_to_the_union(seed):
    meshes = scattered(seed)
    assume_no_slight_overlap(meshes)
    regions = disjoint_regions(meshes, ownership_order(meshes))
    union = trimesh.boolean.union(meshes, engine="manifold")
    assert sum(region.volume for region in regions) == pytest.approx(union.volume, rel=1e-7)
    assert all(region.is_watertight for region in regions)


@settings(max_examples=8)
@given(seed=seeds)
def test_parts_that_only_touch_are_left_as_they_are(seed):
    for meshes in (
        posed(plates(), seed),
        posed([cup(), lid()], seed),
        posed([cup(), lid(48)], seed),
    ):
        regions = disjoint_regions(meshes, ownership_order(meshes))
        assert all(region is mesh for region, mesh in zip(regions, meshes, strict=True))


@settings(max_examples=25, deadline=None)
@given(seed=seeds)
def test_a_plug_and_its_socket_stored_in_single_precision_are_not_cut(seed):
    rod = trimesh.creation.cylinder(0.3, 4.0, sections=64)
    socket = difference(trimesh.creation.cylinder(0.5, 4.0, sections=32), rod)
    meshes = [
        trimesh.Trimesh(mesh.vertices.astype(np.float32).astype(float), mesh.faces, process=False)
        for mesh in posed([rod, socket], seed)
    ]
    assert all(map(lambda a, b: a is b, disjoint_regions(meshes, [0, 1]), meshes))


@settings(max_examples=10, deadline=None)
@given(seed=seeds, share=st.floats(2e-4, 0.5))
def test_an_overlap_that_counts_is_cut_to_its_exact_volume(seed, share):
    lower, upper = trimesh.creation.box((1, 1, 1)), trimesh.creation.box((1, 1, 1))
    upper.apply_translation((0, 0, 1 - share))
    whole, cut = disjoint_regions(posed([lower, upper], seed), [0, 1])
    assert whole.volume == pytest.approx(1)
    assert cut.volume == pytest.approx(1 - share, abs=1e-9)


def test_parts_stored_in_single_precision_still_only_touch():
    meshes = [
        trimesh.Trimesh(mesh.vertices.astype(np.float32).astype(float), mesh.faces)
        for mesh in posed([cup(), lid()], seed=11)
    ]
    regions = disjoint_regions(meshes, [0, 1])
    assert all(region is mesh for region, mesh in zip(regions, meshes, strict=True))
    assert outer_surface(meshes).volume == pytest.approx(filled_cup_volume(), rel=1e-4)


def test_a_part_wholly_covered_leaves_an_empty_mesh():
    box = trimesh.creation.box((2, 2, 2))
    inner, same = trimesh.creation.box((1, 1, 1)), box.copy().apply_scale(1 + 1e-15)
    kept, *gone = disjoint_regions([box, inner, same], [0, 1, 2])
    assert kept is box
    assert [len(mesh.faces) for mesh in gone] == [0, 0]
    assert mass_of_meshes([kept, *gone], [1.0, 2.0, 3.0]).mass_g == pytest.approx(8)


def test_only_the_weaker_part_is_cut():
    handle, screw, apart = (
        trimesh.creation.box((2, 2, 9)),
        trimesh.creation.box((1, 1, 20)),
        trimesh.creation.box().apply_translation([9, 0, 0]),
    )
    cut = disjoint_regions([handle, screw, apart], [1, 2, 0])
    assert (cut[1] is screw, cut[2] is apart) == (True, True)
    assert cut[0].volume == pytest.approx(36 - 9)


@pytest.mark.parametrize("act", [outer_surface, lambda meshes: disjoint_regions(meshes, [0, 1])])
def test_meshes_without_an_inside_are_refused_by_index(act):
    box = trimesh.creation.box()
    lidless = trimesh.Trimesh(box.vertices, box.faces[:-1])
    with pytest.raises(DataError, match=r"part 1 is not a closed mesh \(manifold3d: NotManifold\)"):
        act([box, lidless])
    with pytest.raises(DataError, match=r"part 0 is wound inwards: its volume is -1 cm³"):
        act([trimesh.Trimesh(box.vertices, box.faces[:, ::-1]), box])


def test_an_order_that_forgets_a_part_is_refused():
    with pytest.raises(DataError, match=r"each of 0 to 1 once, got \[1\]"):
        disjoint_regions([trimesh.creation.box(), trimesh.creation.box()], [1])


def filled_cup_volume():
    return trimesh.creation.cylinder(2, 5, sections=48).volume + lid().volume


def test_the_outer_surface_of_a_hollow_ball_is_the_ball():
    ball = trimesh.creation.icosphere(3, 2.0)
    hollow = difference(ball, trimesh.creation.icosphere(3, 1.5))
    assert outer_surface([hollow]).volume == pytest.approx(ball.volume, rel=1e-7)
    rattling = [hollow, trimesh.creation.icosphere(2, 0.5)]
    assert outer_surface(rattling).volume == pytest.approx(ball.volume, rel=1e-4)


def test_the_outer_surface_of_an_open_cup_is_the_cup():
    assert outer_surface([cup()]).volume == pytest.approx(cup().volume, rel=1e-7)
    spoon = trimesh.creation.box((0.3, 0.3, 3.0))
    expected = cup().volume + spoon.volume
    assert outer_surface([cup(), spoon]).volume == pytest.approx(expected, rel=1e-4)


@settings(max_examples=8)
@given(seed=seeds)
def test_parts_that_meet_only_up_to_rounding_close_a_cavity(seed):
    for top in (lid(), lid(48)):
        covered = outer_surface(posed([cup(), top], seed))
        # the two prisms of 36 and 48 sides differ by .5 % in area, on the lid's rim alone
        assert covered.volume == pytest.approx(
            trimesh.creation.cylinder(2, 5, sections=48).volume + top.volume, rel=1e-4
        )
        assert covered.is_watertight
    assert outer_surface(posed(plates(), seed)).volume == pytest.approx(64, rel=1e-4)


def test_the_outer_surface_keeps_bodies_that_stand_apart():
    boxes = [trimesh.creation.box().apply_translation([3.0 * k, 0, 0]) for k in range(3)]
    assert outer_surface([*boxes, trimesh.Trimesh()]).volume == pytest.approx(3, rel=1e-4)
    assert len(outer_surface([trimesh.Trimesh()]).faces) == 0
