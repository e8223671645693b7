"""Digitised fiducial marks: origin in their mean, x axis by the rule for corners and for midsides."""

from __future__ import annotations

import numpy as np
import pytest

from orip.interior.mounting import fiducials_from_plate
from orip.records.measurement import MeasuredMarks

CORNERS = {"ll": (-12.0, -18.0), "lr": (12.0, -18.0), "ur": (12.0, 18.0), "ul": (-12.0, 18.0)}
MIDSIDES = {"left": (-12.0, 0.0), "bottom": (0.0, -18.0), "right": (12.0, 0.0), "top": (0.0, 18.0)}


def digitised(marks, degrees=0.0, shift=(0.0, 0.0)):
    turn = np.radians(degrees)
    matrix = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    xy = np.array(list(marks.values()), dtype=float).reshape(-1, 2) @ matrix.T + shift
    count = len(marks)
    return MeasuredMarks(tuple(marks), xy, np.zeros(count, dtype=bool), np.full((count, 2), np.nan))


def found(marks, arrangement):
    return {mark.name: (mark.x, mark.y) for mark in fiducials_from_plate(marks, arrangement)}


@pytest.mark.parametrize("degrees", [0.0, 3.0, -20.0, 40.0, -44.0])
@pytest.mark.parametrize(("arrangement", "marks"), [("corners", CORNERS), ("midsides", MIDSIDES)])
def test_frame_that_lies_turned_and_shifted_on_the_stage(arrangement, marks, degrees):
    # an upright 24 x 36 frame turned by 40 degrees has its long axis furthest out in x, but not nearest to x
    result = found(digitised(marks, degrees, (103.0, 57.0)), arrangement)
    for name, xy in marks.items():
        assert result[name] == pytest.approx(xy, abs=1e-12)


def test_order_of_digitising_does_not_count():
    upside_down = dict(reversed(CORNERS.items()))
    assert found(digitised(upside_down, 5.0), "corners")["ur"] == pytest.approx((12.0, 18.0), abs=1e-12)


def test_frame_that_lies_on_its_side_has_its_x_axis_along_the_stage():
    result = found(digitised(MIDSIDES, 90.0), "midsides")
    assert result["bottom"] == pytest.approx((18.0, 0.0), abs=1e-12)
    assert result["left"] == pytest.approx((0.0, -12.0), abs=1e-12)


def test_irregular_corners_have_their_x_axis_through_the_middles_of_left_and_right_side():
    marks = {"ll": (-10.0, -10.0), "lr": (10.0, -11.0), "ur": (10.0, 9.0), "ul": (-10.0, 12.0)}
    result = found(digitised(marks), "corners")
    assert np.mean(list(result.values()), axis=0) == pytest.approx((0.0, 0.0), abs=1e-12)
    left = np.mean([result["ll"], result["ul"]], axis=0)
    right = np.mean([result["lr"], result["ur"]], axis=0)
    assert left[1] == pytest.approx(right[1], abs=1e-12)


def test_irregular_midsides_have_two_marks_on_a_parallel_of_the_x_axis():
    marks = {"left": (-12.0, 0.3), "bottom": (0.5, -18.0), "right": (12.0, -0.2), "top": (-0.4, 18.5)}
    result = found(digitised(marks), "midsides")
    assert result["left"][1] == pytest.approx(result["right"][1], abs=1e-12)
    assert result["left"][0] < result["right"][0]


RESEAU = {f"r{row}{column}": (6.0 * column, 6.0 * row) for row in range(-3, 4) for column in range(-2, 3)}


@pytest.mark.parametrize("degrees", [0.0, 3.0, -19.0])
@pytest.mark.parametrize(
    ("arrangement", "marks"),
    [
        ("corners", {**CORNERS, **MIDSIDES}),
        ("midsides", {**CORNERS, **MIDSIDES}),
        ("corners", RESEAU),
        ("midsides", {**MIDSIDES, "inner": (-6.0, 0.0), "centre": (0.0, 0.0), "lower": (0.0, -9.0)}),
    ],
)
def test_more_than_four_marks_and_reseau_crosses(arrangement, marks, degrees):
    result = found(digitised(marks, degrees, (103.0, 57.0)), arrangement)
    assert list(result) == list(marks)
    for name, xy in marks.items():
        assert result[name] == pytest.approx(xy, abs=1e-12)


def test_more_marks_do_not_move_the_system_of_the_four():
    moved = {**CORNERS, "extra": (3.0, -7.0), "off": (0.1, 17.0)}
    result = found(digitised(moved), "corners")
    assert result == {name: pytest.approx(xy, abs=1e-12) for name, xy in moved.items()}


def test_marks_of_which_none_is_in_a_corner_are_refused():
    with pytest.raises(ValueError, match="none of the marks lie in the four corners"):
        fiducials_from_plate(digitised({str(column): (column, 0.0) for column in range(5)}), "corners")


@pytest.mark.parametrize("count", [0, 3])
def test_fewer_than_four_marks_are_refused(count):
    marks = {str(number): (float(number), number**2 / 2.0) for number in range(count)}
    with pytest.raises(ValueError, match=f"{count} marks; at least four"):
        fiducials_from_plate(digitised(marks), "corners")


def test_disregarded_mark_is_not_one_of_the_four():
    marks = digitised({**CORNERS, "wrong": (50.0, 50.0)})
    marks.disregarded[4] = True
    assert set(found(marks, "corners")) == set(CORNERS)


@pytest.mark.parametrize("arrangement", ["corners", "midsides"])
def test_four_marks_in_one_place_are_refused(arrangement):
    with pytest.raises(ValueError, match="around their mean"):
        fiducials_from_plate(digitised(dict.fromkeys("abcd", (7.1, 7.1))), arrangement)
