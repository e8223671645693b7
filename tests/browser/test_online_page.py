"""The page of a session in a browser: an operator sees there what was answered, what waits and what does not fit.

Needs the packages chromium and chromium-driver of the system and `pip install 'orip[browser]'`; is skipped without.
"""

from __future__ import annotations

import json
import threading
from pathlib import Path

import pytest
from browser.chromium import chromium, needs_chromium  # skips the module where there is no selenium
from selenium.webdriver.support.ui import WebDriverWait
from workflow.small_projects import first_project, without_points

from orip.online.page import ServedSession
from orip.online.session import OnlineSession
from orip.web.page_server import WatchServer
from orip.workflow.project.commit import commit
from orip.workflow.project.state import read_project
from orip.workflow.records.initialise import initialise

pytestmark = needs_chromium


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("chromium"), "--disable-gpu --window-size=1280,900", "browser") as driver:
        yield driver


@pytest.fixture
def session(tmp_path: Path):
    """Return what measures a point, the points of a small project, and the address of the page."""
    folder = first_project(tmp_path / "first")
    points = without_points(folder)
    commit(initialise(read_project(folder, "definitions")))
    served = ServedSession(OnlineSession(folder, None), folder)

    def measure(photo: str, point: str, x: float, y: float) -> dict[str, object]:
        line = json.dumps({"do": "measure", "photo": photo, "point": point, "x": x, "y": y})
        reply = served.reply(line)
        assert reply is not None
        return [reply, *(later["reconsidered"] for later in served.ended())][-1]

    with WatchServer(served.page) as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield measure, points, server.url
        server.shutdown()
        thread.join()


def test_the_page_says_what_waits_what_fits_and_what_does_not(browser, session) -> None:
    measure, points, url = session
    browser.get(url)

    def text(identity: str) -> str:
        return browser.find_element("id", identity).text

    def wait_for(part: str) -> None:
        WebDriverWait(browser, 10, 0.02).until(lambda _: part in text("answer"))

    assert "nothing measured yet" in text("answer")
    measure(*points[0])
    wait_for("waits")
    assert points[0][0] in text("waiting")
    for point in points[1:]:
        answer = measure(*point)
    wait_for(str(answer["text"]))
    captions = [caption.text for caption in browser.find_elements("css selector", "figcaption")]
    assert [caption.split(",")[0] for caption in captions] == ["left: 5 points", "right: 5 points"]
    assert not any("not oriented" in caption for caption in captions)
    photo, name, x, y = next(point for point in points if point[1] == "1")
    measure(photo, name, x + 400.0, y + 400.0)
    wait_for("does not fit")
    # a cross, and not a colour alone
    crosses = browser.find_elements("css selector", "svg.photo path[stroke='var(--suspect)']")
    assert crosses
    assert "do not fit" in browser.find_element("css selector", "figure.now").text
    assert text("suspects") != "nothing"
    measure(photo, name, x, y)
    wait_for(f"{name} in {photo}")
    WebDriverWait(browser, 10, 0.02).until(
        lambda _: not browser.find_elements("css selector", "svg.photo path[stroke='var(--suspect)']")
    )
    errors = [entry["message"] for entry in browser.get_log("browser") if "favicon" not in entry["message"]]
    assert not errors
