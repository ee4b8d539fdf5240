"""The built site asks nobody for anything: no script, style, picture or font from elsewhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from docs.hooks.reference import commands_page
from tests.docs.blocks import ROOT

LOADED = re.compile(
    r"<(?:script|link|img|iframe|source|video|audio|object|embed)\b[^>]*?"
    r"""(?:src|href|srcset|data)=["']?(?:https?:)?//[^>]*>"""
)
FROM_STYLE = re.compile(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//[^)]*")
FETCHED_BY_SCRIPT = re.compile(r'class="[^"]*\b(?:mermaid|arithmatex)\b')
"""What would make Material's script fetch a library from a content delivery network."""


def outside(site: Path) -> list[str]:
    found = []
    for path in sorted(site.rglob("*")):
        if path.suffix == ".html":
            text = path.read_text()
            found += LOADED.findall(text) + FROM_STYLE.findall(text)
            found += FETCHED_BY_SCRIPT.findall(text)
        elif path.suffix == ".css":
            found += FROM_STYLE.findall(path.read_text())
    return found


def build(config: Path, site: Path) -> str:
    ran = subprocess.run(  # noqa: S603
        [sys.executable, "-m", "mkdocs", "build", "--quiet", "-f", str(config), "-d", str(site)],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1", "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    return ran.stderr


@pytest.mark.slow
def test_pages_without_the_reference_load_nothing_from_elsewhere(tmp_path: Path) -> None:
    config = tmp_path / "mkdocs.yml"
    config.write_text(
        f"INHERIT: {ROOT}/mkdocs.yml\ndocs_dir: {ROOT}/docs\nstrict: false\nplugins: [search]\n"
        f"hooks: [{ROOT}/docs/hooks/documents.py]\n"
    )
    build(config, tmp_path / "site")
    assert len(list((tmp_path / "site").rglob("*.html"))) > 30
    assert outside(tmp_path / "site") == []


@pytest.mark.slow
def test_the_whole_site_is_built_without_a_warning(tmp_path: Path) -> None:
    assert build(ROOT / "mkdocs.yml", tmp_path / "site") == ""
    assert outside(tmp_path / "site") == []
    reference = (tmp_path / "site" / "reference" / "xden1k" / "values.html").read_text()
    assert 'id="xden1k.values.types.DensityObject.mass_g"' in reference
    assert not re.search(r":(?:class|func|mod|meth):", reference)


def test_the_reference_has_the_commands_that_packages_add_with_their_own_help() -> None:
    _, _, told = commands_page().partition("### `xden import`")
    said, _, _ = told.partition("### `")
    assert "--dry-run" in said


@pytest.mark.parametrize(
    "tag",
    [
        '<script src="https://x.org/a.js"></script>',
        '<link rel="stylesheet" href="//fonts.x.org/css">',
        "<img alt='' src='http://x.org/a.png'>",
        "<style>@font-face { src: url(https://x.org/a.woff2) }</style>",
        '<pre class="mermaid"><code>',
    ],
)
def test_what_would_ask_elsewhere_is_found(tag: str, tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text(tag + '<a href="https://x.org">a link is no request</a>')
    assert len(outside(tmp_path)) == 1
