"""The pages for those who know OLTRIS or the automated mapping system: what each row says is tested somewhere."""

from __future__ import annotations

import ast
import re
from functools import cache
from pathlib import Path

import pytest
from documentation.pages import DOCS

TESTS = Path(__file__).parents[1]
_STARTING, _SESSIONS = "online/test_starting_cases.py", "online/test_simulated_sessions.py"
_GIVEN, _KINDS = "online/test_given_observations.py", "sequential/test_kinds_of_observation.py"
_FORMS, _GUBAIO = "cli/adjust/test_results_in_other_forms.py", "exchange/test_gubaio.py"

ROWS: dict[str, dict[str, str]] = {
    "oltris.md": {
        "5.1.1 Space resection, area of the points": f"{_STARTING}::test_with_control_photos_wait_for_known_points",
        "5.1.2 Relative orientation": f"{_STARTING}::test_with_nothing_the_block_lies_in_a_system_of_its_own",
        "5.1.3 Spatial intersection":
            f"{_STARTING}::test_with_orientations_alone_points_are_intersected_by_their_first_two_rays",
        "5.1.5 Strategy of initial values":
            "online/test_local_system.py::"
            "test_without_control_all_is_oriented_and_tested_and_control_takes_it_to_the_ground",
        "5.2.1 Simultaneous adjustment": f"{_KINDS}::test_square_sum_and_redundancy_are_those_of_the_adjustment",
        "5.2.2 Sequential adjustment":
            "sequential/test_random_sessions.py::test_triangle_and_leftovers_of_a_random_session",
        "5.3.1 Blunder detection and location": f"{_SESSIONS}::test_two_blunders_in_two_strips_of_three_photos",
        "5.3.2 Systematic errors": "bundle/kinds/test_additional_sets.py",
        "7.2 Iteration criterion":
            "bundle/test_stop_criteria.py::test_a_strict_limit_makes_more_iterations_and_a_lax_one_none",
        "7.3 Measurement and data processing": "cli/test_online_command.py::test_each_line_is_answered_by_a_line",
        "7.3 Tie points or control alone": "workflow/digitise/test_digitise.py::test_control_or_tie_points_alone",
        "7.6 Blocks of the report": f"{_SESSIONS}::test_three_blunders_in_a_block_like_the_simplon",
        "SD 3.4 FC_INCLUDE": f"{_GIVEN}::test_the_state_is_that_of_an_adjustment_without_it_and_with_it",
        "SD 3.5 FC_EXCLUDE": f"{_SESSIONS}::test_excluded_and_included_again",
        "SD 4.4 IN_OBSERV": "cli/test_online_command.py",
        "SD 6.3 UPDATE": f"{_GIVEN}::test_the_state_is_that_of_an_adjustment_without_it_and_with_it",
        "SD 7.1 GEN_STAT": f"{_KINDS}::test_redundancy_numbers_are_those_of_the_adjustment",
        "SD 7.3 AP_SIGNIF, SD 7.4 AP_DETERM": "bundle/test_prune.py",
        "SD 8.1 RE_DISPLAY, photo points": f"{_GIVEN}::test_photo_points_are_shown_in_the_order_of_measuring",
        "SD 8.1 RE_DISPLAY, control and stations":
            f"{_GIVEN}::test_what_is_given_is_shown_with_the_figures_of_the_adjustment",
        "SD 8.1 RE_DISPLAY, photos and points":
            "online/test_deviations.py::test_standard_deviations_are_those_of_the_adjustment",
        "SD 8.2 RE_PRINT": "files/test_listings.py",
        "SD 8.3 RE_STORE, ST_NORMAL": f"{_FORMS}::test_the_inverse_of_the_normal_equations_has_the_cofactors",
    },
    "automated-mapping.md": {
        "2.3, Appendix A: files of GUBAIO, DIGITAL": f"{_GUBAIO}::test_the_second_example_of_the_thesis_is_read",
        "Appendix A: SCAN and FRAME with fiducial marks (RC30)":
            f"{_GUBAIO}::test_points_on_film_are_millimetres_from_the_fiducial_centre",
        "3.1 Calibration of the imaging sensor": "samples/test_dcs260.py::test_the_calibration",
        "3.2.2 Exposure time recording":
            "trajectory/test_exposures.py::test_events_on_a_trajectory_have_its_place_and_the_camera_its_offset",
        "3.3 Flight planning": "planning/test_flight_geometry.py::test_a_film_camera_at_one_to_eight_thousand",
        "3.4.4 Coordinate frames": "geometry/test_frames.py::test_local_level_coordinates_are_those_of_proj",
        "4.1 Processing of GPS data": "trajectory/test_gnss.py::test_a_baseline_that_stands",
        "4.2 Processing of IMU data, 4.3 Kalman filtering":
            "trajectory/test_imu.py::test_without_errors_the_truth_is_found",
        "5.1.1 Image observation equation": "partials/test_partials.py",
        "5.1.2 Direct observation equation": "bundle/kinds/test_elements.py",
        "5.2.1 Cholesky factorisation, 5.2.3 storage": "bundle/test_banded_block.py",
        "5.2.2 Analysis of the result": "adjustment/test_precision.py",
        "5.2.4 Decorrelation of correlated observations":
            "bundle/kinds/test_correlated_control.py::test_the_solution_is_that_of_generalised_least_squares",
        "6.1 Terrestrial angles": f"{_FORMS}::test_rotations_by_other_angles_are_the_same_rotations",
        "6.1 Angles in degrees, gon, radians": "workflow/test_angle_units.py::test_results_are_those_of_degrees",
        "6.1.3 Zurich City Hall": "samples/test_zurich.py::test_photos",
    },
}  # fmt: skip


def rows(page: str) -> dict[str, str]:
    text = (DOCS / page).read_text(encoding="utf-8")
    found = dict(re.findall(r"^\| (.+?) \| (.+) \|$", text, re.MULTILINE))
    del found["function"]
    return found


@cache
def names_of_tests(module: str) -> frozenset[str]:
    tree = ast.parse((TESTS / module).read_text(encoding="utf-8"))
    return frozenset(node.name for node in tree.body if isinstance(node, ast.FunctionDef))


@pytest.mark.parametrize("page", ROWS)
def test_every_row_has_a_test(page: str) -> None:
    answers, tests = rows(page), ROWS[page]
    assert list(answers) == list(tests)
    for row, test in tests.items():
        module, _, name = test.partition("::")
        if name:
            assert name in names_of_tests(module), (row, test)
        else:
            assert names_of_tests(module), (row, test)
