"""The page as a whole: it loads nothing, is well formed, stays small, and stands whatever a solution holds."""

from __future__ import annotations

import base64
import hashlib
import html
import re
import zlib
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from files.hand_built_solutions import awkward, empty
from files.stores.store_samples import rich_solution
from plotly.offline import get_plotlyjs
from report.sample_pages import SAMPLES, Page, sample

from orip.files.text.decimal_numbers import parse_gate
from orip.records.camera import Camera
from orip.records.definition import BundleDefinition, StereoModel
from orip.records.photo import Photo
from orip.records.results.solution import Blunder, Estimates, Residuals, Solution
from orip.records.results.tests import GateResult
from orip.report.drawings.residual_vectors import FEWEST_PHOTOS
from orip.report.page import MOST_BYTES, report_page
from orip.report.report_input import ReportInput
from orip.report.run_mark import run_of_page
from orip.structs import replace

DRAWING = re.compile(r"<svg class=.*?</svg>(?=\s*</?(?:figure|div|svg|p)\b)", re.DOTALL)


def given(solution: Solution, **changed: object) -> ReportInput:
    return replace(ReportInput(solution, (), BundleDefinition("MAIN"), {}, {}), **changed)


@pytest.mark.parametrize("name", SAMPLES)
def test_nothing_is_loaded(name: str) -> None:
    page = sample(name).page
    assert [address for address in Page(page).loaded if not address.startswith("#")] == ["data:,"]
    own = re.sub(r'<script type="text/plain".*?</script>', "", page, flags=re.DOTALL)
    assert "://" not in own
    assert "@import" not in own
    assert "url(" not in own


@pytest.mark.parametrize("name", SAMPLES)
def test_the_drawings_are_well_formed(name: str) -> None:
    drawings = DRAWING.findall(sample(name).page)
    # plan and two elevations, three curves of convergence, all photos together, their mean, and those that stand out
    assert len(drawings) >= 6 + 2 + min(len(sample(name).result["photos"]), FEWEST_PHOTOS)
    for drawing in drawings:
        assert ET.fromstring(drawing).get("role") == "img"
        assert "nan" not in drawing


def test_plotly_is_inside() -> None:
    packed = re.search(r'id="plotly-packed">(.*?)</script>', sample("small_frame_block").page)
    assert packed is not None
    assert zlib.decompress(base64.b64decode(packed[1])).decode() == get_plotlyjs()


def test_the_page_carries_the_run() -> None:
    found = sample("small_frame_block")
    assert run_of_page(found.page[:500]) == found.solution.run
    assert run_of_page("<html>") is None


def test_equal_solutions_give_equal_pages() -> None:
    assert report_page(given(awkward())) == report_page(given(awkward()))


@pytest.mark.parametrize("make", [awkward, empty, rich_solution])
def test_a_page_stands_whatever_a_solution_holds(make) -> None:
    solution = make()
    assert f"run {solution.run}" in "".join(Page(report_page(given(solution))).words)


def test_coordinates_that_are_no_numbers_do_no_harm() -> None:
    solution = sample("small_frame_block").solution
    values = solution.points.values.copy()
    values[3] = np.nan
    page = report_page(given(replace(solution, points=replace(solution.points, values=values))))
    assert [match for match in DRAWING.findall(page) if "nan" in match] == []


def test_names_are_text() -> None:
    solution = sample("small_frame_block").solution
    hostile = "</script><script>alert(1)</script>&\"'"
    names = (hostile, *solution.points.names[1:])
    renamed = replace(solution, project=hostile, points=replace(solution.points, names=names))
    page = report_page(given(renamed))
    assert "<script>alert" not in page
    assert hostile in "".join(Page(page).words)


def test_gates_blunders_and_models_are_shown() -> None:
    blunder = Blunder(1, "control", "", "CP1", "X", 0.512, 0.031, 16.5, 3.3, "distance D1; photo P1 point 7")
    gate = GateResult(parse_gate("sigma0<=0.5"), 1.0342, passed=False)
    models = (StereoModel("M1", "P101", "P102", 1, 1), StereoModel("M4", "P103", "P104", 3, 2))
    content = given(
        replace(awkward(), status="converged", singular=(), blunders=(blunder,)), gates=(gate,),
        bundle=BundleDefinition("MAIN", models=models),
    )  # fmt: skip
    page = Page(report_page(content))
    words = " ".join("".join(page.words).split())
    assert "Converged, but 1 gate failed" in words
    assert "0 of 1 gate passed: sigma0 <= 0.5 not met" in words
    assert page.table("blunders").rows[0][1:5] == ["control point CP1", "X", "0.512", "0.031"]
    assert page.table("blunders").rows[0][-1] == "distance D1; photo P1 point 7"
    grid = next(table for table in page.tables if table.rows and table.rows[0][0] == "row 1")
    assert grid.rows == [["row 1", "M1P101 – P102", ""], ["row 3", "", "M4P103 – P104"]]


def test_a_block_of_500_photos_and_50000_points_fits_the_limit() -> None:
    page = report_page(large_block(500, 50_000, 6))
    assert len(page.encode()) < MOST_BYTES
    words = " ".join("".join(Page(page).words).split())
    for thinning in (
        "The 2\N{NARROW NO-BREAK SPACE}000 points with the largest standard deviations of 50000 are shown",
        "of 500 drawn: those whose residuals stand out, and at least the 3 with the largest",
        "of 50000 points are drawn",
    ):
        assert thinning.replace("\N{NARROW NO-BREAK SPACE}", " ") in words


def large_block(photos: int, points: int, rays: int) -> ReportInput:
    """Return a block of random figures in national coordinates."""
    random = np.random.default_rng(20)
    photo_names = tuple(f"P{row:04d}" for row in range(photos))
    point_names = tuple(f"{100_000 + row}" for row in range(points))
    corner, extent = np.array([2.6e6, 1.2e6, 400.0]), np.array([1e4, 1e4, 300.0])
    at = corner + extent * random.random((points, 3))
    stations = np.column_stack(
        [corner + extent * random.random((photos, 3)) + (0, 0, 1500), random.normal(size=(photos, 3))]
    )
    n = 2 * points * rays
    residuals = Residuals(
        ("photo",) * n,
        tuple(photo_names[row] for row in np.repeat(random.integers(0, photos, points * rays), 2)),
        tuple(point_names[row] for row in np.repeat(np.arange(points), 2 * rays)),
        ("x", "y") * (points * rays),
        random.uniform(-100.0, 100.0, n), random.normal(0.0, 0.003, n), np.full(n, 0.005), random.random(n),
        np.where(random.random(n) < 0.001, 0.1, 1.0), random.uniform(0.1, 0.9, n), random.random(n),
    )  # fmt: skip
    solution = replace(
        awkward(),
        cameras=Estimates(("CAMERA",), np.array([[150.0, *(0.0,) * 12]]), np.full((1, 13), np.nan)),
        projections=("perspective",),
        photos=Estimates(photo_names, stations, random.uniform(0.01, 0.2, (photos, 6))),
        points=Estimates(point_names, at, random.uniform(0.01, 0.2, (points, 3))),
        point_rays=np.full(points, rays),
        point_kinds=("control",) * 200 + ("tie",) * (points - 200),
        residuals=residuals, check_points=(), additional=(), correlations=(),
        photo_rotation_sd_about_axes=(False,) * photos,
        photo_correlations=random.uniform(-0.9, 0.9, (photos, 15)),
        point_correlations=random.uniform(-0.9, 0.9, (points, 3)),
    )  # fmt: skip
    camera = Camera("CAMERA", (150.0, *(0.0,) * 12), frame=(230.0, 230.0))
    return given(solution, cameras={"CAMERA": camera}, photos={name: Photo(name, "CAMERA") for name in photo_names})


def test_significance_is_told_where_a_parameter_was_tested() -> None:
    assert "Significant: different from zero" in sample("small_frame_block").page
    assert "Significant" not in sample("dcs260_calibration").page, "C, DX and DY alone are not tested"


def test_a_browser_runs_the_two_scripts_of_the_page_and_no_other() -> None:
    page = report_page(given(rich_solution()))
    policy = html.unescape(re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', page)[1])  # type: ignore[index]
    assert policy.startswith("default-src 'none'; script-src 'sha256-")
    assert "script-src 'unsafe" not in policy
    assert page.index("Content-Security-Policy") < page.index("<style"), "a policy holds for what comes after it"
    (script,) = re.findall(r"<script>(.*?)</script>", page, flags=re.DOTALL)
    allowed = re.findall(r"'sha256-([^']+)'", policy)
    assert allowed == [
        base64.b64encode(hashlib.sha256(text.encode()).digest()).decode() for text in (script, get_plotlyjs())
    ]
