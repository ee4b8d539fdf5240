"""Links lead somewhere, in the repository as on the site."""

from __future__ import annotations

import posixpath
import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from docs.hooks.documents import DOCUMENTS, links
from docs.hooks.reference import PACKAGES, page_of, pages
from tests.docs import blocks
from tests.docs.blocks import ROOT

PAGES = {path.relative_to(ROOT).as_posix(): path for path in blocks.pages()}
NAV = yaml.safe_load((ROOT / "mkdocs.yml").read_text())["nav"]


def anchors(path: Path) -> set[str]:
    """What a code host and the site both make of a page's headings."""
    without_code = re.sub(r"^```.*?^```", "", path.read_text(), flags=re.MULTILINE | re.DOTALL)
    heads = re.findall(r"^#+ (.*)$", without_code, re.MULTILINE)
    return {re.sub(r"\s+", "-", re.sub(r"[^\w\s-]", "", head.lower()).strip()) for head in heads}


@pytest.mark.parametrize("page", PAGES)
def test_every_link_leads_somewhere(page: str) -> None:
    for link in links(PAGES[page].read_text()):
        if link.startswith(("https://", "http://")):
            continue
        path, _, anchor = link.partition("#")
        target = ROOT / posixpath.join(posixpath.dirname(page), path) if path else PAGES[page]
        generated = target.resolve() == ROOT / "docs" / "reference" / "commands.md"
        assert target.exists() or generated, f"{page}: {link}"
        if anchor:
            assert anchor in anchors(target), f"{page}: {link}"


def nav_pages(nav: Any) -> list[str]:
    if isinstance(nav, str):
        return [nav]
    items = nav.values() if isinstance(nav, dict) else nav
    return [page for item in items for page in nav_pages(item)]


def test_every_page_of_the_navigation_exists_and_every_page_is_in_it() -> None:
    named = nav_pages(NAV)
    assert len(named) == len(set(named))
    for page in named:
        assert page in DOCUMENTS or (ROOT / "docs" / page).is_file(), page
    written = {path.relative_to(ROOT / "docs").as_posix() for path in (ROOT / "docs").rglob("*.md")}
    assert written - set(named) == set()


@pytest.mark.parametrize("package", PACKAGES)
def test_every_module_with_public_names_is_in_the_reference(package: str) -> None:
    modules = [module for page in pages(package).values() for module in page]
    held = {module.path.as_posix() for module in modules}
    files = (ROOT / PACKAGES[package]).rglob("*.py")
    assert held == {
        path.relative_to(ROOT).as_posix() for path in files if path.name != "__main__.py"
    }
    for module in modules:
        text = (ROOT / module.path).read_text()
        assert bool(module.public) == ("__all__ = [" in text and "__all__ = []" not in text)


def test_links_to_code_lead_to_its_reference() -> None:
    assert page_of("xden1k/errors.py") == "reference/xden1k/errors.md#xden1k.errors"
    assert (
        page_of("builder/xden_builder/poly") == "reference/xden_builder/poly.md#xden_builder.poly"
    )
    assert page_of("xden1k/README.md") is None
    assert page_of("xden1k/nowhere.py") is None
