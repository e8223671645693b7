"""Every partial against a numerical derivative, and a case for every function that returns partials."""

from __future__ import annotations

import cases
import numpy as np
import pytest
from inspection import functions_with_partials

from orip.structs import replace

TOLERANCE = 1e-7
"""Of the largest partial of a column.

Two central differences with steps h and h/2 are extrapolated to h = 0, which leaves an error of the fourth order: with
steps of a thousandth of what bends the function, 1e-12 of the derivative. Rounding leaves 1e-9 of it: coordinates of
some thousand metres are rounded to 1e-12, and steps move the values by 1e-3. Any wrong sign, factor or missing term of
the coefficients used here is off by 1e-5 or more.
"""

NOTHING = 5e-14
"""What sums of products of sines and cosines leave of a partial that is zero."""

LONGEST_STEP = 0.05
"""Of a variable without influence, in units of the variable."""


def steps(case: cases.Case) -> np.ndarray:
    """Return how far each variable is moved."""
    largest = np.abs(case.partials).max(axis=0)
    small = largest * LONGEST_STEP <= case.move
    return np.where(small, max(LONGEST_STEP, case.move), case.move / np.where(small, 1.0, largest))


def moved_together(partials: np.ndarray) -> list[np.ndarray]:
    """Return variables in groups, of which no two have a partial in one row: all of a group are moved at once.

    Curtis, Powell and Reid (1974). A partial that a function takes for zero, and is not, shows in the row of another
    variable, or in one that none of the group has. Those without any partial are a group of their own.
    """
    pattern = partials != 0.0
    groups: list[tuple[np.ndarray, list[int]]] = []
    for column in np.flatnonzero(pattern.any(axis=0)).tolist():
        for rows, members in groups:
            if not (rows & pattern[:, column]).any():
                np.logical_or(rows, pattern[:, column], out=rows)
                members.append(column)
                break
        else:
            groups.append((pattern[:, column].copy(), [column]))
    without = np.flatnonzero(~pattern.any(axis=0))
    return [*(np.array(members) for _, members in groups), *([without] if len(without) else [])]


def numerical_changes(case: cases.Case, change: np.ndarray) -> np.ndarray:
    """Return the derivative of all values along a change of the variables."""

    def central(part: float) -> np.ndarray:
        return (case.value(case.at + part * change) - case.value(case.at - part * change)) / (2.0 * part)

    return (4.0 * central(0.5) - central(1.0)) / 3.0


@pytest.mark.parametrize("group", cases.GROUPS)
def test_partials_are_those_of_central_differences(group):
    for case in cases.cases_of(group):
        assert_central_differences(case)


def assert_central_differences(case: cases.Case) -> None:
    step = steps(case)
    for members in moved_together(case.partials):
        change = np.zeros_like(case.at)
        change[members] = step[members]
        worst = np.abs(numerical_changes(case, change) - case.partials @ change)
        allowed = np.abs(case.partials[:, members]).max(axis=0) * step[members]
        of_row = np.where(case.partials[:, members] != 0.0, allowed, 0.0).max(axis=1)
        allowed = TOLERANCE * np.where(of_row > 0.0, of_row, allowed.max()) + NOTHING * step[members].max()
        allowed += case.rounding
        assert (worst <= allowed).all(), f"{case}, variables {members.tolist()}: off by {worst.max():.1e}"


def test_a_wrong_partial_is_found_among_variables_that_are_moved_together():
    case = next(case for case in cases.all_cases() if len(moved_together(case.partials)) < len(case.at) / 3)
    for change in (1e-5, -1.0):
        row, column = np.argwhere(case.partials != 0.0)[7]
        wrong = case.partials.copy()
        wrong[row, column] *= 1.0 + change
        with pytest.raises(AssertionError, match="off by"):
            assert_central_differences(replace(case, partials=wrong))


PART_OF = {
    "orip.bundle.additions.candidates.photo_candidates": "linearise_with_partials of photo points, as candidates' rows",
    "orip.bundle.kinds.figure.FigureObservations._along_axes": "linearise_with_partials of lines, planes and cylinders",
    "orip.bundle.kinds.distance.DistanceObservations._coordinates": "linearise_with_partials of distances",
    "orip.bundle.kinds.element._centre_values": "linearise_with_partials of elements",
    "orip.bundle.kinds.element._point_values": "linearise_with_partials of elements",
    "orip.bundle.kinds.station_attitude.rotation_residuals_with_partials": "linearise_with_partials of elements",
    "orip.bundle.kinds.station_difference.DifferenceObservations._turns": "linearise_with_partials of differences",
    "orip.bundle.antenna_positions.antenna_positions_with_partials": "linearise_with_partials of stations",
    "orip.bundle.kinds.photo_point._chained": "linearise_with_partials of photo points",
    "orip.bundle.kinds.observation.partials_by_unknowns": "linearise_with_partials of all kinds, in a block of a rig",
    "orip.bundle.rigs.starting.RigState.photos": "photos_with_partials",
    "orip.bundle.rigs.starting.chained": "linearise_with_partials of all kinds, in a block of a rig",
    "orip.bundle.rigs.starting.partials_of_photos": "photos_with_partials",
    "orip.bundle.kinds.photo_point.PhotoPointObservations.moving_image": "linearise_with_partials of photo points",
    "orip.bundle.state.BlockState.partials_of_rigs": "photos_with_partials",
    "orip.geometry.perspective.chained": "perspective_with_partials and equidistant_with_partials",
    "orip.geometry.rolling_shutter._turn_by_vector": "moving_image_with_partials",
    "orip.geometry.ground_frame.GroundFrame._by_place": "project_with_partials of a frame",
    "orip.geometry.ground_frame.GroundFrame._partials": "project_with_partials of a frame",
    "orip.interior.image_coordinates._formula": "ImageEquation.explicit_with_partials",
}
"""Functions whose partials go into those of another one that has a case, and nowhere else unchanged."""

GIVES_NONE = {
    "orip.bundle.compiled.loop_pattern.cameras_of_loop": "constants of the cameras, with factors of their parameters",
    "orip.bundle.compiled.photo_loop.PhotoPointLoop._observations": "arguments of the compiled loops",
    "orip.bundle.compiled.photo_loop.rows_of_blocks": "rows of the coupling, of linearise_with_partials",
    "orip.bundle.points.other_places.rays_at_places": "linearise_with_partials of photo points, over their errors",
    "orip.bundle.points.other_places.RaysAtPlaces._by_reduced": "some of the columns, unchanged",
    "orip.bundle.points.other_places.RaysAtPlaces.after_least_squares": "places of points",
    "orip.bundle.points.other_places.RaysAtPlaces.other_place": "places, with rows of linearise_with_partials",
    "orip.bundle.points.rival_places._ControlThere.at": "linearise_with_partials of control points, over their errors",
    "orip.bundle.points.rival_places._adjusted": "places of points",
    "orip.bundle.results.covariance._dependence": "partials of rigs, as they are, or a unit matrix",
    "orip.bundle.results.covariance._joined": "partials of several records, side by side",
    "orip.bundle.results.covariance.camera_figures": "unit matrices: camera parameters are shown as they are estimated",
    "orip.bundle.results.covariance.covariance": "covariances",
    "orip.bundle.results.covariance.photo_figures": "project_with_partials and rotation_partials, side by side",
    "orip.bundle.results.covariance.point_figures": "project_with_partials, unchanged",
    "orip.bundle.points.consensus.PointRays.after": "residuals",
    "orip.bundle.points.consensus.PointRays.least_squares": "moves of points",
    "orip.bundle.points.consensus.PointRays.of_pair": "some of the rows, unchanged",
    "orip.bundle.points.consensus.moves_of_points": "moves of points",
    "orip.bundle.points.consensus.with_steady_weights": "moves of points",
    "orip.bundle.points.on_figures.with_points_on_figures": "places of points",
    "orip.bundle.results.ground.photo_correlations": "correlations",
    "orip.bundle.results.further_records._deviations_of_mean": "standard deviations, with relative_poses_with_partials",
    "orip.bundle.results.ground._rotation_deviations": "standard deviations",
    "orip.geometry.ground_frame.GroundFrame.cofactors_to_project": "cofactors",
    "orip.geometry.ground_frame.GroundFrame.axes_at": "rotations, from differences of coordinates",
    "orip.geometry.ground_frame.GroundFrame.jacobian_at": "the partials of project_with_partials, at a known place",
    "orip.geometry.plane.plane_orientations": "orientations",
    "orip.geometry.perspective.Perspective.of": "some of the rows, unchanged",
    "orip.interior.additional_parameters.default_error": "an a-priori error",
    "orip.bundle.groups.held_cameras._by_readout": "those of moving_image_with_partials by the readout, unchanged",
    "orip.bundle.compiled.rig_loop.RigCoupling.movement_sums": "sums, with partials_of_photos",
    "orip.bundle.compiled.rig_loop.RigCoupling.of_blocks": "rows of the coupling, with partials_of_photos",
    "orip.bundle.compiled.rig_loop.RigCoupling.times": "products, with partials_of_photos",
    "orip.bundle.compiled.rig_loop.RigCoupling.transposed_times": "products, with partials_of_photos",
    "orip.bundle.compiled.rig_loop.RigLoop.precision": "cofactors",
    "orip.bundle.results.further_records._figures": "standard deviations",
    "orip.bundle.results.further_records._of_rotations": "standard deviations",
    "orip.bundle.results.further_records.exposure_estimates": "standard deviations",
    "orip.geometry.frames.terrestrial_rates": "angular rates",
    "orip.bundle.known_motions.KnownMotions.at": "velocities and angular rates of photos, held in an iteration",
    "orip.interior.motions._derivatives": "velocities and angular rates of photos, from differences",
    "orip.interior.motions.motions": "velocities and angular rates of photos, from differences",
    "orip.prelim.similarity.start._DampedProblem._linearised": "some of the rows, weighted",
}
"""Functions that use partials of others and return something else, or pass them on as they are."""


def test_completeness():
    missing = functions_with_partials() - {case.of for case in cases.all_cases()} - PART_OF.keys() - GIVES_NONE.keys()
    assert not missing, f"without a case in tests/partials/cases.py: {', '.join(sorted(missing))}"


def test_functions_without_a_case_are_there():
    stale = (PART_OF.keys() | GIVES_NONE.keys()) - functions_with_partials()
    assert not stale, f"not in the program any more, or without partials: {', '.join(sorted(stale))}"
    assert not (PART_OF.keys() | GIVES_NONE.keys()) & {case.of for case in cases.all_cases()}


def test_the_inspection_finds_functions_and_methods_of_any_name():
    found = functions_with_partials()
    assert "orip.geometry.perspective.perspective_with_partials" in found
    assert "orip.bundle.kinds.photo_point.PhotoPointObservations.linearise_with_partials" in found
    assert "orip.geometry.similarity.similarity_with_partials" in found


def test_every_kind_of_observation_occurs_in_a_block():
    counts = np.zeros(len(cases.KINDS), dtype=int)
    for block in cases.blocks().values():
        counts += [len(kind.rows.observed) for kind in cases.observations_of(block)[1]]
    without = [kind.observe.__name__ for kind, count in zip(cases.KINDS, counts, strict=True) if not count]
    assert not without, f"add observations to the blocks of tests/partials/cases.py: {', '.join(without)}"
