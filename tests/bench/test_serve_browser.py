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
    (place / "limits.toml").write_text("jobs_per_user_hour = 100\n")
    words = ["serve", "--root", dataset, "--results", place / "results", "--state", place / "state"]
    words += ["--settings", place / "limits.toml"]
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

    def open_page(size: dict[str, int] = LAPTOP, scheme: str = "light") -> Any:
        context = chromium.new_context(viewport=size, is_mobile=size == PHONE, color_scheme=scheme)
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_MS)
        page.on("request", lambda one: elsewhere.append(one.url))
        page.goto(address)
        to(page, "Submit").wait_for()
        return page

    yield open_page
    for context in contexts:
        context.close()
    local = ("data:", "blob:", address)
    assert [url for url in elsewhere if not url.startswith(local)] == []


def to(page: Any, name: str) -> Any:
    """Return the link to a page."""
    return page.locator("nav[aria-label=Pages]").get_by_role("link", name=name)


def send(page: Any, file: Path, button: str = "Submit") -> str:
    """Send a file and return its state in the end."""
    to(page, "Submit").click()
    page.locator("#file").set_input_files(file)
    page.get_by_role("button", name=button, exact=True).click()
    ended = page.locator("#status[data-waiting=no], [data-state=turned_away]")
    ended.wait_for()
    return str(ended.get_attribute("data-state"))


def mass_alde(file: Path, reference: Reference) -> float:
    return float(score(file, reference, load_protocol()).metrics["mass_alde"].mean)


def methods(page: Any) -> list[str]:
    """Methods of the leaderboard in the order shown."""
    return [str(one) for one in page.locator(".board th.method a").all_inner_texts()]


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
    """A picture once it is there."""
    image = page.locator(f"{selector} svg[role=img]")
    image.wait_for()
    return str(image.evaluate("one => one.outerHTML"))


def changed(page: Any, selector: str, before: str) -> None:
    page.wait_for_function(
        "([where, old]) => {"
        " const one = document.querySelector(where + ' svg[role=img]');"
        " return one && one.outerHTML !== old }",
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
    assert send(page, halved, "Check only") == "sound"
    assert send(page, halved) == "scored"
    result = page.locator("#result").inner_text()
    assert re.search(r"mass MAPE ↓\s+0\.5000\s+0\.5000\s+-", result)  # no interval of four objects
    page.reload()
    page.locator("#standing").get_by_text("rank 1 of 1 in track geometry").wait_for()

    run_predictor(find_predictor("water"), reference.folder, "test", tmp_path / "water.npz")
    assert send(page, tmp_path / "water.npz") == "scored"
    page.locator("#standing").get_by_text("no rank in track geometry: trivial").click()

    assert methods(page) == ["halved", "water"]
    page.get_by_role("columnheader", name="mass ALDE").get_by_role("link").click()
    files = {"halved": halved, "water": tmp_path / "water.npz"}
    assert methods(page)[0] == "halved"  # the ranked rows come first, whatever the metric
    assert f"{mass_alde(files['water'], reference):.3f}" in page.locator(".unranked").inner_text()
    page.get_by_role("link", name="halved").press("Enter")
    page.locator(".facts").get_by_text("xden-bench verify").wait_for()
    assert page.url.endswith(page.locator("tr.open").get_attribute("id"))

    to(page, "Objects").click()
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


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [LAPTOP, PHONE], ids=["laptop", "phone"])
def test_plain_pages_are_accessible_fit_the_screen_and_follow_the_theme(
    visit: Callable[..., Any], submission: Submit, scheme: str, size: dict[str, int]
) -> None:
    factor = 0.55 + 0.2 * (size == PHONE) + 0.1 * (scheme == "dark")  # none is another's copy
    grown = submission(lambda _, grid: np.float32(factor) * grid, method=f"grown-{factor:.2f}")
    page = visit(size, scheme)
    assert send(page, grown) == "scored"
    check(page)
    page.locator("#standing").click()
    page.wait_for_url(re.compile("/board"))  # with its style sheet, which colours the links
    check(page)
    box = page.locator("tr.open td.chosen").bounding_box()
    assert box["x"] + box["width"] <= size["width"]
    ground, ink = page.evaluate(
        "['backgroundColor', 'color'].map(one => getComputedStyle(document.body)[one])"
    )
    assert (light(ground) > light(ink)) == (scheme == "light")


def check(page: Any) -> None:
    """Let axe look at a page, and see that it is no wider than the screen."""
    from axe_playwright_python.sync_playwright import Axe

    found = Axe().run(page)
    assert found.violations_count == 0, found.generate_report()
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def light(colour: str) -> float:
    """Mean of the three values of a colour as a browser names it."""
    return float(np.mean([int(one) for one in re.findall(r"\d+", colour)[:3]]))
