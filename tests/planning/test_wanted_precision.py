"""The height from which points get a standard deviation that is wanted."""

from __future__ import annotations

import math

import pytest
from cli.command_line import orip
from planning.test_plan_commands import project

from orip.errors import InputError
from orip.planning.forecast import height_for


@pytest.mark.parametrize("first", [0.5, 40.0, 9000.0])
def test_closed_form(first):
    # photos of base 0.3 h, one pixel of 0.25 mrad: proportional to the height, beside 8 mm of the positions
    found = height_for(0.02, first, lambda height: math.hypot(0.008, 1.2e-3 * height), "m")
    exact = math.sqrt(0.02**2 - 0.008**2) / 1.2e-3
    assert 0.98 * exact <= found <= exact


def test_steps_of_a_plan_are_no_hindrance():
    # the number of strips changes by whole ones
    found = height_for(0.02, 30.0, lambda height: 2e-4 * height * (1.0 + 0.05 * (int(height) % 2)), "m")
    assert 2e-4 * found <= 0.02
    assert found >= 80.0


def test_heights_at_which_nothing_is_determined_are_left():
    found = height_for(0.02, 500.0, lambda height: 1e-4 * height if height < 300.0 else math.inf, "m")
    assert found == pytest.approx(200.0, rel=0.01)


def test_what_cannot_be_reached_is_said():
    with pytest.raises(InputError, match=r"sd = 0\.005 is not reached: .* get 0\.008\d* m from .*position_error"):
        height_for(0.005, 40.0, lambda height: math.hypot(0.008, 1e-4 * height), "m")


def test_a_flight_is_planned_for_it(tmp_path):
    folder = project(tmp_path / "p", pixel="", sd="0.03", tie_points="15", cross_strips="2", cross_height="1.2")
    made = orip(folder, "plan", "make", "--json").document
    found = orip(folder, "plan", "forecast", "--json").document["point_sd_median"][2]
    assert 0.029 <= found <= 0.03
    assert made["height"] > 0.0
    refused = orip(project(tmp_path / "q", sd="0.03"), "plan", "make")
    assert refused.code != 0
    assert "sd is for flights, and gives the height itself" in refused.err


def test_a_flight_that_does_not_determine_the_camera_has_no_height(tmp_path):
    """Heights of nadir strips over level ground hang on C: a forecast as if it were known would promise too much."""
    folder = project(tmp_path / "p", pixel="", sd="0.03", tie_points="15")
    refused = orip(folder, "plan", "make")
    assert "nothing determines C of the camera" in refused.err
    compared = orip(project(tmp_path / "q", tie_points="15"), "plan", "compare", "--variant", "unknown=none").out
    assert "as planned: nothing determines C; its row is as if C were known" in compared
    assert "unknown=none: nothing" not in compared
