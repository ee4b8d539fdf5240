"""The area's manual and the packaged sample say and hold what they should."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from xden1k.access.hub import SAMPLE
from xden1k.documents.card import header, yaml_block
from xden1k.folder import open_folder
from xden1k.folder.verify import verify_folder
from xden1k.format.manifest import Manifest
from xden_builder.phantoms import plan_objects

MANUAL = SAMPLE.parent / "README.md"
LOADING = SAMPLE.parents[1] / "docs" / "manual" / "load.md"


def test_the_sample_is_sound_small_and_simulated() -> None:
    assert verify_folder(SAMPLE) == []
    manifest = Manifest.read(SAMPLE)
    assert manifest.objects <= 24
    assert manifest.simulated
    assert manifest.splits.keys() == {"train", "val", "test"}
    assert sum(path.stat().st_size for path in SAMPLE.rglob("*") if path.is_file()) < 6e6


def test_header_names_exactly_the_files_of_the_sample(request: pytest.FixtureRequest) -> None:
    expected = yaml_block(header(Manifest.read(SAMPLE), "sample/", features=False))
    if request.config.getoption("--update-golden"):
        _, _, rest = MANUAL.read_text(encoding="utf-8").split("---\n", 2)
        MANUAL.write_text(expected + rest, encoding="utf-8")
    assert MANUAL.read_text(encoding="utf-8").startswith(expected)
    below = {path.parent.parent for path in SAMPLE.parent.rglob("*.parquet")}
    assert below == {SAMPLE}


@pytest.mark.slow
def test_code_of_the_manual_runs(tmp_path: Path) -> None:
    blocks = re.findall(r"```python\n(.*?)```", LOADING.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 6
    environment = {name: value for name, value in os.environ.items() if name != "XDEN1K_ROOT"}
    environment |= {
        "HF_HOME": str(tmp_path / "hf"),
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "HF_HUB_OFFLINE": "1",
        "TMPDIR": str(tmp_path),
        "PYTHONPATH": str(SAMPLE.parents[1]),
    }
    ran = subprocess.run(  # noqa: S603
        [sys.executable, "-c", "\n".join(blocks)],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    (mine,) = tmp_path.glob("*/mine/manifest.json")
    assert Manifest.read(mine.parent).objects == Manifest.read(SAMPLE).splits["test"]


def test_the_sample_is_what_make_sample_makes() -> None:
    """Names and splits of the objects; a change of a shape shows in the manifest instead."""
    makefile = (SAMPLE.parents[1] / "Makefile").read_text(encoding="utf-8")
    (line,) = re.findall(r"^SAMPLE := (.*)$", makefile, re.MULTILINE)
    (names,) = re.findall(r"^CATEGORIES := (.*)$", makefile, re.MULTILINE)
    count, seed = (int(re.search(rf"--{word} (\d+)", line)[1]) for word in ("count", "seed"))
    plans = plan_objects(count, seed, names.split(","))
    folder = open_folder(SAMPLE)
    assert {(plan.object_id, plan.split) for plan in plans} == {
        (object_id, split) for split in folder.manifest.splits for object_id in folder.ids(split)
    }


def test_methods_can_learn_every_category_the_sample_tests_them_on() -> None:
    folder = open_folder(SAMPLE)
    known = {folder.row(object_id, ["category"])["category"] for object_id in folder.ids("train")}
    tested = {folder.row(object_id, ["category"])["category"] for object_id in folder.ids("test")}
    assert tested <= known
