"""The other simulator: what it shares with ours, and what it gets right by itself."""

import sys

import numpy as np
import pytest
import trimesh
from builder.folders import contents
from click.testing import CliRunner

from xden1k.values.materials import load_materials
from xden_builder.capture import CaptureFolder
from xden_builder.cli import cli
from xden_builder.phantoms import CATALOGUE
from xden_builder.phantoms.peer.matter import mac_cm2_g
from xden_builder.phantoms.peer.objects import (
    PeerObject,
    PeerPart,
    draw_label,
    make_object,
    plan_bench,
)
from xden_builder.phantoms.peer.radiograph import expose, make_beam
from xden_builder.phantoms.peer.rays import path_lengths_cm
from xden_builder.phantoms.peer.scatter import single_scatter
from xden_builder.phantoms.peer.screen import Screen
from xden_builder.phantoms.peer.setup import VIEWS, BenchSettings, draw_setup
from xden_builder.phantoms.peer.substances import labels_alike, load_substances, substances_called
from xden_builder.phantoms.peer.writer import write_bench
from xden_builder.physics.spectrum.panels import panel

WATER = (("H2O", 1.0),)


@pytest.fixture
def others():
    """The other simulators, where they can be imported."""
    for name in ("xraylib", "spekpy", "gvxrPython3"):
        pytest.importorskip(name, exc_type=ImportError)


SETTINGS = BenchSettings(12, size_px=64, screen="gos", unannotated_share=1.0)


def test_every_material_of_the_catalogue_has_substances_and_every_label_is_known():
    used = {name for each in CATALOGUE for row in each.materials.values() for name in row.split()}
    assert all(substances_called(name) for name in used)
    assert {each.label for each in load_substances().values()} <= set(load_materials())


def test_a_wrong_label_is_another_one_of_the_family_where_there_is_one():
    known = load_materials()
    for label in {each.label for each in load_substances().values()}:
        others = labels_alike(label)
        assert others
        assert label not in others
    assert {known[other].family for other in labels_alike("brass")} == {"metal"}


def test_labels_err_as_often_as_said():
    rng = np.random.default_rng(0)
    labels = [draw_label(rng, "brass") for _ in range(4000)]
    assert labels.count("") / 4000 == pytest.approx(0.05, abs=0.015)
    assert 1 - labels.count("brass") / 4000 == pytest.approx(0.19, abs=0.02)


def test_densities_are_of_the_substance_and_one_part_may_be_left_out():
    (plan,) = plan_bench(1, 3)
    thing = make_object(plan, unannotated_share=1.0)
    for part in thing.parts:
        low, high = part.substance.density_low_g_cm3, part.substance.density_high_g_cm3
        assert low <= part.density_g_cm3 <= high
    assert len(thing.annotated) == max(len(thing.parts) - 1, 1)


def test_what_is_told_of_the_scanner_is_near_what_it_is():
    setup = draw_setup(12, 64, "gos")
    told = setup.told(copper=False)
    assert set(told.tube.filtration_cm) == {"Al"}
    assert told.tube.filtration_cm["Al"] <= setup.tube.aluminium_cm
    for view in VIEWS:
        off = setup.geometry(view).source_cm - told.views[view].geometry.source_cm
        assert 0 < np.linalg.norm(off) <= 0.1


@pytest.mark.parametrize(
    ("screen", "name"), [("csi", "CsI"), ("gos", "GOS"), ("counting", "CdTe-counting")]
)
def test_the_screen_is_told_by_a_name_that_the_fit_takes_for_what_it_is(screen, name):
    setup = draw_setup(12, 64, screen)
    assert setup.told(copper=True).detector.scintillator == name
    taken = panel(name)
    assert taken.composition == ((setup.screen.formula, 1.0),)
    assert taken.counting == bool(setup.screen.threshold_kev)


def test_without_the_other_simulators_there_is_one_line_and_no_folder(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "xraylib", None)
    out = tmp_path / "bench"
    answer = CliRunner().invoke(cli, ["bench-scanner", str(out), "--count", "1", "--seed", "1"])
    assert answer.exit_code == 1
    assert len(answer.output.strip().splitlines()) == 1
    assert "[peers]" in answer.output
    assert not out.exists()


@pytest.mark.peer
@pytest.mark.usefixtures("others")
def test_attenuation_of_water_is_that_of_the_published_tables():
    # NIST XCOM, 60 and 100 keV
    assert mac_cm2_g(WATER, np.array([60.0, 100.0])) == pytest.approx([0.2059, 0.1707], rel=2e-3)


@pytest.mark.peer
@pytest.mark.usefixtures("others")
def test_fluorescence_escapes_above_the_edge_only_and_never_more_than_was_stopped():
    screen, energies = Screen("Gd2O2S", 0.1, 0.0, "GOS"), np.arange(20.5, 100.0)
    escaping = screen.escaping_kev(energies)
    assert not escaping[energies < 50.2].any()
    assert (escaping[energies > 50.3] > 0).all()
    assert (escaping < screen.absorbed(energies) * energies).all()
    # as good as none comes out of a thick layer's far side: at most half of what arises
    thick = Screen("Gd2O2S", 100.0, 0.0, "GOS").escaping_kev(np.array([51.0]))
    assert thick < 0.5 * 51.0 * 0.93


@pytest.mark.peer
@pytest.mark.usefixtures("others")
def test_scatter_of_a_point_has_the_light_that_goes_forward():
    point = np.zeros((201, 201), dtype=np.float32)
    point[100, 100] = 1.0
    light = single_scatter(point, 1.0, 10.0, 60.0)
    assert light.argmax() == 100 * 201 + 100
    # Klein and Nishina at 60 keV: 58 % goes forward; the panel holds all but the widest angles
    assert 0.5 < light.sum() < 0.6


@pytest.mark.peer
@pytest.mark.usefixtures("others")
def test_lengths_are_those_of_a_ball_where_the_scanner_really_is():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=3.0)
    ball.apply_translation((2.0, 1.0, 3.0))
    setup = draw_setup(1, 64, "csi")
    for view in VIEWS:
        geometry = setup.geometry(view).refined(4)
        (lengths,) = path_lengths_cm([ball], geometry)
        rows, columns = np.indices(lengths.shape)
        column, row, _ = geometry.project(np.array([[2.0, 1.0, 3.0]]))[0]
        assert lengths.max() == pytest.approx(6.0, rel=3e-3)
        assert np.average(rows, weights=lengths) == pytest.approx(row, abs=0.2)
        assert np.average(columns, weights=lengths) == pytest.approx(column, abs=0.2)


@pytest.mark.peer
@pytest.mark.usefixtures("others")
def test_an_edge_that_runs_along_the_pixels_is_straight_to_a_thirtieth_of_one():
    (plan,) = plan_bench(1, 3)
    slab = trimesh.creation.box((12.0, 0.4, 5.0))
    slab.apply_transform(trimesh.transformations.rotation_matrix(np.radians(1.5), (0, 1, 0)))
    substance = substances_called("aluminium")[0]
    part = PeerPart("slab", slab, substance, substance.density_low_g_cm3, "")
    thing = PeerObject(plan, [part], np.eye(4), "", 0.0)
    setup = draw_setup(1, 64, "csi")
    image = expose(setup, make_beam(setup), thing, "pa", scatter=0.0)
    column, row, _ = setup.geometry("pa").project(np.zeros((1, 3)))[0].astype(int)
    air, inside = np.median(image[:5]), image[row, column]
    upper = (image[:row, column - 8 : column + 9] - inside) / (air - inside)
    edge = upper.sum(axis=0)
    at = np.arange(len(edge))
    straight = np.polynomial.Polynomial.fit(at, edge, 1)(at)
    assert np.ptp(straight) > 0.3
    assert abs(edge - straight).max() < 1 / 30


@pytest.mark.peer
@pytest.mark.usefixtures("others")
def test_a_seed_gives_the_same_bytes_and_the_builder_reads_them(tmp_path):
    for name, copper in (("one", "told"), ("again", "told"), ("untold", "untold")):
        write_bench(tmp_path / name, 1, SETTINGS, copper=copper, weighed=True)
    one, again, untold = (contents(tmp_path / name) for name in ("one", "again", "untold"))
    assert one == again
    assert {name for name in one if one[name] != untold[name]} == {"scanner.toml"}
    folder = CaptureFolder(tmp_path / "one")
    capture = folder.read(folder.object_ids[0])
    assert capture.weighed_mass_g is not None
    assert capture.detector.scintillator == "GOS"
