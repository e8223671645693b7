"""The report as `orip screen` serves it, in a browser: one click leads to the picture, where it is measured again."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from browser.chromium import chromium, needs_chromium  # skips the module where there is no selenium
from cli.command_line import orip
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

pytest.importorskip("PIL")
pytest.importorskip("cv2")

from screen.rendered_project import Rendered, make_project, served  # after what it needs

pytestmark = needs_chromium

MISFIT = "#wrong th a"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    options = "--window-size=1280,900 --use-angle=swiftshader --enable-unsafe-swiftshader"
    with chromium(tmp_path_factory.mktemp("chromium"), options, "browser") as driver:
        yield driver


@pytest.fixture(scope="module")
def truth() -> np.ndarray:
    return np.array(Rendered().pixel(1, (0.44, 0.49)))


@pytest.fixture(scope="module")
def url(tmp_path_factory, truth):
    """Serve a project that was adjusted with a point 30 pixels off in one photo."""
    folder = make_project(tmp_path_factory.mktemp("served"), Rendered())
    with (folder / "plane.MEA").open("a", encoding="utf-8") as file:
        file.write(f"POINTS MAIN P1\n  T6 {truth[0] + 30.0:.4f} {truth[1]:.4f}\n")
    said = orip(folder, "run")
    assert "T6" in said.out
    assert '<a href="./' not in (folder / "report.html").read_text(), "no link of a file leads nowhere"
    assert "<code>orip screen --at P1/T6</code>" in (folder / "report.html").read_text()
    with served(folder) as server:
        yield server.url


def wait(browser, script) -> None:
    WebDriverWait(browser, 30, 0.05).until(lambda _: browser.execute_script(f"return {script}"))


def errors(browser) -> list[str]:
    found = [one["message"] for one in browser.get_log("browser") if one["level"] == "SEVERE"]
    return [text for text in found if "favicon" not in text]


def look_at(browser, name: str) -> None:
    """Keep a picture of the page where a folder for them is named: somebody has to look at it."""
    if folder := os.environ.get("ORIP_TEST_SCREENSHOTS"):
        browser.save_screenshot(str(Path(folder) / f"served-{name}.png"))


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_report_can_be_read(browser, url: str, width: int, scheme: str) -> None:
    axe = pytest.importorskip("axe_core_python.selenium", reason="needs axe: pip install 'orip[browser]'")
    media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        browser.get(f"{url}report")
        wait(browser, "view.dataset.drawn")
        browser.execute_script("document.querySelector('#wrong').scrollIntoView()")
        look_at(browser, f"{width}-{scheme}")
        assert browser.execute_script("return document.documentElement.scrollWidth") <= width
        assert [one["id"] for one in axe.Axe().run(browser)["violations"]] == []
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_every_kind_of_place_leads_to_its_image(browser, url: str) -> None:
    browser.get(f"{url}report")
    for place, photo, point in (
        ("#control th a", "", "C0"),  # a point is shown where it is seen best
        ("#residuals .one a", "P0", ""),
        ("#wrong .many a", "P1", "T6"),
    ):
        wait(browser, f"document.querySelector('{place}')")
        browser.execute_script(f"document.querySelector('{place}').click()")
        wait(browser, f"typeof scene !== 'undefined' && scene && state.serial && at('point').value === '{point}'")
        wait(browser, "[...tiles.values()].some(tile => tile.bitmap)")
        assert browser.execute_script("return size(photo).name").startswith(photo)
        if point:
            wait(browser, "views.length === 3")
        browser.back()
    wait(browser, "document.querySelector('#wrong')")
    assert not errors(browser)


def test_one_click_leads_to_the_misfit_which_is_measured_again_by_keys(browser, url: str, truth: np.ndarray) -> None:
    browser.get(f"{url}report")
    link = browser.find_element("css selector", MISFIT)
    assert link.text == "photo P1 point T6"
    link.send_keys(Keys.ENTER)
    wait(browser, "typeof scene !== 'undefined' && scene && 'P2' in lines && 'P0' in lines")
    assert browser.execute_script("return mark") == pytest.approx([truth[0] + 30.0, truth[1]], abs=1e-3)
    wait(browser, "document.activeElement === plate && document.querySelectorAll('.chip').length === 3")
    assert "P1: measured, residual 30.0" in browser.find_element("id", "chips").text
    assert browser.find_element("id", "answer").text.startswith("T6 in P1: residual 30.0")
    wait(browser, "!frames && !chipFrame && [...tiles.values()].every(tile => tile.bitmap)")
    look_at(browser, "misfit")
    browser.execute_script("at('match').checked = false")
    for _ in range(30):
        ActionChains(browser).key_down(Keys.SHIFT).send_keys(Keys.ARROW_LEFT).key_up(Keys.SHIFT).perform()
    ActionChains(browser).send_keys(Keys.ENTER).perform()
    wait(browser, "at('answer').textContent.includes('fits')")
    # the address is that of the point: back leads to the report, which says that it is of before
    assert browser.current_url == f"{url}#photo=P1&point=T6"
    browser.back()
    wait(browser, "document.querySelector('header + .verdict')")
    notice = browser.find_element("css selector", "header + .verdict").text
    assert "out of date" in notice
    assert "EDITS.MEA" in notice
    assert not errors(browser)
