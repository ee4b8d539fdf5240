"""The comparison of rebuilt objects with what the simulator knows."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from click.testing import CliRunner

from tests.builder.registration_scenes import THERE
from xden1k.errors import DataError
from xden_builder.capture import CaptureFolder, CapturePart
from xden_builder.capture.space import divide
from xden_builder.cli import cli
from xden_builder.commands.evaluate import evaluate as evaluate_command
from xden_builder.evaluate import run
from xden_builder.evaluate.methods import ABLATIONS, Ablation, nominal, scaled, told
from xden_builder.evaluate.run import BodyCheck, Evaluation, ObjectResult, PartCheck
from xden_builder.evaluate.table import calibration_rows, flag_rows, markdown
from xden_builder.evaluate.truth import Errors, Truth, errors_of, read_truth
from xden_builder.phantoms import write_captures
from xden_builder.phantoms.realism import LIFELIKE
from xden_builder.phantoms.scanner import Scanner
from xden_builder.phantoms.scanner.composition import MOST_COMPOSITION_SD
from xden_builder.poly.hardness import Hardness, join
from xden_builder.poly.settings import PolySettings

pytestmark = pytest.mark.usefixtures("in_this_process")


@pytest.fixture(scope="module")
def captures(tmp_path_factory):
    root = tmp_path_factory.mktemp("evaluate") / "captures"
    write_captures(
        root,
        2,
        5,
        scanner=Scanner.realistic(96),
        realism=LIFELIKE,
        categories=["pencil", "mug"],
    )
    return root


def boxes():
    left, right = (trimesh.creation.box((1, 1, 1)) for _ in range(2))
    right.apply_translation((3, 0, 0))
    return [left, right]


def test_the_truth_has_no_error_and_a_factor_on_it_is_told_from_a_shift():
    density = np.array([1.0, 3.0])
    truth = Truth(density, 4.0, np.array([2.25, 0.0, 0.0]))
    assert errors_of(density, boxes(), truth) == Errors(0.0, 0.0, 0.0)
    off = errors_of(2 * density, boxes(), truth)
    assert (off.density_mae_g_cm3, off.mass_ape, off.com_l1_cm) == (2.0, 1.0, 0.0)
    swapped = errors_of(density[::-1].copy(), boxes(), truth)
    assert swapped.mass_ape == 0
    assert swapped.com_l1_cm == pytest.approx(1.5)


def test_the_centre_of_mass_is_sought_where_the_meshes_handed_over_show_it(captures):
    for object_id in CaptureFolder(captures).object_ids:
        capture = CaptureFolder(captures).read(object_id)
        truth = read_truth(captures / object_id, capture.parts)
        error = errors_of(truth.density_g_cm3, [part.mesh for part in capture.parts], truth)
        assert error.density_mae_g_cm3 == 0
        assert error.com_l1_cm < 0.02  # simplified surfaces
        assert error.mass_ape < 0.05  # and their scale


def test_the_centre_of_mass_of_meshes_in_another_frame_is_where_they_were_found_to_be(tmp_path):
    values = {"parts": [], "mass_g": 1.0, "com_cm": [1.0, 2.0, 3.0], "mesh_pose": THERE.to_dict()}
    (tmp_path / "truth.json").write_text(json.dumps(values))
    off_cm = np.array([0.0, 0.5, 0.0])
    found = replace(THERE, translation_cm=THERE.translation_cm + off_cm)
    np.testing.assert_allclose(read_truth(tmp_path, [], THERE).com_cm, values["com_cm"])
    np.testing.assert_allclose(read_truth(tmp_path, [], found).com_cm, values["com_cm"] + off_cm)
    np.testing.assert_allclose(read_truth(tmp_path, []).com_cm, values["com_cm"])


def test_the_truth_of_other_parts_is_refused(captures):
    object_id = CaptureFolder(captures).object_ids[0]
    stranger = CapturePart("stranger", boxes()[0])
    with pytest.raises(DataError, match="no part 'stranger'"):
        read_truth(captures / object_id, [stranger])
    with pytest.raises(DataError, match=r"truth\.json: expected the truth of a simulated object"):
        read_truth(captures, [stranger])


def test_what_is_not_told_is_taken_away(captures):
    capture = CaptureFolder(captures).read(CaptureFolder(captures).object_ids[0])
    capture = replace(
        capture, parts=tuple(replace(part, material="steel") for part in capture.parts)
    )
    assert {part.material for part in told(capture, "labels").parts} == {"steel"}
    assert {part.material for part in told(capture, "families").parts} == {"metal"}
    assert {part.material for part in told(capture, "blind").parts} == {""}


def test_labels_alone_say_the_nominal_density_and_a_scale_only_scales_it():
    mesh = boxes()
    parts = [CapturePart("a", mesh[0], "steel"), CapturePart("b", mesh[1], "water")]
    density = nominal(parts)
    np.testing.assert_allclose(density, [7.85, 1.0])
    np.testing.assert_allclose(scaled(density, mesh, 17.7), 2 * density)


def test_an_ablation_that_lies_about_the_source_leaves_the_capture_itself_alone(captures):
    capture = CaptureFolder(captures).read(CaptureFolder(captures).object_ids[0])
    changed = Ablation(copper_cm=0.01, exposure=1.1).applied(capture)
    assert changed.tube.filtration_cm["Cu"] == 0.01
    assert "Cu" not in capture.tube.filtration_cm
    valid = capture.views[0].valid
    ratio = changed.views[0].transmission[valid] / capture.views[0].transmission[valid]
    np.testing.assert_allclose(ratio, 1.1, rtol=1e-5)


def test_a_fit_that_leaves_something_out_is_not_told_the_errors_of_the_whole_fit(
    captures, monkeypatch
):
    """Else it believes its images as if it left nothing out, and comes out far worse."""
    told_settings = []
    monkeypatch.setattr(run, "poly", lambda *told: told_settings.append(told[-1]) or [None])
    monkeypatch.setattr(run, "errors_of_fit", lambda *_: None)
    capture = CaptureFolder(captures).read(CaptureFolder(captures).object_ids[0])
    small = Hardness(0.0, 0.002, 80, 30, None, 0.2, 0.2)
    bench = run._Bench(capture, divide(capture.parts), None, small, {}, {})
    for ablation in ABLATIONS.values():
        bench.ablation(ablation)
    everything, *others = told_settings
    assert everything.model_share == pytest.approx(0.2 * PolySettings().model_share)
    beam = {"extra_filter_mm_cu": 0.0, "filter_sd_mm_cu": 0.0}
    assert [replace(each, **beam) for each in others] == [
        ablation.settings for name, ablation in ABLATIONS.items() if not ablation.shared
    ]


def result(*parts):
    errors = {("poly", "labels"): Errors(0.1, 0.02, 0.03)}
    every = dict.fromkeys(("labels", "families", "blind"), tuple(parts))
    return ObjectResult(errors, every, BodyCheck(0.5, (0.0, 1.5, 3.0)), {}, None, {})


def test_shares_within_deviations_and_of_flags_are_counted():
    parts = [
        PartCheck(1.0, 0.1, 1.05, "xray", ()),  # within one
        PartCheck(1.0, 0.1, 1.15, "xray", ()),  # within two
        PartCheck(1.0, 0.1, 2.0, "prior", ("uncertain",)),  # far off, flagged
        PartCheck(1.0, 0.1, 1.4, "xray", ()),  # far off, not flagged
    ]
    rows = calibration_rows([result(*parts)])
    assert rows[0] == ["labels", "all parts", "4", "25.0 %", "50.0 %"]
    assert flag_rows([result(*parts)])[0] == ["labels", "2", "50.0 %", "75.0 %", "66.7 %"]


@pytest.mark.slow
def test_the_command_compares_every_method_and_writes_its_tables(captures, tmp_path):
    out = tmp_path / "tables.md"
    words = ["evaluate", str(captures), "--ablated", "1", "--workers", "1", "-o", str(out)]
    ran = CliRunner().invoke(cli, [*words, "--json"])
    assert ran.exit_code == 0, ran.output
    values = json.loads(ran.stdout)
    assert set(values["objects"]) == set(CaptureFolder(captures).object_ids)
    text = out.read_text()
    for name in ("paper + mass", "labels alone", "poly + mass", *ABLATIONS, "outer surface alone"):
        assert name in text


@pytest.mark.parametrize(
    ("words", "composition_sd"), [((), 0.02), (("--composition-sd", "0"), None)]
)
def test_simulated_things_are_not_quite_of_the_librarys_compositions_unless_asked_for(
    words, composition_sd, monkeypatch
):
    scanners = []

    def evaluated(folder, *_):
        scanners.append(json.loads((folder / "simulation.json").read_text())["scanner"])
        return Evaluation({}, (), join({}))

    monkeypatch.setattr("xden_builder.commands.evaluate._evaluated", evaluated)
    ran = CliRunner().invoke(cli, ["evaluate", "--count", "1", "--size", "64", *words])
    assert ran.exit_code == 0, ran.output
    assert scanners[0].get("composition_sd") == composition_sd


def test_the_command_takes_compositions_as_far_off_as_the_simulator_does():
    ran = CliRunner().invoke(cli, ["evaluate", "--composition-sd", str(MOST_COMPOSITION_SD + 1e-9)])
    assert ran.exit_code == 2
    (option,) = [each for each in evaluate_command.params if each.name == "composition_sd"]
    assert option.type.max == MOST_COMPOSITION_SD


def test_a_capture_without_a_tube_is_listed_as_failed(tmp_path):
    write_captures(tmp_path / "mono", 1, 5, size=64, categories=["mug"])
    ran = CliRunner().invoke(
        cli, ["evaluate", str(tmp_path / "mono"), "--ablated", "0", "--workers", "1"]
    )
    assert ran.exit_code == 3
    assert "expected a tube" in ran.stderr


def test_tables_of_no_object_say_so():
    assert markdown(Evaluation({}, (), join({}))).startswith("0 simulated objects")
