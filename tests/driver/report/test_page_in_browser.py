"""The page in a real browser, from invented results whose motion is known in closed form."""

from __future__ import annotations

import base64
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from driver.report import verdict
from driver.report.findings import Findings
from driver.report.measured_figures import FIGURES
from driver.report.page import report_page
from driver.report.view import view_of_findings
from tests.driver.invented_results import KNOTS, PEAKS, STAGE, Results

browsers = pytest.importorskip("playwright.sync_api", reason="the package playwright is absent")
Page = Any

CHROMIUM = shutil.which("chromium")
pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="no chromium is installed")

DRAWN = (
    "budget", "specimen", "loading_axes", "slip", "motion", "fields", "loads", "residual_maps",
    "residual_over_strain", "residual_history", "evidence_1", "evidence_2", "critical_stress",
    "sensitivity",
    "correlation", "convergence",
)  # fmt: skip
# One grey pixel.
PNG = base64.b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAAAAAA6fptVAAAACklEQVR4nGNoAAAAggCBd81ytgAAAABJRU5ErkJggg=="
)
EVIL = "</script><img src=x onerror=document.title='broken'>"
READY = "document.documentElement.dataset.ready"
PATIENCE = 120_000.0  # ms, on a machine that is busy


def evil(findings: Findings) -> Findings:
    grain = findings.case.grains[0].model_copy(update={"name": EVIL})
    grains = (grain, *findings.case.grains[1:])
    return replace(findings, case=findings.case.model_copy(update={"grains": grains}))


@pytest.fixture(scope="module")
def file(written: Results, tmp_path_factory: pytest.TempPathFactory) -> Path:
    findings = evil(written.findings())
    pictures = dict.fromkeys((*DRAWN, *(Path(name).stem for name in FIGURES)), PNG)
    page = report_page(
        findings, verdict.first_screen(findings), view_of_findings(findings), pictures, "invented",
        "today", "0", {},
    )  # fmt: skip
    path = tmp_path_factory.mktemp("browser") / "report.html"
    path.write_text(page, "utf-8")
    return path


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with browsers.sync_playwright() as play:
        started = play.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--enable-unsafe-swiftshader"]
        )
        yield started
        started.close()


@pytest.fixture(scope="module")
def told() -> list[str]:
    """What the browser complains of, and what it asks for beside the page."""
    return []


@pytest.fixture(scope="module")
def page(browser: Any, file: Path, told: list[str]) -> Page:
    opened = browser.new_page(viewport={"width": 1280, "height": 800})
    opened.set_default_timeout(PATIENCE)
    opened.on("console", lambda said: told.append(said.text) if said.type == "error" else None)
    opened.on("pageerror", lambda error: told.append(str(error)))
    opened.on("request", lambda asked: told.append(asked.url))
    opened.goto(file.as_uri())
    opened.wait_for_function(f"() => {READY}")
    return opened


def field(page: Page, panel: int) -> list[list[float]]:
    found = page.evaluate(
        f"Array.from(document.getElementById('maps').data[{panel}].z, row => Array.from(row))"
    )
    return list(found)


def test_arrow_keys_go_from_image_to_image_and_the_motion_shown_is_that_of_the_image(
    page: Page,
) -> None:
    page.focus("#image")
    assert page.input_value("#image") == str(PEAKS[-1])
    for expected, keys in ((KNOTS[2], 0), (KNOTS[0], PEAKS[1] - PEAKS[0])):
        for _ in range(keys):
            page.keyboard.press("ArrowLeft")
        image = PEAKS[1] - keys
        page.wait_for_function(
            f"() => document.getElementById('readout').textContent.match('^Image {image}:')"
        )
        v, y = field(page, 0), page.evaluate("document.getElementById('maps').data[0].x")
        # v = elongation · Y / 12 µm, in nm, less its mean
        slope = (v[0][-1] - v[0][0]) / (y[-1] - y[0])
        assert slope == pytest.approx(1e3 * expected / 12.0, rel=0.01)


def test_the_strain_is_the_slope_of_the_motion(page: Page) -> None:
    page.select_option("#component", "yy")
    page.wait_for_function(
        "() => document.getElementById('maps').data[0].hovertemplate.includes('%<extra')"
    )
    strain = [value for row in field(page, 0) for value in row]
    # Fields are rounded to 0.02 nm, differences stand 0.44 µm apart.
    assert strain == pytest.approx([100.0 * KNOTS[0] / 12.0] * len(strain), abs=0.0095)
    page.select_option("#component", "v")


def test_a_click_on_the_loop_chooses_the_image_and_the_marker_stands_there(page: Page) -> None:
    wanted = 5
    place = page.evaluate(
        """k => {
          const loop = document.getElementById("loop"), layout = loop._fullLayout;
          loop.scrollIntoView();
          const box = loop.getBoundingClientRect(), dots = loop.data[2];
          return [box.left + layout.xaxis._offset + layout.xaxis.l2p(dots.x[k]),
                  box.top + layout.yaxis._offset + layout.yaxis.l2p(dots.y[k])];
        }""",
        wanted,
    )
    page.mouse.move(*place)
    page.mouse.click(*place)
    page.wait_for_function(f"() => document.getElementById('image').value == {wanted}")
    page.wait_for_function(f"() => document.getElementById('loop').data[3].x[0] == {STAGE[wanted]}")


def test_the_specimen_is_turned_by_keys(page: Page) -> None:
    page.eval_on_selector("#turned", "part => part.scrollIntoView()")
    eye = "document.getElementById('solid')._fullLayout.scene._scene.getCamera().eye"
    page.wait_for_function("() => document.getElementById('solid')._fullLayout?.scene?._scene")
    before = page.evaluate(eye)
    page.focus("#solid")
    page.keyboard.press("ArrowRight")
    page.wait_for_function(f"() => Math.abs({eye}.x - {before['x']}) > 0.01")
    after = page.evaluate(eye)
    assert after["z"] == pytest.approx(before["z"])


def test_the_specimen_is_coloured_by_slip_where_that_is_chosen(page: Page) -> None:
    page.eval_on_selector("#turned", "part => part.scrollIntoView()")
    page.wait_for_function("() => document.getElementById('solid')._fullLayout?.scene?._scene")
    page.select_option("#paint", "slip")
    page.wait_for_function("() => document.getElementById('solid').data[0].intensity")
    values = page.evaluate("Array.from(document.getElementById('solid').data[0].intensity)")
    # Of the cells of the invented mesh 10 to 50 %, those inside not seen.
    assert 9.99 < min(values) < 20.0 and 40.0 < max(values) < 50.01
    page.select_option("#paint", "grain")
    page.wait_for_function("() => document.getElementById('solid').data[0].facecolor")


def test_nothing_is_complained_of_or_asked_for_and_names_stay_text(
    page: Page, told: list[str], file: Path
) -> None:
    assert [one for one in told if not one.startswith("data:")] == [file.as_uri()]
    assert page.title() == "invented: named"
    assert EVIL in page.inner_text("#turned")


def test_nothing_is_wider_than_a_phone_with_all_parts_open(browser: Any, file: Path) -> None:
    phone = browser.new_page(viewport={"width": 390, "height": 844})
    phone.set_default_timeout(PATIENCE)
    phone.goto(file.as_uri())
    phone.wait_for_function(f"() => {READY}")
    width = "document.documentElement.scrollWidth"
    assert phone.evaluate(width) <= 390
    phone.evaluate("document.querySelectorAll('details').forEach(part => { part.open = true; })")
    assert phone.evaluate(width) <= 390
    phone.close()


def test_without_scripts_the_verdict_stands_and_pictures_open(browser: Any, file: Path) -> None:
    plain = browser.new_context(java_script_enabled=False).new_page()
    plain.goto(file.as_uri())
    assert plain.is_visible("#verdict") and not plain.is_visible("#view")
    plain.click("summary:has-text('Loads')")
    assert plain.is_visible("#loads img")
