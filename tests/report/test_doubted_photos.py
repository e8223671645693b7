"""What the tests of groups found, in the plan and in the table of the groups."""

from __future__ import annotations

import math

import numpy as np
import pytest
from report.sample_pages import sample

from orip.records.camera import Camera
from orip.records.definition import BundleDefinition
from orip.records.names import record_key
from orip.records.photo import Photo
from orip.records.results.tests import GroupTest, VarianceComponent
from orip.report.control_points import group_table
from orip.report.drawings.block_plan import block_plan
from orip.report.drawings.block_view import doubted_photos
from orip.report.report_input import ReportInput
from orip.structs import replace

LEFT = ("101", "103", "201")


def given(*, doubted: bool, of: str = "LEFT") -> ReportInput:
    """Return the small block as if some photos were of a camera of their own, whose photo points are doubted or not."""
    solution = sample("small_frame_block").solution
    nan = math.nan
    group = GroupTest("photo", of, "x", 100, 0, 80.0, 2.0, 1e-9, nan, nan, nan, nan, nan, "", nan, nan, doubted)
    parameters = tuple(solution.cameras.values[0])
    cameras = {name: Camera(name, parameters, frame=(36.0, 24.0)) for name in ("LEFT", "RIGHT")}
    solution = replace(
        solution,
        cameras=replace(
            solution.cameras, names=("LEFT", "RIGHT"), values=np.repeat(solution.cameras.values[:1], 2, axis=0),
            sd=np.repeat(solution.cameras.sd[:1], 2, axis=0),
        ),
    )  # fmt: skip
    photos = {
        record_key(name): Photo(name, "LEFT" if name in LEFT or of != "LEFT" else "RIGHT")
        for name in solution.photos.names
    }
    return ReportInput(replace(solution, groups=(group,)), (), BundleDefinition("MAIN"), cameras, photos)


def test_photos_of_a_doubted_camera_are_ringed_in_the_plan() -> None:
    assert sorted(doubted_photos(given(doubted=True))) == sorted(LEFT)
    plan = block_plan(given(doubted=True))
    assert plan is not None
    assert plan.picture.count('class="doubted"') == len(LEFT)
    assert "<title>photo 101: " in plan.picture
    assert "Rings: photos whose strip or camera contradicts the others" in plan.note


def test_nothing_is_ringed_without_a_finding_or_where_it_is_about_all_photos() -> None:
    for found in (given(doubted=False), given(doubted=True, of="OTHER")):
        assert not doubted_photos(found)
        plan = block_plan(found)
        assert plan is not None
        assert 'class="doubted"' not in plan.picture
        assert "Rings" not in plan.note


@pytest.mark.parametrize(
    ("of", "component", "shown"), [("LEFT", "xy", "2.0 ± 0.15"), ("", "", "2.0 ± 0.15"), ("RIGHT", "xy", "–")]
)
def test_estimated_errors_stand_beside_the_tests(of: str, component: str, shown: str) -> None:
    """x and y of a camera's photo points have one estimate, as have the stations of all strips."""
    solution = given(doubted=True).solution
    estimate = VarianceComponent("photo", of, component, 100, 80.0, 1.96, 0.15, 1e-9)
    table = group_table(replace(solution, variance_components=(estimate,)))
    assert table is not None
    (column,) = [column for column in table.columns if column.heading == "Estimated / given error"]
    assert column.cells[0].startswith(shown)
    without = group_table(solution)
    assert without is not None
    assert "Estimated / given error" not in [column.heading for column in without.columns]
