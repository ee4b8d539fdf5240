"""The web app as a visitor meets it: a server of its own, driven in headless Chromium."""

from __future__ import annotations

import os
import re
import shutil
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from tests.waiting import NEVER_S, until
from xden_bench.methods.baseline import find_predictor, run_predictor
from xden_bench.scoring.protocol import load_protocol
from xden_bench.scoring.reference import Reference
from xden_bench.scoring.score import score

pytestmark = pytest.mark.browser

FLAGS = (
    *("--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"),
    *("--disable-component-update", "--disable-sync"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader"),  # 3D without a graphics card
)
LAPTOP, PHONE = {"width": 1440, "height": 900}, {"width": 390, "height": 844}
PATIENCE_MS = 1000 * NEVER_S
Submit = Callable[..., Path]


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """Headless Chromium, which no Python package brings; without it these tests are skipped."""
    from playwright.sync_api import sync_playwright

    program = shutil.which("chromium")
    if program is None:
        pytest.skip("no chromium in PATH")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        yield browser
        browser.close()


@pytest.fixture(scope="module")
def address(
    chromium: Any, dataset: Path, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[str]:
    """A server over the small dataset, with no entries yet."""
    place = tmp_path_factory.mktemp("serve")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = ["serve", "--root", dataset, "--results", place / "results", "--state", place / "state"]
    program = "from xden_bench.cli import cli; cli()"
    with (place / "log").open("wb") as log:
        server = subprocess.Popen(  # noqa: S603 - our own program
            [sys.executable, "-c", program, *map(str, words), "--port", str(port)],
            stdout=log,
            stderr=subprocess.STDOUT,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )
    try:
        url = f"http://127.0.0.1:{port}/"
        wait_for(url, server, place / "log")
        yield url
    finally:
        server.terminate()
        server.wait()


def wait_for(url: str, server: subprocess.Popen[bytes], log: Path) -> None:
    def answers() -> bool:
        assert server.poll() is None, log.read_text()
        try:
            with urllib.request.urlopen(url):  # noqa: S310 - loopback
                return True
        except (urllib.error.URLError, ConnectionError):
            return False

    until(answers, every_s=0.1)


@pytest.fixture
def visit(chromium: Any, address: str) -> Iterator[Callable[..., Any]]:
    """Open the app; in the end no page may have asked for anything from elsewhere."""
    elsewhere: list[str] = []
    contexts = []

    def open_page(size: dict[str, int] = LAPTOP) -> Any:
        context = chromium.new_context(viewport=size, is_mobile=size == PHONE)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.on("request", lambda one: elsewhere.append(one.url))
        page.goto(address)
        page.get_by_role("tab", name="Submit").wait_for()
        return page

    yield open_page
    for context in contexts:
        context.close()
    local = ("data:", "blob:", address)
    assert [url for url in elsewhere if not url.startswith(local)] == []


def send(page: Any, file: Path) -> str:
    """Upload a file and return its state in the end."""
    page.get_by_role("tab", name="Submit").click()
    if page.locator("#upload button[aria-label=Clear]").count():
        page.locator("#upload button[aria-label=Clear]").click()
    page.locator("#upload input[type=file]").set_input_files(file)
    page.locator("#upload").get_by_text(re.compile(re.escape(file.stem[:6]))).first.wait_for()
    page.locator("#send").click()
    final = page.locator(
        ", ".join(f"#status [data-state={one}]" for one in ("scored", "refused", "failed"))
    ).filter(has_text=file.name)
    final.wait_for()
    return str(final.get_attribute("data-state"))


def mass_alde(file: Path, reference: Reference) -> float:
    return float(score(file, reference, load_protocol()).metrics["mass_alde"].mean)


def methods(board: Any) -> list[str]:
    """Methods of the leaderboard in the order shown."""
    rows = board.locator("tbody tr, [role=row]").filter(visible=True).all_inner_texts()
    found = (re.search(r"halved|water \(trivial\)", row) for row in rows)
    return [one.group() for one in found if one]


def spoilt(file: Path) -> Path:
    """Return a copy of a submission in which an object is missing and another is negative."""
    with np.load(file) as sound:
        arrays = dict(sound)
    del arrays["density/bar-0002"]
    arrays["density/cube-0003"] = -arrays["density/cube-0003"] - 1
    bad = file.with_name("bad.npz")
    np.savez(bad, **arrays)
    return bad


def picture(page: Any, selector: str) -> str:
    """Address of a picture once it is there."""
    image = page.locator(f"{selector} img")
    image.wait_for()
    return str(image.get_attribute("src"))


def changed(page: Any, selector: str, before: str) -> None:
    page.wait_for_function(
        "([where, old]) => (document.querySelector(where + ' img') || {}).src !== old",
        arg=[selector, before],
    )


@pytest.mark.slow
def test_from_upload_to_the_object(
    visit: Callable[..., Any], submission: Submit, reference: Reference, tmp_path: Path
) -> None:
    page = visit()
    assert send(page, spoilt(submission(name="truth.npz"))) == "refused"
    listed = page.locator("#problems").inner_text()
    for expected in ("E301", "E404", "bar-0002", "cube-0003", "negative density"):
        assert expected in listed

    halved = submission(lambda _, grid: np.float32(0.5) * grid, name="halved.npz", method="halved")
    assert send(page, halved) == "scored"
    assert "mass MAPE ↓" in page.locator("#result").inner_text()
    assert "0.5000 to 0.5000" in page.locator("#result").inner_text()
    page.reload()
    page.get_by_role("tab", name="Submit").click()
    page.locator("#status [data-state=scored]").wait_for()  # the visitor's ticket is kept

    run_predictor(find_predictor("water"), reference.folder, "test", tmp_path / "water.npz")
    assert send(page, tmp_path / "water.npz") == "scored"

    page.get_by_role("tab", name="Leaderboard").click()
    board = page.locator("#board")
    board.get_by_text("water (trivial)").filter(visible=True).first.wait_for()
    heading = board.get_by_role("columnheader").filter(has_text="mass ALDE ↓")
    heading = heading.filter(visible=True).last
    files = {"halved": halved, "water (trivial)": tmp_path / "water.npz"}
    least_first = sorted(files, key=lambda name: mass_alde(files[name], reference))
    for way, order in (("ascending", least_first), ("descending", least_first[::-1])):
        heading.hover()
        heading.get_by_label("Open cell menu").click()
        page.get_by_text(f"Sort {way}").click()
        until(lambda order=order: methods(board) == order)
    board.get_by_text("halved").filter(visible=True).last.click()
    page.locator("#made").get_by_text("xden-bench verify").wait_for()
    page.screenshot(path=tmp_path / "board.png", full_page=True)

    page.get_by_role("tab", name="Objects").click()
    page.locator("#parts").get_by_text("polypropylene").filter(visible=True).first.wait_for()
    page.locator("#axis").get_by_label("x", exact=True).check()
    page.locator("#place").get_by_text("Plane x").wait_for()
    before = picture(page, "#slice-error")
    page.locator("#slice input[type=number]").fill("24")  # of plastic; those beyond are of steel
    page.locator("#slice input[type=number]").press("Enter")
    changed(page, "#slice-error", before)
    page.locator("#place").get_by_text("voxel 24 of 0 to 63").wait_for()
    page.locator("#model canvas").wait_for()
    before = picture(page, "#bar")
    page.get_by_label("error", exact=True).check()
    changed(page, "#bar", before)
    page.locator("#best, #worst").get_by_text("hollow-0002").filter(visible=True).last.click()
    page.locator("#line").get_by_text("hollow-0002").wait_for()
    assert "simulated, never on a scanner" in page.locator("#line").inner_text()
    picture(page, "#PA-2")
    page.screenshot(path=tmp_path / "objects.png", full_page=True)
    with Image.open(tmp_path / "objects.png") as shot:
        assert len(shot.getcolors(1 << 24) or []) > 1000
