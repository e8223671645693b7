"""Charts: curves are where their numbers are, ticks are round."""

from __future__ import annotations

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from orip.report.drawings.svg import ChartFrame, Curve, line_chart, number, numbers, round_step, ticks
from orip.report.table import decimals_of_most, fixed, parameter, significant


def curve(chart: str) -> np.ndarray:
    """Return the pixels of the first curve of a chart."""
    path = re.search(r'<path d="M([^"]*)" class="curve', chart)
    assert path is not None
    return np.array([tuple(map(float, pair.split())) for pair in path[1].split("L")])


@given(st.lists(st.one_of(st.floats(), st.integers(-30000, 30000).map(lambda whole: whole / 100.0))))
def test_many_coordinates_are_written_as_one_by_one(values: list[float]) -> None:
    assert numbers(values) == [number(value) for value in values]


def test_a_curve_is_an_affine_image_of_its_numbers() -> None:
    points = [(1.0, -0.43), (2.0, -0.62), (3.0, 0.59), (4.0, 4.92)]
    pixels = curve(line_chart("ENP", ChartFrame("iteration", "ENP"), [Curve(points, "ENP", "first")]))
    for axis in (0, 1):
        numbers = np.array(points)[:, axis]
        slope, shift = np.polyfit(numbers, pixels[:, axis], 1)
        # pixels are written to a hundredth
        np.testing.assert_allclose(slope * numbers + shift, pixels[:, axis], atol=0.02)
        assert slope * (1, -1)[axis] > 0.0, "to the right, and up"


def test_a_logarithmic_curve_is_one_of_logarithms() -> None:
    points = [(1.0, 400.0), (2.0, 20.0), (3.0, 1.0)]
    pixels = curve(
        line_chart("sigma0", ChartFrame("iteration", "sigma0", logarithmic=True), [Curve(points, "", "first")])
    )
    logarithms = np.log10([400.0, 20.0, 1.0])
    slope, shift = np.polyfit(logarithms, pixels[:, 1], 1)
    np.testing.assert_allclose(slope * logarithms + shift, pixels[:, 1], atol=0.02)


def test_nothing_to_draw_is_no_drawing() -> None:
    assert line_chart("", ChartFrame("", ""), [Curve([(1.0, float("nan"))], "", "")]) == ""


@given(st.floats(-1e7, 1e7), st.floats(1e-6, 1e7))
def test_ticks_are_within_and_not_too_many(low: float, span: float) -> None:
    found = ticks(low, low + span)
    step = round_step(span, 5)
    assert len(found) <= 7
    assert all(low - 1e-6 * step <= tick + 1e-6 * step <= low + span + 2e-6 * step + 1e-9 * abs(low) for tick in found)


@pytest.mark.parametrize(
    ("value", "sd", "shown"),
    [
        (35.3607417989572, 0.06042806095418367, ("35.361", "0.060")),
        (-3.101098748351471e-05, 7.258188286360794e-07, ("-3.10e-05", "7.3e-07")),
        (8.595, float("nan"), ("8.595", "constant")),
        (0.0, float("inf"), ("0", "not determined")),
    ],
)
def test_parameters_have_the_digits_that_their_sd_supports(value: float, sd: float, shown: tuple[str, str]) -> None:
    assert parameter(value, sd) == shown


def test_numbers_in_words_and_digits() -> None:
    assert decimals_of_most([0.012, 0.03, float("nan"), float("inf"), 0.0]) == 3
    assert fixed(-0.0001, 2) == "0.00"
    assert [significant(value) for value in (14.3015, 0.00812, 0.0, 4e-7, float("nan"))] == [
        "14.3", "0.00812", "0", "4e-07", "–",
    ]  # fmt: skip
