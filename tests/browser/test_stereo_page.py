"""The stereo page in a browser: a point, a line and an area by the mouse, and the whole way by keys alone.

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
from selenium.webdriver.common.actions.wheel_input import ScrollOrigin
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import Select, WebDriverWait

pytest.importorskip("PIL")
pytest.importorskip("cv2")

from screen.stereo_project import Adjusted, adjusted_strip, served_stereo  # after what it needs
from support.rendered_surface import AZIMUTH, BASE, height

from orip.screen.stereo_screen import STEREO_FILE

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("chromium"), "--disable-gpu --window-size=1280,900", "browser") as driver:
        yield driver


@pytest.fixture(scope="module")
def adjusted(tmp_path_factory: pytest.TempPathFactory) -> Adjusted:
    return adjusted_strip(tmp_path_factory.mktemp("stereo") / "project")


class Page:
    """The page, as an operator sees it."""

    def __init__(self, browser, url: str, file: Path):
        self.browser, self.file = browser, file
        browser.get_log("browser")
        browser.get(url)
        self.picture = browser.find_element("id", "picture")
        self.wait(lambda: self.js("return scene && state && drawn && [...tiles.values()].some(t => t.bitmap)"))

    def js(self, script, *given):
        return self.browser.execute_script(script, *given)

    def text(self, identity):
        return self.browser.find_element("id", identity).text

    def wait(self, holds):
        WebDriverWait(self.browser, 30, 0.05).until(lambda _: holds())

    def keys(self, *keys):
        ActionChains(self.browser).send_keys(*keys).perform()

    def settled(self):
        """Wait until everything asked for is shown, and return the state."""
        self.wait(
            lambda: self.js("return !isMoving && !drawing && !frames && [...tiles.values()].every(t => t.bitmap)")
        )
        return self.js("return state")

    def go(self, x, y, z=None):
        field = self.browser.find_element("id", "to")
        field.clear()
        field.send_keys(f"{x} {y} {height(x, y) if z is None else z}", Keys.ENTER)
        self.wait(lambda: self.js("return state.mark && Math.abs(state.mark[0] - arguments[0]) < 1e-6", x))

    def errors(self):
        return [one["message"] for one in self.browser.get_log("browser") if "favicon" not in one["message"]]


@pytest.fixture
def page(browser, adjusted: Adjusted):
    file = adjusted.folder / STEREO_FILE
    file.unlink(missing_ok=True)
    with served_stereo(adjusted.folder) as server:
        yield Page(browser, server.url, file)


def test_an_address_leads_to_a_model_with_the_photo_and_to_the_point(page: Page) -> None:
    photo = page.js("return scene.models.at(-1).photos[1]")
    url = page.browser.current_url
    for place, mark in (
        (f"photo={photo}", None),
        (f"photo={photo}&point={page.js('return scene.points[0]')}", "point"),
    ):
        page.browser.get("about:blank")
        page.browser.get(f"{url}#{place}")
        page.wait(lambda: page.js("return scene && state && drawn"))
        if mark:
            page.wait(lambda: page.text("answer") == f"at {page.js('return scene.points[0]')}")
        else:
            page.wait(lambda: page.js("return scene.models[state.model].photos.includes(arguments[0])", photo))
    assert not page.errors()


def test_a_point_by_mouse_wheel_and_matching(page: Page) -> None:
    page.go(20.0, 10.0)
    page.js("scale = 3; draw()")
    before = page.settled()
    box = page.picture.rect
    ActionChains(page.browser).move_to_element_with_offset(
        page.picture, -round(box["width"] / 4) + 45, 30
    ).click().perform()
    page.wait(lambda: page.js("return state.serial") > before["serial"])
    after = page.settled()
    moved = np.subtract(after["places"][0], before["places"][0])
    assert moved == pytest.approx([15.0, 10.0], abs=1.5)  # the middle of a pane is half a pixel or two beside
    assert after["mark"][2] == pytest.approx(before["mark"][2], abs=1e-6)
    origin = ScrollOrigin.from_element(page.picture)
    ActionChains(page.browser).scroll_from_origin(origin, 0, -120).perform()
    page.wait(lambda: page.js("return state.mark[2]") > after["mark"][2])
    page.browser.find_element("id", "match").click()
    page.wait(lambda: page.text("answer").startswith("matched, ±"))
    x, y, z = page.settled()["mark"]
    assert z == pytest.approx(height(x, y), abs=0.6)
    page.browser.find_element("id", "record").click()
    page.wait(lambda: "recorded POINT P 1" in page.text("answer"))
    assert "POINT P 1\n" in page.file.read_text()
    assert page.browser.find_element("id", "name").get_attribute("value") == "2"
    page.wait(lambda: page.text("features") == "POINT P 1")
    page.js("at('points').click()")
    look_at(page, "point")
    page.browser.find_element("id", "undo").click()
    page.wait(lambda: "taken back" in page.text("answer"))
    assert "POINT" not in page.file.read_text()
    page.wait(lambda: page.text("features") == "nothing that is seen here")
    assert not page.errors()


def test_the_whole_way_by_keys_alone(page: Page) -> None:
    page.keys(Keys.TAB)
    for _ in range(40):  # from the top of the page to the picture
        if page.js("return document.activeElement === picture"):
            break
        page.keys(Keys.TAB)
    assert page.js("return document.activeElement === picture")
    page.keys("g", "20 10 14", Keys.ENTER)
    page.wait(lambda: page.js("return state.mark[0] === 20 || Math.abs(state.mark[0] - 20) < 1e-6"))
    before = page.settled()
    page.keys("5", Keys.ARROW_RIGHT, Keys.ARROW_RIGHT, Keys.ARROW_UP, Keys.PAGE_UP, ".")
    ActionChains(page.browser).key_down(Keys.SHIFT).send_keys(Keys.ARROW_LEFT).key_up(Keys.SHIFT).perform()
    ActionChains(page.browser).key_down(Keys.CONTROL).send_keys(Keys.ARROW_DOWN).key_up(Keys.CONTROL).perform()
    page.wait(lambda: np.subtract(page.settled()["places"][0], before["places"][0])[1] > 19.0)
    moved = np.subtract(page.settled()["places"], before["places"])
    assert moved.mean(axis=0) == pytest.approx([-0.8, 19.9], abs=0.3)
    # the plane of Z is not that of the model: over 20 pixels the x-parallax changes too
    assert moved[0, 0] - moved[1, 0] == pytest.approx(0.2, abs=0.6)
    assert 0.05 < page.js("return state.mark[2]") - before["mark"][2] < 0.2
    page.keys("m")
    page.wait(lambda: page.text("answer").startswith("matched"))
    for system, number in (("MODEL", "4"), ("LOWER", "2"), ("OBJECT", "5")):
        page.keys(number)
        page.wait(lambda system=system: page.js("return state.guide") == system)
    page.keys("n", Keys.BACKSPACE * 3, "17", Keys.ENTER)
    page.js("at('kind').value = 'LINE'; at('code').value = 'ROAD'")
    for number in range(1, 4):
        page.keys(Keys.ENTER)
        page.wait(lambda number=number: f"recorded LINE ROAD 17, vertex {number}" in page.text("answer"))
        page.keys(*[Keys.ARROW_RIGHT] * 3)
        page.settled()
    page.keys("u")
    page.wait(lambda: "taken back: vertex 3" in page.text("answer"))
    page.keys("c")
    page.wait(lambda: "closed LINE ROAD 17, vertex 2" in page.text("answer"))
    assert page.browser.find_element("id", "name").get_attribute("value") == "18"
    model = page.settled()["model"]
    page.keys("]")
    page.wait(lambda: page.js("return state.model") == model + 1)
    page.keys("[", "+", "-", "0", "v", "v", "t", "v", "t", "v")
    page.wait(lambda: page.js("return state.model") == model)
    assert page.js("return at('seen').value") == "beside"
    assert not page.errors()


def test_the_model_changes_while_the_mark_crosses_the_block(page: Page) -> None:
    along = BASE * np.array([np.cos(np.radians(AZIMUTH)), np.sin(np.radians(AZIMUTH))])
    Select(page.browser.find_element("id", "kind")).select_by_value("LINE")
    seen = []
    for part in np.linspace(0.5, 2.5, 9):
        page.go(*(part * along).tolist())
        seen.append(page.settled()["model"])
        page.keys(Keys.ENTER)
        page.wait(lambda: f"vertex {len(seen)}" in page.text("answer"))
    assert sorted(set(seen)) == [0, 1, 2]
    assert seen == sorted(seen)
    page.js("whole()")
    look_at(page, "crossed")
    page.keys("c")
    page.wait(lambda: "closed LINE P 1" in page.text("answer"))
    assert page.file.read_text().count("\n") == 11
    assert not page.errors()


def test_profile_and_contour_by_keys_and_buttons(page: Page) -> None:
    page.go(12.0, 6.0)
    page.js("at('code').value = 'PROF'; at('spacing').value = 3")
    page.keys("b")
    page.go(24.0, 10.0)
    page.keys("e")
    page.browser.find_element("id", "begin").click()
    page.wait(lambda: page.text("answer") == "profile PROF 1: 6 places ahead")
    page.js("picture.focus()")
    page.keys("s")
    page.wait(lambda: page.text("answer") == "at 1: look, correct, record")
    page.keys(Keys.ENTER)
    page.wait(lambda: "recorded LINE PROF 1, vertex 1" in page.text("answer"))
    page.keys("r")
    page.wait(lambda: page.text("answer").endswith("vertex 6; all is done"))
    page.keys("c")
    page.wait(lambda: "closed LINE PROF 1" in page.text("answer"))
    Select(page.browser.find_element("id", "course")).select_by_value("CONTOUR")
    page.go(26.4, 13.9, 13.5)
    page.js("at('height').value = 13.5; at('code').value = 'CONT'; at('snap').value = 3")
    page.browser.find_element("id", "begin").click()
    page.wait(lambda: page.text("answer") == "contour CONT 2")
    page.browser.find_element("id", "run").click()
    page.wait(lambda: page.js("return state.open") and "CONT" in page.js("return state.open"))
    page.js("picture.focus()")
    page.keys(Keys.ESCAPE)
    page.wait(lambda: page.browser.find_element("id", "run").text == "Run")
    page.js("scale = 2; draw()")
    look_at(page, "contour")
    for line in page.file.read_text().split("CONT 2")[1].strip().splitlines():
        assert len(line.split()) == 6
    # a quick machine comes to the border of a photo before, where the mark is to be set by hand
    assert [text for text in page.errors() if "/run " not in text] == []


def test_markup_in_names_stays_a_name(page: Page) -> None:
    page.js("at('name').value = '<img/src=x/onerror=document.title=1>'; picture.focus()")
    page.keys(Keys.ENTER)
    page.wait(lambda: "<img" in page.text("answer") and "<img" in page.text("features"))
    assert not page.browser.find_elements("css selector", "img")
    assert page.browser.title == "hills MAIN - orip screen"


@pytest.mark.parametrize("width", [1280, 390])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_nothing_is_wider_than_the_window_and_all_can_be_read(page: Page, width: int, scheme: str) -> None:
    axe = pytest.importorskip("axe_core_python.selenium", reason="needs axe: pip install 'orip[browser]'")
    media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
    page.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    page.browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    try:
        for number, (x, y) in enumerate([(20, 10), (24, 12), (26, 9)]):
            page.go(x, y)
            page.js("at('kind').value = 'AREA'")
            page.keys(Keys.ENTER)
            page.wait(lambda number=number: f"vertex {number + 1}" in page.text("answer"))
        page.js("document.querySelector('details').open = true; whole(); scale *= 1.7")
        assert page.js("return document.documentElement.scrollWidth") <= width
        found = axe.Axe().run(page.browser)["violations"]
        assert [one["id"] for one in found] == []
        for seen in ("beside", "anaglyph"):
            page.js("at('seen').value = arguments[0]; at('seen').onchange()", seen)
            look_at(page, f"{seen}-{width}-{scheme}")
    finally:
        page.browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        page.browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def look_at(page: Page, name: str) -> None:
    """Keep a picture of the page where a folder for them is named: somebody has to look at it."""
    if folder := os.environ.get("ORIP_TEST_SCREENSHOTS"):
        page.settled()
        page.browser.save_screenshot(str(Path(folder) / f"stereo-{name}.png"))
