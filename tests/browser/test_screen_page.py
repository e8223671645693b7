"""The page `orip screen` in a browser: the whole way by clicks, and by keys alone.

Needs the packages chromium and chromium-driver of the system and `pip install 'orip[browser,images]'`; is skipped
without.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
from browser.chromium import chromium, needs_chromium  # skips the module where there is no selenium
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

pytest.importorskip("PIL")
pytest.importorskip("cv2")

from screen.film_project import FIDUCIALS, make_film, pixel
from screen.rendered_project import NEW, Rendered, make_project, served  # after what it needs

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("chromium"), "--disable-gpu --window-size=1280,900", "browser") as driver:
        yield driver


@pytest.fixture(scope="module")
def rendered() -> Rendered:
    return Rendered()


class Page:
    """The page, as somebody who measures sees and operates it."""

    def __init__(self, browser, url):
        self.browser = browser
        browser.get_log("browser")
        browser.get(url)
        self.plate = browser.find_element("id", "plate")
        self.wait(lambda: self.js("return scene && state.serial && !frames && [...tiles.values()].some(t => t.bitmap)"))

    def js(self, script, *given):
        return self.browser.execute_script(script, *given)

    def text(self, identity):
        return self.browser.find_element("id", identity).text

    def wait(self, holds):
        WebDriverWait(self.browser, 20, 0.05).until(lambda _: holds())

    def name(self, point):
        field = self.browser.find_element("id", "point")
        field.clear()
        field.send_keys(point, Keys.ENTER)

    def chips(self):
        texts = self.js("return [...document.querySelectorAll('.chip')].map(chip => chip.innerText)")
        return {text.split(":")[0]: text.splitlines()[0].partition(": ")[2] for text in texts}

    def click_at(self, pixel):
        """Click at a place of the photo that is shown."""
        x, y, ratio = self.js(
            "const [w, h, r] = fit(plate); return [...toCanvas(matrix(w, h, view), ...arguments[0]), r]", list(pixel)
        )
        box = self.plate.rect
        ActionChains(self.browser).move_to_element_with_offset(
            self.plate, round(x / ratio - box["width"] / 2), round(y / ratio - box["height"] / 2)
        ).click().perform()

    def keys(self, *keys):
        ActionChains(self.browser).send_keys(*keys).perform()

    def errors(self):
        return [one["message"] for one in self.browser.get_log("browser") if "favicon" not in one["message"]]


@pytest.fixture
def page(browser, tmp_path: Path, rendered: Rendered):
    with served(make_project(tmp_path, rendered)) as server:
        yield Page(browser, server.url)


def test_one_click_marks_a_point_in_all_photos(page: Page, rendered: Rendered) -> None:
    page.name("C7")
    page.wait(lambda: set(page.chips()) == {"P0", "P1", "P2"})
    assert all(text.startswith("expected, ±") for text in page.chips().values())
    shown = page.js("return size(photo).name")
    page.js("view.scale = 8; drawNow()")
    page.click_at(rendered.pixel(int(shown[1]), NEW["C7"]))
    page.wait(lambda: sum(text.startswith("proposed") for text in page.chips().values()) == 2)
    look_at(page, "proposed")
    page.browser.find_element("id", "accept").click()
    page.wait(lambda: all(text.startswith("measured, residual") for text in page.chips().values()))
    assert "adjusted minus given" in page.text("deviation")
    assert not page.errors()


def test_a_misfit_is_found_and_measured_again_by_keys_alone(page: Page, rendered: Rendered) -> None:
    truth = np.array(rendered.pixel(1, (0.44, 0.49)))
    page.js(
        "at('match').checked = false; show(1, arguments[0]); plate.focus()", (truth + np.array([30.0, 0.0])).tolist()
    )
    page.js("at('point').value = 'T6'")
    page.keys(Keys.ENTER)
    page.wait(lambda: "T6 in P1 does not fit" in page.text("wrong"))
    button = page.browser.find_element("css selector", "#wrong button")
    button.send_keys(Keys.ENTER)
    page.wait(lambda: page.js("return document.activeElement === plate && 'P2' in lines"))
    look_at(page, "misfit")
    page.keys("e")
    for _ in range(30):
        ActionChains(page.browser).key_down(Keys.SHIFT).send_keys(Keys.ARROW_LEFT).key_up(Keys.SHIFT).perform()
    page.keys(Keys.ARROW_RIGHT, Keys.ARROW_LEFT)
    assert page.js("return mark") == pytest.approx(truth.tolist(), abs=0.01)
    page.keys(Keys.ENTER)
    page.wait(lambda: page.text("wrong") == "nothing" and "fits" in page.text("answer"))
    page.keys("r", "+", "0", "]", "[", "x")
    page.wait(lambda: "left out by your decision" in page.text("answer"))
    page.keys("i")
    page.wait(lambda: "fits" in page.text("answer"))
    page.browser.find_element("id", "misfits").click()
    page.wait(lambda: "T6 in P1: w" in page.text("wrong"))
    page.js("plate.focus()")
    page.keys("x")
    page.wait(lambda: "T6 in P1" not in page.text("wrong") and "T6 in P2: w" in page.text("wrong"))
    page.keys("i")
    page.wait(lambda: "T6 in P1: w" in page.text("wrong"))
    assert not page.errors()


def test_marks_of_film_are_measured_by_clicks_and_by_keys(browser, tmp_path: Path) -> None:
    with served(make_film(tmp_path)) as server:
        page = Page(browser, server.url)
        page.wait(lambda: "measure 3 more marks" in page.text("fit"))
        page.browser.find_element("css selector", "#marks button").click()
        for name in ("1", "2"):
            page.wait(lambda name=name: f"Now fiducial mark {name}" in page.text("fit"))
            page.click_at(pixel(FIDUCIALS[name]))
        for name in ("3", "4"):
            # the page leads to where the next one is expected, by those before it, to the pixel of a click
            page.wait(lambda name=name: f"Now fiducial mark {name}" in page.text("fit"))
            page.wait(lambda name=name: page.js("return mark") == pytest.approx(pixel(FIDUCIALS[name]), abs=3.0))
            page.keys(Keys.ARROW_RIGHT, Keys.ENTER)
        page.wait(lambda: "oriented by 4 marks, s0" in page.text("fit") and "Now" not in page.text("fit"))
        assert page.text("marks").count("residual") == 4
        look_at(page, "marks")
        page.keys("u")
        page.wait(lambda: "fiducial 4: not measured" in page.text("marks"))
        page.keys("f")
        page.wait(lambda: "Now fiducial mark 4" in page.text("fit"))
        page.keys(Keys.ENTER)
        page.wait(lambda: "oriented by 4 marks" in page.text("fit"))
        page.keys("f", "x")
        page.wait(lambda: "fiducial 1: left out, residual" in page.text("marks"))
        page.keys("i")
        page.wait(lambda: "fiducial 1: measured, residual" in page.text("marks"))
        page.keys(Keys.ESCAPE, "p")
        page.wait(lambda: page.js("return !aim && document.activeElement === at('point')"))
        assert not page.errors()
    lines = [line.split() for line in (tmp_path / "EDITS.MEA").read_text().splitlines()]
    assert [line[0] for line in lines if len(line) == 3 and line[0] in FIDUCIALS][:3] == ["1", "2", "3"]


def test_an_address_leads_to_a_point_in_a_photo(page: Page, rendered: Rendered) -> None:
    url = page.browser.current_url
    page.browser.get("about:blank")
    page.browser.get(f"{url}#photo=P2&point=T6")
    page.wait(lambda: page.js("return scene && size(photo).name === 'P2' && Object.keys(lines).length === 2"))
    assert page.js("return mark") == pytest.approx(rendered.pixel(2, (0.44, 0.49)), abs=1e-3)
    assert page.js("return document.activeElement === plate && at('point').value") == "T6"
    assert not page.errors()


def test_a_name_with_markup_stays_a_name(page: Page) -> None:
    page.js("at('match').checked = false")
    page.js("at('point').value = '<img/src=x/onerror=document.title=1>'; show(0, [200, 200]); plate.focus()")
    page.keys(Keys.ENTER)
    page.wait(lambda: "<img" in page.text("answer"))
    page.keys("u")
    page.wait(lambda: page.js("return !placed('P0', '<img/src=x/onerror=document.title=1>')"))
    assert not page.browser.find_elements("css selector", "img")
    assert page.browser.title == "plane MAIN - orip screen"


def test_images_that_are_missing_and_names_that_are_not_given_are_said(
    browser, tmp_path: Path, rendered: Rendered
) -> None:
    folder = make_project(tmp_path, rendered)
    (folder / "images" / "P0.png").unlink()
    with served(folder) as server:
        page = Page(browser, server.url)
        assert page.js("return size(photo).name") == "P1", "the first one that has an image"
        page.keys(Keys.TAB)
        page.js("plate.focus()")
        for key in ("m", "x", "g", Keys.ENTER):
            page.js("say(''); plate.focus()")
            page.keys(key)
            page.wait(lambda: page.text("answer") == "name the point first")
            assert page.js("return document.activeElement.id") == "point"
        page.name("NOWHERE")
        page.wait(lambda: page.text("answer") == "no photo is known to show NOWHERE")
        page.js("plate.focus()")
        page.keys("[")
        page.wait(lambda: page.text("answer").startswith("P0: its image images/P0.png is missing: put it there"))
        for key in (Keys.ENTER, Keys.ARROW_LEFT, "m", "e", "+", "0"):
            page.keys(key)
        assert page.text("where") == ""
        # one that vanishes meanwhile, and is put back
        path = folder / "images" / "P2.png"
        image = path.read_bytes()
        path.unlink()
        page.keys("]", "]")
        page.wait(lambda: "images/P2.png: the image is not there any more" in page.text("lost"))
        path.write_bytes(image)
        page.wait(lambda: not page.browser.find_element("id", "lost").is_displayed())
        assert [text for text in page.errors() if "404" not in text] == []


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_wider_than_the_window_and_all_can_be_read(page: Page, width: int, scheme: str) -> None:
    axe = pytest.importorskip("axe_core_python.selenium", reason="needs axe: pip install 'orip[browser]'")
    media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    page.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    page.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        page.name("C8")
        page.wait(lambda: len(page.chips()) == 3)
        assert page.js("return document.documentElement.scrollWidth") <= width
        found = axe.Axe().run(page.browser)["violations"]
        assert [one["id"] for one in found] == []
        look_at(page, f"{width}-{scheme}")
    finally:
        page.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        page.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def look_at(page: Page, name: str) -> None:
    """Keep a picture of the page where a folder for them is named: somebody has to look at it."""
    if folder := os.environ.get("ORIP_TEST_SCREENSHOTS"):
        WebDriverWait(page.browser, 5, 0.05).until(lambda _: page.js("return !frames && !chipFrame"))
        page.browser.save_screenshot(str(Path(folder) / f"screen-{name}.png"))
