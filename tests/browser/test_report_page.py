"""The report in a real browser: Chromium without a window, by its driver.

Needs the packages chromium and chromium-driver of the system and `pip install 'orip[browser]'`; is skipped without.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path

import pytest
from browser.chromium import chromium, needs_chromium  # skips the module where there is no selenium
from report.sample_pages import SAMPLES, sample
from selenium.webdriver.support.ui import Select, WebDriverWait

pytestmark = needs_chromium

OPTIONS = "--window-size=1280,900 --use-angle=swiftshader --enable-unsafe-swiftshader"
"""WebGL is computed by the processor: there need not be a graphics card."""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("chromium"), OPTIONS, "browser", "performance") as driver:
        yield driver


@pytest.fixture
def opened(browser, tmp_path):
    """Open the page of a sample project; the block in three dimensions is out of sight and not drawn."""

    def open_page(name):
        path = tmp_path / "report.html"
        path.write_text(sample(name).page, encoding="utf-8")
        browser.get_log("browser")
        browser.get_log("performance")
        browser.get(path.as_uri())
        return sample(name).result

    return open_page


@pytest.fixture
def shown(browser, opened):
    """Open the page of a sample project and have the block in three dimensions drawn."""

    def show(name):
        result = opened(name)
        browser.execute_script("document.getElementById('view').scrollIntoView()")
        WebDriverWait(browser, 60, 0.1).until(lambda _: drawn(browser))
        return result

    return show


def drawn(browser):
    return browser.execute_script("return document.getElementById('view').dataset.drawn") == "yes"


def column(browser, records, key):
    """Return the cells of a column of a table as they stand, from top to bottom."""
    return browser.execute_script(
        "const [records, key] = arguments, table = document.querySelector(`table[data-records='${records}']`);"
        "const place = table.querySelector(`th[data-key='${key}']`).cellIndex;"
        "return [...table.tBodies[0].rows].map(row => row.cells[place].textContent)",
        records, key,
    )  # fmt: skip


def sort(browser, records, key):
    button = browser.find_element("css selector", f"table[data-records='{records}'] th[data-key='{key}'] button")
    browser.execute_script("arguments[0].click()", button)


@pytest.mark.parametrize("name", SAMPLES)
def test_the_page_is_shown_without_an_error_and_from_nowhere_else(browser, shown, name):
    shown(name)
    # plotly reads its canvas back for the mouse, which Chromium remarks upon; remarks are no errors
    assert [entry for entry in browser.get_log("browser") if entry["level"] == "SEVERE"] == []
    requests = [entry["message"] for entry in browser.get_log("performance") if "requestWillBeSent" in entry["message"]]
    assert [request for request in requests if '"url":"http' in request] == []


def test_no_button_takes_a_project_elsewhere(browser, shown):
    shown("small_frame_block")
    buttons = browser.execute_script(
        "return [...document.querySelectorAll('.modebar-btn')].map(element => element.dataset.title)"
    )
    assert "Download plot as a PNG" in buttons
    assert not [button for button in buttons if "share" in button.lower() or "cloud" in button.lower()]
    assert browser.execute_script("return [view._context.showSendToCloud, view._context.plotlyServerURL]") == [
        False,
        "",
    ]
    links = browser.execute_script("return [...document.links].map(element => element.getAttribute('href'))")
    assert [link for link in links if not link.startswith("#")] == []


def test_the_block_is_drawn_with_photos_points_and_rays_on_demand(browser, shown):
    result = shown("small_frame_block")
    traces = browser.execute_script(
        "return view.data.map(trace => [trace.name, trace.x.filter(element => element !== null).length])"
    )
    kinds = [point["kind"] for point in result["points"].values()]
    # nine places for the three lines of a pyramid over its frame
    assert dict(traces[:1]) == {"photo frames": 11 * 12}
    assert dict(traces)["photo"] == 12
    for kind in ("tie", "control", "check"):
        assert dict(traces)[f"{kind} point"] == kinds.count(kind)
    assert dict(traces)["rays"] == 0
    Select(browser.find_element("id", "rays")).select_by_visible_text("of photo 203")
    WebDriverWait(browser, 20, 0.1).until(lambda _: rays_drawn(browser) == 46)
    Select(browser.find_element("id", "rays")).select_by_visible_text("of all photos")
    WebDriverWait(browser, 20, 0.1).until(lambda _: rays_drawn(browser) == 428)


def rays_drawn(browser):
    return browser.execute_script(
        "return view.data.find(trace => trace.name === 'rays').x.filter(element => element === null).length"
    )


def test_the_block_fits_on_paper(browser, shown):
    shown("small_frame_block")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        sides = browser.execute_script(
            "return ['.gl-container canvas', '.main-svg'].map("
            "element => document.querySelector('#view ' + element).getBoundingClientRect().width)"
        )
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})
    assert max(sides) <= 184 / 25.4 * 96, "the width of A4 within the margins, in pixels"
    assert min(sides) > 100 / 25.4 * 96


def test_tables_are_sorted_by_a_click(browser, opened):
    opened("zurich_city_hall")
    sort(browser, "points", "X.sd")
    cells = column(browser, "points", "X.sd")
    numbers = [float(cell) for cell in cells if cell != "constant"]
    assert numbers == sorted(numbers)
    assert cells[len(numbers) :] == ["constant"] * (len(cells) - len(numbers)), "what has no number comes last"
    sort(browser, "points", "X.sd")
    numbers = [float(cell) for cell in column(browser, "points", "X.sd") if cell != "constant"]
    assert numbers == sorted(numbers, reverse=True)
    heading = browser.find_element("css selector", "table[data-records='points'] th[data-key='X.sd']")
    assert heading.get_attribute("aria-sort") == "descending"


def test_the_page_fits_a_telephone_and_the_dark(browser, shown):
    shown("small_frame_block")
    screen = {"width": 400, "height": 800, "deviceScaleFactor": 1, "mobile": True}
    dark = {"features": [{"name": "prefers-color-scheme", "value": "dark"}]}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", screen)
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", dark)
    try:
        assert browser.execute_script("return document.documentElement.scrollWidth") <= 400
        paper = browser.execute_script("return getComputedStyle(document.body).backgroundColor")
        assert sum(map(int, paper.removeprefix("rgb(").removesuffix(")").split(","))) < 3 * 60
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_long_names_do_not_widen_the_page(browser, tmp_path):
    page = sample("small_frame_block").page
    assert page.count("1213") > 5
    path = tmp_path / "long.html"
    path.write_text(page.replace("1213", "P" * 300), encoding="utf-8")
    browser.get(path.as_uri())
    assert browser.execute_script("return document.documentElement.scrollWidth") <= 1280
    covered = browser.execute_script(
        "return [...document.querySelectorAll('.words')].filter(element => element.scrollWidth > element.clientWidth)"
        ".map(element => element.textContent)"
    )
    assert covered == [], "words that run over the next column"


def test_it_prints_all_rows_of_its_tables(browser, opened):
    opened("small_frame_block")
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": "print"})
    try:
        hidden = browser.execute_script(
            "return [...document.querySelectorAll('.table')]"
            ".filter(element => element.scrollHeight > element.clientHeight + 1).length"
        )
        assert hidden == 0
        assert not browser.find_element("css selector", "nav").is_displayed()
        buttons = browser.execute_script(
            "return [...document.querySelectorAll('thead button')].map(element => getComputedStyle(element).display)"
        )
        assert set(buttons) == {"contents"}, "a head with boxes of buttons is not repeated on the next page"
    finally:
        browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"media": ""})


@pytest.mark.parametrize("width", [1400, 390])
def test_axe_finds_nothing_that_keeps_people_out(browser, shown, width):
    """The rules of axe-core for WCAG 2, on the whole page with the block drawn and everything unfolded."""
    axe = find_spec("axe_core_python")
    if axe is None:
        pytest.skip("needs axe-core: pip install 'orip[browser]'")
    (folder,) = axe.submodule_search_locations
    browser.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    )
    try:
        shown("small_frame_block")
        browser.execute_script("document.querySelectorAll('details').forEach(found => found.open = true)")
        browser.execute_script(Path(folder, "axe.min.js").read_text(encoding="utf-8"))
        browser.set_script_timeout(240)
        found = browser.execute_async_script("axe.run().then(arguments[0])")
    finally:
        browser.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})
    assert len(found["passes"]) > 20
    assert [(rule["id"], [node["html"][:200] for node in rule["nodes"]]) for rule in found["violations"]] == []
