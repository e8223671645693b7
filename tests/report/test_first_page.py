"""The first page: what the user gives of the order, the numbers that count, and the drawing of the block."""

from __future__ import annotations

import re

import numpy as np
import pytest
from report.sample_pages import Page, sample

from orip.bundle.results.compared_points import ComparedKind, compared_points
from orip.files.project.reader import parse_project
from orip.records.camera import Camera, Sensor
from orip.records.definition import BundleDefinition, ReportDetails
from orip.records.photo import Photo
from orip.records.results.solution import Estimates, Solution
from orip.report.drawings.block_plan import footprints, photos_over
from orip.report.drawings.block_view import Vertical, side_of_block, vertical
from orip.report.page import report_page
from orip.report.photos import residual_histograms
from orip.report.report_input import ReportInput, photo_scale
from orip.report.table import length_unit
from orip.structs import replace

PROJECT = '[project]\nname = "A"\n'


def given(solution: Solution, **changed: object) -> ReportInput:
    return replace(ReportInput(solution, (), BundleDefinition("MAIN"), {}, {}), **changed)


def words(page: str) -> str:
    return " ".join("".join(Page(page).words).split())


@pytest.mark.parametrize("written", ["2026-05-04", '"4 May 2026"'])
def test_a_date_is_a_date_or_words(written: str) -> None:
    parsed = parse_project(f'{PROJECT}[report]\ndate = {written}\nclient = "Quarry Ltd"\n')
    assert parsed.value is not None
    assert parsed.value.definition.report == ReportDetails(client="Quarry Ltd", date=written.strip('"'))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('clent = "A"', "[report] has the unknown key 'clent'; did you mean 'client'?"),
        ("client = 7", "client of [report] is 7, but a text in quotes is required"),
        ("date = 12.5", "date of [report] is 12.5, but only a date such as 2026-05-04 or a text is allowed"),
        ('title = "two\\nlines"', "but only a text on one line is allowed"),
        ('remarks = "one"', "but a list in brackets is required"),
    ],
)
def test_what_is_wrong_in_the_table_is_named_with_its_line(line: str, message: str) -> None:
    (complaint,) = parse_project(f"{PROJECT}[report]\n{line}\n").complaints
    assert message in complaint.message
    assert complaint.line == 4


def test_the_order_is_on_the_page_as_text() -> None:
    details = ReportDetails(title="<b>Quarry</b>", client="Kalk & Co", date="2026-05-04", remarks=("Set out by us.",))
    page = report_page(given(sample("small_frame_block").solution, details=details, crs="EPSG:25832"))
    assert "<b>Quarry" not in page
    for wanted in (
        "<b>Quarry</b> bundle MAIN",
        "Client Kalk & Co",
        "Date 2026-05-04",
        "Set out by us.",
        "EPSG:25832, m",
    ):
        assert wanted in words(page).replace("ClientKalk", "Client Kalk").replace("Date2026", "Date 2026")


@pytest.mark.parametrize("kind", ["control", "check"])
def test_control_and_check_points_of_the_page_are_the_residuals_of_the_result(kind: ComparedKind) -> None:
    found = sample("small_frame_block")
    first = {"control": "CP1", "check": "CK1"}[kind]
    page = Page(found.page)
    table = next(table for table in page.tables if table.rows and table.rows[0][0] == first and table.foot)
    points = compared_points(found.solution, kind)
    residuals = found.solution.residuals
    for row, name, sd in zip(table.rows, points.names, points.sd, strict=True):
        mine = [
            value
            for own, point, value in zip(residuals.kind, residuals.point, residuals.residual.tolist(), strict=True)
            if own == "control" and point == name
        ]
        assert row[0] == name
        # millimetres with one decimal
        assert [float(cell) for cell in row[2:5]] == pytest.approx(1e3 * np.array(mine), abs=0.05 + 1e-9)
        assert [float(cell) for cell in row[5:8]] == pytest.approx(1e3 * sd, abs=0.05 + 1e-9)
        assert row[8] == "20.0"
    rms = np.sqrt(np.mean(points.difference**2, axis=0))
    assert table.foot[0][0] == "RMS"
    assert [float(cell) for cell in table.foot[0][2:5]] == pytest.approx(1e3 * rms, abs=0.05 + 1e-9)


def test_w_of_a_check_point_is_its_difference_over_the_errors_of_both_coordinates() -> None:
    points = compared_points(sample("small_frame_block").solution, "check")
    assert points.names == ("CK1", "CK2", "CK3")
    np.testing.assert_allclose(points.w, np.abs(points.difference) / np.sqrt(points.sd**2 + 0.02**2))
    assert not points.doubted.any()


def test_image_residuals_are_those_of_all_rays_of_a_point() -> None:
    solution = sample("small_frame_block").solution
    residuals = solution.residuals
    points = compared_points(solution, "control")
    for name, size in zip(points.names, points.image, strict=True):
        mine = [
            value
            for kind, point, value in zip(residuals.kind, residuals.point, residuals.residual.tolist(), strict=True)
            if kind == "photo" and point == name
        ]
        assert size == pytest.approx(np.sqrt(np.mean(np.square(mine))))


@pytest.mark.parametrize(
    ("sizes", "ground_unit", "name", "text"),
    [
        ([0.0134, 0.021], "m", "mm", "13.4 mm"),
        ([1.34, 0.5], "m", "m", "1.34 m"),
        ([0.004], "mm", "µm", "4.00 µm"),
        ([0.0134], "foot", "foot", "0.0134 foot"),
        ([np.nan, 0.0], "m", "m", "– m"),
    ],
)
def test_lengths_have_the_unit_that_keeps_two_or_three_figures(
    sizes: list[float], ground_unit: str, name: str, text: str
) -> None:
    unit = length_unit(sizes, ground_unit)
    assert unit.name == name
    assert unit.of(sizes[0]) == text.replace("– m", "–")


def two_photos_from_above(base: Solution) -> ReportInput:
    """Return photos 100 above four points; c is 50 mm, a pixel 0.005 mm, the frame 40 by 30 mm."""
    ground = np.array([[0.0, 0, 0], [10, 0, 0], [0, 10, 0], [10, 10, 0]])
    centres = np.array([[0.0, 0, 100, 0, 0, 0], [10, 0, 100, 0, 0, 90.0]])
    camera = Camera("C", (50.0, *(0.0,) * 12), sensor=Sensor(8000, 6000, 40.0, 30.0))
    names, photos = ("1", "2", "3", "4"), ("P1", "P2")
    n = 16
    residuals = replace(
        base.residuals, kind=("photo",) * n, photo=tuple(name for name in photos for _ in range(8)),
        point=tuple(name for _ in photos for name in names for _ in "xy"), component=("x", "y") * 8,
        **{name: np.zeros(n) for name in ("observed", "residual", "standard_residual", "w")},
        **{name: np.ones(n) for name in ("a_priori", "weight_factor", "redundancy_number")},
    )  # fmt: skip
    solution = replace(
        base, photos=Estimates(photos, centres, np.full((2, 6), 0.01)),
        points=Estimates(names, ground, np.full((4, 3), 0.01)),
        cameras=Estimates(("C",), np.array([camera.parameters]), np.full((1, 13), np.nan)), residuals=residuals,
        point_kinds=("tie",) * 4, point_rays=np.full(4, 2),
    )  # fmt: skip
    return given(solution, cameras={"C": camera}, photos={name: Photo(name, "C") for name in photos})


def test_scale_pixel_and_footprint_of_photos_from_above() -> None:
    block = two_photos_from_above(sample("small_frame_block").solution)
    scale = photo_scale(block)
    np.testing.assert_allclose(scale.depth, 100.0)
    np.testing.assert_allclose(scale.pixel_on_object, 0.005 * 100.0 / 50.0)
    np.testing.assert_allclose(scale.axes, [[0, 0, -1]] * 2, atol=1e-15)
    corners = footprints(block)
    # 40 by 30 mm at 1 : 2000 are 80 by 60; the second photo is turned by 90 degrees
    np.testing.assert_allclose(np.ptp(corners, axis=1), [[80, 60, 0], [60, 80, 0]], atol=1e-9)
    np.testing.assert_allclose(corners.mean(axis=1), [[0, 0, 0], [10, 0, 0]], atol=1e-9)


def test_overlap_counts_the_photos_over_a_place() -> None:
    square = np.array([[0.0, 0], [2, 0], [2, 2], [0, 2]])
    places = np.array([[0.5, 0.5], [1.5, 1.5], [2.5, 2.5], [3.5, 0.5]])
    assert photos_over(places, np.stack([square, square[::-1] + 1.0])).tolist() == [1, 2, 1, 0]


def test_up_is_the_normal_of_the_photos_where_no_coordinates_were_given() -> None:
    block = two_photos_from_above(sample("small_frame_block").solution)
    assert vertical(block).axes.tolist() == np.eye(3).tolist()
    angle = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    tilted = np.array([0.0, 0.6, 0.8])
    flat = np.stack([np.cos(angle), 0.8 * np.sin(angle), -0.6 * np.sin(angle)], axis=1)
    photos = np.concatenate([5.0 * tilted + 10.0 * flat, np.zeros((8, 3))], axis=1)
    free = replace(
        block, bundle=BundleDefinition("MAIN", datum="free"),
        solution=replace(
            block.solution, photos=Estimates(tuple("ABCDEFGH"), photos, photos),
            points=Estimates(block.solution.points.names, flat[::2], flat[::2]),
        ),
    )  # fmt: skip
    found = vertical(free)
    np.testing.assert_allclose(found.axes[2], tilted, atol=1e-12)
    np.testing.assert_allclose(found.axes @ found.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(found.axes) == pytest.approx(1.0)
    assert "mean plane of the projection centres" in found.note


def test_normalised_residuals_of_the_histogram_have_the_signs_of_the_residuals() -> None:
    solution = sample("small_frame_block").solution
    (of_w, _) = residual_histograms(solution)
    lefts = [float(x) for x in re.findall(r'<rect x="([-\d.]+)"', of_w)]
    middle = 52.0 + (460.0 - 52.0 - 12.0) / 2.0
    below = sum(left < middle - 1.0 for left in lefts)
    assert 0.3 * len(lefts) < below < 0.7 * len(lefts)


def test_a_block_of_level_photos_is_drawn_from_the_front() -> None:
    up = Vertical(np.eye(3))
    front = side_of_block(up, np.array([[0.1, 1.0, 0.05], [-0.1, 1.0, -0.05]]))
    np.testing.assert_allclose(front.axes, [[1, 0, 0], [0, 0, 1], [0, -1, 0]], atol=1e-12)
    assert front.names == ("X", "Z")
    assert side_of_block(up, np.array([[0.0, 0.1, -1.0]])).names == ("X", "Y")
