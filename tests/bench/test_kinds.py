"""Which parts count as hidden, shown in an X-ray, opaque or thin, on boxes of known truth."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from tests.bench.test_segment_cli import meta_of
from tests.phantoms import Box, box_object, published_object
from xden1k.errors import DataError
from xden1k.folder import open_folder, write_folder
from xden1k.segmentation import CLUSTER_COUNTS, Segmentation, SegmentsWriter
from xden_bench.cli import cli
from xden_bench.scoring.kinds import Seen, part_ious, segment_kinds, visible_parts
from xden_bench.scoring.protocol import load_segment_protocol
from xden_bench.scoring.regions import SegmentReference

RULES = load_segment_protocol()
CORE = Box("core", (-1, -1, -1), (1, 1, 1), 0.9)
CASE = Box("case", (-2, -2, -2), (2, 2, 2), 1.5, hole=((-1, -1, -1), (1, 1, 1)))
LEAD_CASE = Box("case", (-2, -2, -2), (2, 2, 2), 11.3, hole=((-1, -1, -1), (1, 1, 1)))
BLOCK = Box("block", (-2, -2, -2), (2, 2, 2), 1.5)
FOAM = Box("foam", (-2, -2, 2), (2, 2, 2.5), 0.005)
CUP = Box("cup", (-2, -2, -2), (2, 2, 2), 1.5, hole=((-1, -1, -1), (1, 1, 1)))


@pytest.fixture(scope="module")
def reference(tmp_path_factory: pytest.TempPathFactory) -> SegmentReference:
    """One filled case, one empty."""
    return reference_of(tmp_path_factory.mktemp("kinds"), {"case": (CASE, CORE), "cup": (CUP,)})


def reference_of(folder: Path, objects: Mapping[str, Sequence[Box]]) -> SegmentReference:
    """One object of each category."""
    root = folder / "dataset"
    made = [
        box_object(f"{category}-0001", boxes, split="test", category=category)
        for category, boxes in objects.items()
    ]
    write_folder(made, root, version="0.1.0", builder="tests")
    return SegmentReference(open_folder(root), "test", RULES)


def shell(wall_cm: float) -> Box:
    """Hollow cube of 4 cm."""
    inner = 2 - wall_cm
    return Box("shell", (-2,) * 3, (2,) * 3, 1.5, hole=((-inner,) * 3, (inner,) * 3))


def written(path: Path, reference: SegmentReference, mistaken: bool) -> Path:
    """The truth, or all of it as one cluster."""
    with SegmentsWriter(path) as writer:
        for object_id in reference.ids:
            drawn = reference.drawn(object_id)
            parts = drawn.regions(RULES.region_gap_g_cm3).parts * np.uint8(not mistaken)
            labels = np.broadcast_to(parts, (len(CLUSTER_COUNTS), len(parts)))
            writer.add(object_id, drawn.points.voxels, labels, parts)
        writer.finish(meta_of(reference, writer.points_sha256))
    return path


def test_the_truth_is_found_whole_in_every_kind(reference: SegmentReference, tmp_path: Path):
    found = segment_kinds(written(tmp_path / "truth.npz", reference, mistaken=False), reference)
    assert {kind: (one.count, one.iou) for kind, one in found.items()} == {
        "objects of 2 regions": (2, 100),
        "transparent objects": (2, 100),
        "visible parts": (2, 100),
        "visible parts, in an X-ray": (2, 100),
        "hidden parts, in an X-ray": (1, 100),
        "thick parts": (3, 100),
        "enclosed voids": (1, 100),
    }


def test_of_one_cluster_a_part_has_its_share_of_the_volume(
    reference: SegmentReference, tmp_path: Path
):
    found = segment_kinds(written(tmp_path / "one.npz", reference, mistaken=True), reference)
    core = 100 * (2 / 4) ** 3
    assert found["hidden parts, in an X-ray"].iou == pytest.approx(core, abs=1.5)
    assert found["enclosed voids"].iou == pytest.approx(core, abs=1.5)
    assert found["visible parts"].iou == pytest.approx(100 - core, abs=1.5)


def test_a_visible_part_too_light_for_x_rays_counts_apart_from_those_in_one(tmp_path: Path):
    block_and_foam = reference_of(tmp_path, {"block": (BLOCK, FOAM)})
    one = written(tmp_path / "one.npz", block_and_foam, mistaken=True)
    found = segment_kinds(one, block_and_foam)
    foam = 100 * 0.5 / 4.5
    assert found["visible parts, in an X-ray"].iou == pytest.approx(100 - foam, abs=1.5)
    assert found["visible parts, in no X-ray"].iou == pytest.approx(foam, abs=1.5)
    assert (found["visible parts"].count, found["visible parts"].iou) == (2, pytest.approx(50))


def test_a_shell_is_thin_by_its_wall_however_large_it_is_and_from_2_mm_on_thick(tmp_path: Path):
    walls_cm = {"thick": 0.21, "thin": 0.19}
    shells = reference_of(tmp_path, {name: (shell(wall),) for name, wall in walls_cm.items()})
    found = segment_kinds(written(tmp_path / "one.npz", shells, mistaken=True), shells)
    for name, wall_cm in walls_cm.items():
        of_wall = 100 * (1 - (1 - wall_cm / 2) ** 3)
        assert found[f"{name} parts"].count == 1
        assert found[f"{name} parts"].iou == pytest.approx(of_wall, abs=1)


def test_a_part_behind_lead_is_in_no_x_ray_and_its_object_is_opaque():
    behind_lead = Seen(box_object("a", (LEAD_CASE, CORE)))
    assert behind_lead.opaque
    assert not behind_lead.shown(2)
    in_plastic = Seen(box_object("b", (CASE, CORE)))
    assert not in_plastic.opaque
    assert in_plastic.shown(2)


def test_a_hundredth_of_the_beam_is_what_shows_a_part():
    """Of a cube of 4 cm, whose rays are hardly longer, by its density."""
    per_density = box_object("a", (replace(CORE, density_g_cm3=1.0),)).parts[0].lac_per_cm
    for change in (0.008, 0.012):
        density = -np.log(1 - change) / (4 * per_density)
        cube = Box("cube", (-2, -2, -2), (2, 2, 2), density)
        assert Seen(box_object("a", (cube,))).shown(1) == (change > 0.01)


def test_a_part_that_reaches_the_surface_by_one_voxel_is_visible():
    owners = np.zeros((8, 8, 8), np.uint8)
    owners[1:7, 1:7, 1:7] = 1
    owners[3:5, 3:5, 3:5] = 2
    assert visible_parts(owners) == {1}
    owners[3, 3, 1] = 2
    assert visible_parts(owners) == {1, 2}


def test_a_part_at_the_edge_of_the_grid_is_visible():
    assert visible_parts(np.full((4, 4, 4), 3, np.uint8)) == {3}


def test_each_part_has_the_cluster_that_fits_it_best_of_one_number_of_clusters():
    parts = np.array([0, 0, 1, 1, 2, 2], np.uint8)
    labels = np.zeros((len(CLUSTER_COUNTS), 6), np.uint8)
    labels[1] = [0, 0, 1, 1, 1, 1]  # k = 3 fits best: 1 + 1/2 + 1/2
    assert part_ious(parts, Segmentation(labels, labels[0])) == {0: 100, 1: 50, 2: 50}


def test_what_can_be_seen_of_an_object_without_radiographs_is_refused():
    with pytest.raises(DataError, match="a must have radiographs"):
        Seen(published_object("a", (CASE, CORE)))


def test_the_command_prints_a_column_for_each_submission(
    reference: SegmentReference, tmp_path: Path
):
    files = [
        str(written(tmp_path / f"{name}.npz", reference, mistaken=name == "one"))
        for name in ("truth", "one")
    ]
    words = ["segment", "kinds", *files, "--root", str(reference.folder.root)]
    done = CliRunner().invoke(cli, words)
    assert done.exit_code == 0, done.stderr
    of_core, *_ = [line for line in done.stdout.splitlines() if line.startswith("hidden parts")]
    assert of_core.split()[-3:-1] == ["1", "100.0"]
    assert "truth" in done.stdout.splitlines()[0]
    values = json.loads(CliRunner().invoke(cli, [*words, "--json"]).stdout)
    assert values[files[0]]["enclosed voids"] == {"count": 1, "iou": 100.0}
