"""The area's manual and the packaged sample say and hold what they should."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from xden1k.card import header, yaml_block
from xden1k.hub import SAMPLE
from xden1k.manifest import Manifest
from xden1k.verify import verify_folder

MANUAL = SAMPLE.parent / "README.md"


def test_the_sample_is_sound_small_and_simulated() -> None:
    assert verify_folder(SAMPLE) == []
    manifest = Manifest.read(SAMPLE)
    assert manifest.objects <= 24
    assert manifest.simulated
    assert manifest.splits.keys() == {"train", "val", "test"}
    assert sum(path.stat().st_size for path in SAMPLE.rglob("*") if path.is_file()) < 6e6


def test_header_names_exactly_the_files_of_the_sample() -> None:
    expected = yaml_block(header(Manifest.read(SAMPLE), "sample/", features=False))
    assert MANUAL.read_text(encoding="utf-8").startswith(expected)
    below = {path.parent.parent for path in SAMPLE.parent.rglob("*.parquet")}
    assert below == {SAMPLE}


def test_code_of_the_manual_runs(tmp_path: Path) -> None:
    blocks = re.findall(r"```python\n(.*?)```", MANUAL.read_text(encoding="utf-8"), re.DOTALL)
    assert len(blocks) == 5
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
