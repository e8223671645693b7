"""The page `orip drive watch` in a real browser: Chromium without a window, by its driver.

Needs the packages chromium and chromium-driver of the system and `pip install 'orip[browser]'`; is skipped without.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from browser.chromium import chromium, needs_chromium  # skips the module where there is no selenium
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.support.ui import WebDriverWait
from support.drive_tables import loaded, vertical_block

from orip.multimodel.link.watch import Watch
from orip.multimodel.link.watch_processor import OwnProcessor
from orip.multimodel.plan_view import BlockPoints, plan_view
from orip.web.page_server import WatchServer

pytestmark = needs_chromium

OPTIONS = "--disable-gpu --window-size=1280,800"
GROUND = np.array([(x, y, 0.0) for x in range(-20, 101, 5) for y in range(-80, 41, 5)], dtype=float)
SAMPLE = Path(__file__).parents[2] / "sample_projects" / "small_frame_block"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("chromium"), OPTIONS, "browser") as driver:
        yield driver


@pytest.fixture
def server():
    block, state = loaded(vertical_block())
    plan = plan_view(block, BlockPoints(tuple(map(str, range(len(GROUND)))), ("tie",) * len(GROUND), GROUND))
    with WatchServer(Watch(block, plan, OwnProcessor((block, state)))) as found:
        thread = threading.Thread(target=found.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield found
        found.shutdown()
        thread.join()


class Page:
    """The page, as a user sees and operates it."""

    def __init__(self, browser, url):
        self.browser = browser
        browser.get_log("browser")
        browser.get(url)
        self.plan = browser.find_element("id", "plan")
        self.wait(lambda: self.active and "Model" in self.text("status"))

    def wait(self, condition):
        WebDriverWait(self.browser, 10, 0.02).until(lambda _: condition())

    def text(self, identity):
        return self.browser.find_element("id", identity).text

    @property
    def active(self):
        """Return the names of the models that are drawn as active: one."""
        return [
            element.get_attribute("data-model")
            for element in self.browser.find_elements("css selector", ".model.active")
        ]

    def hand(self, right, up):
        """Return the mouse, moved to a place of the plan."""
        x, y = self.browser.execute_script("return toPixels(arguments[0])", [right, up])
        size = self.plan.rect
        offset = round(x - size["width"] / 2), round(y - size["height"] / 2)
        return ActionChains(self.browser, duration=20).move_to_element_with_offset(self.plan, *offset)

    def click(self, right, up):
        """Click at a place of the plan, and wait until the mark is there."""
        self.hand(right, up).click().perform()
        self.wait(lambda: self.is_marked(right, up))

    def is_marked(self, right, up):
        """Tell whether the mark is drawn at a place: a mouse is moved in whole pixels, so to two of them."""
        pixels = self.browser.execute_script("return view.scale")
        return self.mark() == pytest.approx([right, up], abs=2.0 / pixels)

    def mark(self):
        """Return where the mark is drawn, in the plan."""
        return self.browser.execute_script(
            "const dot = document.querySelector('#mark .dot');"
            "return fromPixels(['cx', 'cy'].map(key => Number(dot.getAttribute(key))))"
        )

    def quiet(self):
        """Tell whether the console has stayed empty."""
        return self.browser.get_log("browser") == []


def test_a_click_across_a_frame_line_changes_the_model(browser, server):
    """Frames of this block border on each other at X = 20."""
    page = Page(browser, server.url)
    page.click(19.0, 5.0)
    assert page.active == ["M1-1"]
    assert "Model M1-1 (row 1, column 1): photo P1-1 left, P1-2 right; optics normal" in page.text("status")
    page.click(21.0, 5.0)
    page.wait(lambda: page.active == ["M1-2"])
    assert page.is_marked(21.0, 5.0)
    assert "photo P1-2 left, P1-3 right; optics swapped; the mark is inside it" in page.text("status")
    frames = browser.find_elements("css selector", ".frame.active")
    assert sorted(frame.get_attribute("data-photo") for frame in frames) == ["P1-2", "P1-3"]
    assert server.watch.state()["mark"][:2] == pytest.approx(page.mark(), abs=0.01)
    page.click(22.0, -40.0)
    page.wait(lambda: page.active == ["M2-2"])
    assert page.quiet()


def test_dragging_goes_from_model_to_model(browser, server):
    page = Page(browser, server.url)
    page.hand(5.0, 0.0).click_and_hold().perform()
    for right in (15.0, 25.0, 45.0):
        page.hand(right, 0.0).perform()
        page.wait(lambda right=right: page.is_marked(right, 0.0))
    assert page.active == ["M1-3"]
    ActionChains(browser).release().perform()
    page.hand(65.0, 0.0).perform()  # the hand is off
    assert page.active == ["M1-3"]
    assert page.text("pointer").endswith("· point 441")  # the one at 65, 0
    assert page.quiet()


def test_keys(browser, server):
    page = Page(browser, server.url)
    page.click(15.0, 0.0)
    ActionChains(browser).send_keys("n").perform()
    page.wait(lambda: page.active == ["M1-2"])
    assert "the mark is outside its frames" in page.text("status")
    ActionChains(browser).send_keys("a").perform()
    page.wait(lambda: "models change by hand" in page.text("status"))
    button = browser.find_element("id", "automatic")
    assert button.get_attribute("aria-pressed") == "false"
    before = server.watch.state()["mark"]
    # right, up, and along Z: the arrow and page keys of the WebDriver standard
    ActionChains(browser).send_keys("\ue014\ue013\ue00e").perform()
    page.wait(lambda: server.watch.state()["mark"][2] > before[2] + 0.1)
    steps = np.subtract(server.watch.state()["mark"], before)
    assert steps[0] > 0.1
    assert steps == pytest.approx(steps[0], abs=1e-6)  # none of them is lost, however fast they come
    assert "models change by hand" in page.text("status")
    assert page.quiet()


def test_foot_switches_and_keys(browser, server):
    """Pressed with the mouse and from the keyboard, they reach the plate processor in their order."""
    page = Page(browser, server.url)
    pressed = []
    server.watch._processor.foot = pressed.append
    server.watch._processor.key = pressed.append
    browser.find_element("css selector", "[data-foot=RIGHT]").click()
    browser.find_element("css selector", "[data-key='15']").click()
    browser.find_element("css selector", "[data-key=ENTER]").click()
    page.wait(lambda: page.text("pressed") == "Pressed: right foot switch, 15, ENTER")
    page.plan.click()
    ActionChains(browser).send_keys("l70\ue007z").perform()  # Enter, as the WebDriver standard writes it
    page.wait(lambda: page.text("pressed").endswith("left foot switch, 7, 0, ENTER, ZERO"))
    assert pressed == ["RIGHT", "15", "ENTER", "LEFT", "7", "0", "ENTER", "ZERO"]
    assert page.quiet()


def test_the_page_fits_a_telephone(browser, server):
    """What is operated comes right below the plan, and nothing is wider than the screen."""
    screen = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
    try:
        page = Page(browser, server.url)
        assert browser.execute_script("return document.documentElement.scrollWidth") <= 390
        names = ["place", "status", "panel", "readout", "upper"]
        tops = [browser.find_element("id", name).rect["y"] for name in names]
        assert tops == sorted(tops)
        assert browser.find_element("css selector", "[data-foot=RIGHT]").rect["y"] < 844
        assert page.quiet()
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})


def test_what_is_refused_is_said(browser, server):
    page = Page(browser, server.url)
    browser.execute_script("drive({ object: [10, 0, 500] })")
    page.wait(lambda: page.text("refused"))
    assert page.text("refused") == "Not done: the point is not in front of photo P1-1."
    page.click(15.0, 0.0)
    page.wait(lambda: not page.text("refused"))
    assert page.quiet()


def test_two_pages_show_the_same(browser, server):
    first = Page(browser, server.url)
    window = browser.current_window_handle
    browser.switch_to.new_window("tab")
    try:
        second = Page(browser, server.url)
        second.click(50.0, -30.0)
        second.wait(lambda: second.active == ["M2-3"])
        browser.switch_to.window(window)
        first.wait(lambda: first.active == ["M2-3"])
        browser.switch_to.window(browser.window_handles[-1])
    finally:
        browser.close()
        browser.switch_to.window(window)


@pytest.fixture
def command(tmp_path):
    """Start the command for a sample project, and yield it with the address that it prints."""
    folder = Path(shutil.copytree(SAMPLE, tmp_path / "block"))
    program = [sys.executable, "-m", "orip.cli.main", "-C", str(folder)]
    subprocess.run([*program, "-q", "run"], check=True, capture_output=True)
    with subprocess.Popen(
        [*program, "drive", "watch", "--no-open"], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            yield process, process.stdout.readline().strip()
        finally:
            process.kill()


def test_the_command_with_a_cliff(browser, command):
    """The plan of a cliff is its elevation; a walk along a strip visits its models in their order."""
    process, url = command
    page = Page(browser, url)
    assert "X to the right and Z up" in page.plan.get_attribute("aria-label")
    visited = []
    for right in range(50, 221, 10):
        page.click(right, 70.0)
        visited += [name for name in page.active if visited[-1:] != [name]]
    assert visited == ["1-1", "1-2", "1-3", "1-4", "1-5"]
    assert page.quiet()
    process.send_signal(signal.SIGTERM)
    assert process.wait(10) == 0
    assert process.stderr.read() == "Ctrl-C ends it\n"
    page.wait(lambda: "No connection" in page.text("status"))


def test_photos_with_images_lie_on_the_plates(browser, tmp_path) -> None:
    pytest.importorskip("PIL")
    pytest.importorskip("cv2")
    from screen.stereo_project import adjusted_strip
    from screen.test_plate_pictures import watched

    from orip.multimodel.project_link import open_watch

    adjusted = adjusted_strip(tmp_path / "project")
    with watched(open_watch(adjusted.folder, None, None)) as url:
        page = Page(browser, url)
        browser.execute_script("return command('drive', { object: [20, 10, 14] })")
        page.wait(lambda: len(browser.find_elements("css selector", ".plate image")) == 2)
        loaded = (
            "return [...document.querySelectorAll('.eyepiece')].filter(one => !one.hidden && one.getContext('2d')"
            ".getImageData(20, 56, 1, 1).data[3]).length"
        )
        page.wait(lambda: browser.execute_script(loaded) == 2)
        assert browser.get_log("browser") == []
        if folder := os.environ.get("ORIP_TEST_SCREENSHOTS"):
            browser.save_screenshot(str(Path(folder) / "watch-pictures.png"))
