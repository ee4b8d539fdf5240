"""The page on training runs as it stands."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from xden1k.access.dataset import FIELDS

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "manual" / "torch.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_every_block_of_the_page_runs_from_an_empty_folder(tmp_path: Path) -> None:
    blocks = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert len(blocks) == 8
    environment = {name: value for name, value in os.environ.items() if name != "XDEN1K_ROOT"}
    environment |= {
        "HF_HOME": str(tmp_path / "hf"),
        "XDG_CACHE_HOME": str(tmp_path / "cache"),
        "HF_HUB_OFFLINE": "1",
        "TMPDIR": str(tmp_path),
        "PYTHONPATH": str(ROOT),
    }
    code = "\n".join(blocks)
    code += "\nassert batch['xray_pa'].shape == (4, 96, 96)\nassert offset.grad.abs().sum() > 0"
    ran = subprocess.run(  # noqa: S603
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert ran.returncode == 0, ran.stderr


def test_the_page_names_every_field() -> None:
    named = set(re.findall(r"`(\w+)`", PAGE))
    assert {name for name in FIELDS if not name.startswith("xray_lat_")} <= named
