"""Formats and glossary name what the code knows, all of it."""

from __future__ import annotations

import ast
import dataclasses
import json
import math
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.docs.blocks import ROOT, blocks
from tests.docs.playing import PROGRAMS
from xden1k.documents.card import type_name
from xden1k.format.schema import COLUMNS
from xden1k.rays import THINNER_THAN_LABELS
from xden_bench.entries.entry_form import KEYS
from xden_bench.scoring.metrics import METRICS
from xden_builder.capture import CaptureFolder, ObjectRow, read_scanner
from xden_builder.capture import scanner as scanner_module
from xden_builder.capture.starting import write_template
from xden_builder.physics.spectrum.panels import PANELS
from xden_builder.poly import hardness
from xden_builder.poly.materials import composition, shares
from xden_builder.poly.model import poses, radiograph, stray
from xden_builder.poly.posterior import problem
from xden_builder.poly.survey import FILTERS_MM_CU
from xden_builder.triage.flags import flag_kinds

DOCS = ROOT / "docs"
GLOSSARY = (DOCS / "glossary.md").read_text()
CAPTURE = DOCS / "formats" / "capture.md"
KNOWN_FLAGS = {
    *("hidden", "partly_unseen", "prior_dominated", "uncertain", "starved", "edge_only"),
    *("unstable", "material_guessed", "label_doubted", "not_converged", "volume_unsure"),
    *("at_bound", "unlike_material", "apparent_density", "attenuation_only", "no_density"),
    *("does_not_fit", "not_seen", "saturated", "dead_pixels", "polarity_not_as_dicom"),
    *("unexplained_content", "unexplained_shadow", "weighed_disagrees", "mesh_inverted"),
}
NAME = re.compile(r"[a-z]+(_[a-z]+)*")


def flags_in(tree: ast.AST) -> Iterator[str]:
    """Yield the names of flags that a module can raise.

    They stand in functions whose name says flags, in a table called ``raised``, in sets joined to
    flags, and behind the colon of ``f"{view}:flag"``.
    """
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and re.search("flags|_raised", node.name):
            for inner in ast.walk(node):
                if isinstance(inner, ast.Return | ast.Dict):
                    yield from _names(inner)
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "raised":
            yield from _names(node.value)
        if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.BitOr):
            right = node.right if isinstance(node, ast.BinOp) else node.value
            left = node.left if isinstance(node, ast.BinOp) else node.target
            if "flags" in ast.unparse(left) and isinstance(right, ast.Set):
                yield from _names(right)
        if isinstance(node, ast.JoinedStr) and len(node.values) == 2:
            last = node.values[1]
            if isinstance(last, ast.Constant) and re.fullmatch(f":{NAME.pattern}", str(last.value)):
                yield str(last.value)[1:]


def _names(node: ast.AST) -> Iterator[str]:
    for inner in ast.walk(node):
        if isinstance(inner, ast.Constant) and NAME.fullmatch(str(inner.value)):
            yield inner.value


def flags_of_the_builder() -> set[str]:
    found: set[str] = set()
    for path in sorted((ROOT / "builder" / "xden_builder").rglob("*.py")):
        if "evaluate" not in path.parts and "phantoms" not in path.parts:
            found |= set(flags_in(ast.parse(path.read_text())))
    found.add(THINNER_THAN_LABELS)  # which the rays know, and the builder takes from them
    return found - {column.name for column in COLUMNS if "flags" in column.name}


def test_the_registry_has_every_flag_of_the_code_and_no_other() -> None:
    flags = flags_of_the_builder()
    assert flags >= KNOWN_FLAGS, "the search for flags in the code has gone blind"
    assert set(flag_kinds()) == flags


def test_the_manual_says_of_every_flag_what_the_registry_says() -> None:
    words = {"needs_you": "needs you", "information": "information"}
    trust = (DOCS / "manual" / "trust.md").read_text()
    assert set(
        re.findall(r"^\| `(\w+)` \| (needs you|information) \| (.+) \| (.+) \|$", trust, re.M)
    ) == {
        (kind.flag, words[kind.severity], kind.meaning, kind.remedy)
        for kind in flag_kinds().values()
    }


def test_the_glossary_says_of_every_flag_what_the_registry_says() -> None:
    assert set(re.findall(r"^- \*\*`(\w+)`\*\*: (.+)\.$", GLOSSARY, re.MULTILINE)) == {
        (kind.flag, kind.meaning) for kind in flag_kinds().values()
    }


@pytest.mark.parametrize("name", METRICS)
def test_every_metric_is_in_the_glossary(name: str) -> None:
    assert f"`{name}`" in GLOSSARY


@pytest.mark.parametrize(
    "term",
    [
        *("LAC", "MAC", "HVL", "Heel", "Glare", "Scatter", "PA", "Apparent", "Envelope"),
        *("Occupancy", "Label grid", "Phantom", "Capture", "Sealed", "Oracle", "Track"),
        *("ALDE", "MnRE", "MAPE", "CRPS", "Coverage", "Macro mean", "Bootstrap CI"),
    ],
)
def test_terms_are_explained(term: str) -> None:
    assert re.search(rf"^- \*\*{term}\b", GLOSSARY, re.MULTILINE)


@pytest.mark.parametrize("program", PROGRAMS)
def test_every_command_is_in_the_manual(program: str) -> None:
    manual = "".join(path.read_text() for path in (DOCS / "manual").glob("*.md"))
    assert [name for name in PROGRAMS[program].commands if f"{program} {name}" not in manual] == []


def test_the_columns_are_those_of_the_schema() -> None:
    text = (DOCS / "formats" / "dataset.md").read_text()
    rows = re.findall(r"^\| `(\w+)` \| (.+?) \| (.+) \|$", text.split("\n## What is not")[0], re.M)
    assert rows == [(column.name, type_name(column), column.text) for column in COLUMNS]


def test_the_scanner_file_of_the_manual_is_read_and_complete(tmp_path: Path) -> None:
    (block,) = (one for one in blocks(CAPTURE) if one.title == "scanner.toml")
    path = tmp_path / "scanner.toml"
    path.write_text(block.code)
    (init,) = (path for path in write_template(tmp_path / "new") if path.name == "scanner.toml")
    assert init.read_text().rstrip("\n") == block.code.rstrip("\n")
    scanner = read_scanner(path)
    assert list(scanner.views) == ["pa", "lat", "oblique"]
    assert (scanner.tube.kv, scanner.tube.filtration_cm) == (100.0, {"Al": 0.25})
    for key in (*scanner_module._VIEW_KEYS, "energy_kev", "kv", "mas", "scintillator", "bits"):
        assert re.search(rf"\b{key} = ", block.code), key
    assert f"# optional: {' | '.join(PANELS)}\n" in block.code


def test_lines_that_are_commented_out_are_legal_too(tmp_path: Path) -> None:
    (block,) = (one for one in blocks(CAPTURE) if one.title == "scanner.toml")
    kept = [line for line in block.code.splitlines() if not line.startswith(("kv", "mas", "filt"))]
    path = tmp_path / "scanner.toml"
    path.write_text("\n".join(kept).replace("# energy_kev", "energy_kev"))
    assert read_scanner(path).tube.energy_kev == 130.0
    path.write_text(re.sub("^# (fit|turned) = ", r"\1 = ", block.code, flags=re.M))
    views = read_scanner(path).views
    assert [(view.fit, view.turned) for view in views.values()] == [
        (False, False), (False, True), (True, False),
    ]  # fmt: skip
    for quoted in ("flat_value = 28000.0", "dark_value = 105.0"):
        key = quoted.split("_")[0]
        path.write_text(re.sub(rf'^{key} = "{key}_pa.tif"', quoted, block.code, flags=re.M))
        assert getattr(read_scanner(path).views["pa"], key) == float(quoted.split()[-1])


COLUMN_OF_FIELD = {"weighed_mass_g": "mass_g"}
"""By the field that holds them, where the names differ."""


def test_the_objects_and_parts_of_the_manual_are_read(tmp_path: Path) -> None:
    objects, _ = (one.code for one in blocks(CAPTURE) if one.language == "csv")
    (tmp_path / "objects.csv").write_text(objects)
    rows = CaptureFolder(tmp_path).rows
    assert rows["kettle-0003"].weighed_mass_g == 1184.5
    assert rows["mug-0001"].split == "test"
    assert [row.pose == "near" for row in rows.values()] == [True, False, False]
    text = CAPTURE.read_text()
    for name in (field.name for field in dataclasses.fields(ObjectRow)):
        assert f"| `{COLUMN_OF_FIELD.get(name, name)}` |" in text


def test_the_entry_of_the_manual_has_the_keys_of_an_entry() -> None:
    (block,) = (one for one in blocks(DOCS / "formats" / "results.md") if one.language == "json")
    told = json.loads(block.code)
    folder = ROOT / "benchmarks" / "results" / "v1"
    real = json.loads(next(folder.rglob("category-median-*.json")).read_text())
    expected = list(real)
    expected.insert(expected.index("submission_sha256") + 1, "arrays_sha256")
    assert list(told) == [*expected, "archive", "team", "signature"]
    assert set(told) <= {*KEYS, *real}
    for key in ("method", "dataset", "bootstrap", "objects"):
        assert list(told[key]) == list(real[key])


def test_the_table_of_unknowns_expects_what_the_fit_expects() -> None:
    page = (DOCS / "method" / "fit.md").read_text()
    rows = dict(re.findall(r"^\| ([^|]+) \| [^|]+ \| (.+) \|$", page, flags=re.M))
    (scatter, scatter_sd, _, most), (glare, glare_sd, _, most_glare) = problem.SCATTER, stray.GLARE
    assert rows["strength of near and of far scatter"].startswith(f"{scatter} ± {scatter_sd} |")
    assert rows["strength of near and of far scatter"].endswith(f"0 to {most}")
    assert rows["strength of glare"] == f"{glare} ± {glare_sd} | 0 to {most_glare}"
    gain, gain_sd = radiograph.GAIN
    assert rows["gain"].startswith(f"{gain:.0f} ± {gain_sd};")
    assert rows["gain"].endswith("| {} to {:.0f}".format(*problem.GAIN_RANGE))
    near, far = stray.REACHES
    _, width_sd, low, high = problem.WIDTH
    widths = rows["width of near and of far scatter"]
    assert widths.startswith(f"{near} and {far} cm for each")
    assert f"± {width_sd} |" in widths
    assert widths.endswith(f"{math.exp(low):.1f} to {math.exp(high):.2f} times that")
    (turn, *_, shift_cm), (by_hand, *_, moved_cm) = poses.SHARED_SD, poses.TURNED_SD
    assert rows["rotation and translation"].startswith(
        f"the files' ± {math.degrees(turn):.1f}° and {shift_cm} cm; "
        f"turned ± {math.degrees(by_hand):.0f}° and {moved_cm:.0f} cm"
    )
    assert rows["row shift"].startswith(f"0 ± {poses.ROW_SHIFT_SD_CM} cm")
    least, most_sd = min(composition.BY_FAMILY.values()), max(composition.BY_FAMILY.values())
    made = rows["composition: factor on the coefficients"]
    assert made.startswith(f"1 ± {100 * least:.0f} to {100 * most_sd:.0f} % by the family")
    assert made.endswith(f"{problem.OFF[3]:.0f} deviations")
    assert rows["material"].startswith(f"a named label's in {100 * shares.LABEL_RIGHT:.0f} %")
    told, left_out = hardness.TOLD_RIGHT
    filters = f"0 ± {told[1]} mm Cu in {told[0]:.0%}, ± {left_out[1]} in {left_out[0]:.0%}"
    left = rows["filter left out of the beam"]
    assert left.startswith(filters.replace("%", " %"))
    assert left.endswith("| {} to {} mm".format(*(FILTERS_MM_CU[end] for end in (0, -1))))
    errors = rows["how far images err, and compositions"]
    assert f"logarithm ± {hardness.SCALE_SD} " in errors
    assert "| {:.1f} to {:.1f} times".format(*(hardness.SCALES[end] for end in (0, -1))) in errors
