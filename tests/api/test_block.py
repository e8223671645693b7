"""Blocks from arrays: against closed formulas, and against the block that a project makes of the same numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from api.arrays import arrays_of
from bundle.aerial_block import aerial_block
from bundle.figure_blocks import figure_block
from bundle.solving import noisy, redefined, solution
from scipy.spatial.transform import Rotation
from support.synthetic_block import synthetic_block

import orip
from orip.records.block import Block
from orip.records.control import PointCorrelation
from orip.structs import replace

PRINCIPAL_DISTANCE, BASE, HEIGHT, PRECISION = 150.0, 600.0, 1000.0, 0.004


def normal_case(x_left: float, x_right: float, y_left: float, y_right: float) -> orip.Block:
    """Return two vertical photos with a base along X, whose orientations are held, and one point in both."""
    orientation = [[0.0, 0.0, HEIGHT, 0.0, 0.0, 0.0], [BASE, 0.0, HEIGHT, 0.0, 0.0, 0.0]]
    return orip.Block(
        [orip.Camera("RMK", c=PRINCIPAL_DISTANCE)],
        orip.Photos(["left", "right"], "RMK", orientation, np.ones((2, 6), dtype=bool)),
        orip.PhotoPoints(["left", "right"], ["P", "P"], [[x_left, y_left], [x_right, y_right]]),
        measurement_precision=PRECISION,
    )


def test_the_normal_case_of_photogrammetry() -> None:
    """X = B x'/p, Y = B (y' + y'') / 2p, Z = Z0 - B c/p with the parallax p = x' - x'', and their covariances."""
    x_left, x_right, y, py = 50.0, -40.0, 20.0, 1e-3
    found = normal_case(x_left, x_right, y + py / 2.0, y - py / 2.0).adjust()
    p = x_left - x_right
    point = found.points["P"]
    closed = [BASE * x_left / p, BASE * y / p, HEIGHT - BASE * PRINCIPAL_DISTANCE / p]
    # the residual parallax tilts the rays by less than 1e-5: its square is left
    assert point.coordinates == pytest.approx(closed, rel=1e-9)
    assert found.redundancy == 1
    # sigma0² from the one residual parallax, which has the variance 2
    assert found.sigma0 == pytest.approx(py / (np.sqrt(2.0) * PRECISION), rel=1e-6)
    by_measured = np.array(
        [
            [BASE / p - BASE * x_left / p**2, BASE * x_left / p**2, 0.0, 0.0],
            [-BASE * y / p**2, BASE * y / p**2, BASE / (2.0 * p), BASE / (2.0 * p)],
            [BASE * PRINCIPAL_DISTANCE / p**2, -BASE * PRINCIPAL_DISTANCE / p**2, 0.0, 0.0],
        ]
    )
    closed_covariance = (found.sigma0 * PRECISION) ** 2 * by_measured @ by_measured.T
    assert point.covariance == pytest.approx(closed_covariance, rel=1e-5, abs=1e-12)
    assert found.covariance("P") == pytest.approx(closed_covariance, rel=1e-5, abs=1e-12)
    assert np.array_equal(found.covariance("P", "photo left"), np.zeros((3, 6)))
    assert found.photos["LEFT"].deviations == pytest.approx([np.nan] * 6, nan_ok=True)


@pytest.mark.parametrize("scene", ["strip", "convergent"])
def test_the_block_is_the_one_that_a_project_makes(scene: str) -> None:
    made = synthetic_block(scene, "api", noise_mm=0.005, unknown=("C", "DX", "DY"), start_error=0.01)
    wanted = solution(made.block)
    found = orip.Block(**arrays_of(made.block), name=made.block.definition.name).adjust()
    assert found.status == wanted.status
    assert len(found.iterations) == len(wanted.iterations)
    # points start where their rays meet, those of the synthetic block elsewhere: both end as near as iterations do
    near = 1e-3
    order = [found.points.names.index(name) for name in wanted.points.names]
    # a point with one ray stays at the distance where it started
    known = np.isfinite(wanted.points.sd).all(axis=1)
    difference = (found.points.coordinates[order] - wanted.points.values)[known] / wanted.points.sd[known]
    assert np.abs(difference).max() < near
    assert found.sigma0 == pytest.approx(wanted.sigma0, rel=1e-6)


def test_missing_orientations_are_found() -> None:
    made = synthetic_block("convergent", "api", noise_mm=0.005)
    given = arrays_of(noisy(made, 2))
    started = orip.Block(**given).adjust()
    some = np.array(given["photos"].orientation)
    some[2:] = np.nan
    for orientation in (None, some):
        photos = replace(given["photos"], orientation=orientation)
        found = orip.Block(**{**given, "photos": photos}).adjust()
        assert np.abs((found.points.coordinates - started.points.coordinates) / started.points.deviations).max() < 1e-3


def test_a_free_network_and_its_settings() -> None:
    made = synthetic_block("convergent", "api", noise_mm=0.005)
    given = {**arrays_of(noisy(made, 2)), "datum": "free"}
    points = list(made.block.point_names)
    some, every = orip.Block(**given, datum_points=points[:5]).adjust(), orip.Block(**given).adjust()
    traces = [np.einsum("nii->", found.points.covariances) / found.sigma0**2 for found in (every, some)]
    assert traces[0] < traces[1]
    passes = []
    stopped = orip.Block(**given, max_iterations=2, enp_stop=9.0).adjust(on_iteration=passes.append)
    assert stopped.status == "not_converged"
    # what does not converge from the given values is tried from others
    assert {one.iteration for one in passes} == {1, 2}


def test_blunders_are_searched() -> None:
    made = synthetic_block("convergent", "api", noise_mm=0.005)
    given = arrays_of(noisy(made, 2))
    xy = np.array(given["photo_points"].xy)
    xy[17, 0] += 0.2
    photo_points = replace(given["photo_points"], xy=xy)
    found = orip.Block(**{**given, "photo_points": photo_points}).adjust(snoop=True, sigma0="posteriori", alpha=0.001)
    (blunder,) = found.blunders
    assert (blunder.photo, blunder.point) == (photo_points.photo[17], photo_points.point[17])
    assert blunder.size == pytest.approx(0.2, abs=4 * blunder.sd)


def test_stations_and_an_antenna_hold_a_block_without_control() -> None:
    made = aerial_block("api stations", 6)
    given = arrays_of(noisy(made, 2)) | {"control_points": None}
    arm = np.array([0.3, -0.2, 1.0])
    antenna = Rotation.from_euler("XYZ", made.orientations[:, 3:]).apply(arm) + made.orientations[:, :3]
    names = [photo.name for photo in made.block.photos]
    angles = np.full((15, 3), np.nan)
    angles[:5] = np.degrees(made.orientations[:5, 3:])
    block = orip.Block(
        **given,
        stations=orip.Stations(names, antenna, 0.02, angles, 0.01, time=np.arange(15.0), strip="1"),
        antennas=[{"name": "GNSS", "lever_arm": arm.tolist(), "unknown": ["LZ"], "lever_arm_error": [0.1, 0.1, 0.1]}],
    )
    found = block.adjust()
    assert found.status == "converged"
    assert [each.name for each in found.antennas][:3] == ["LX", "LY", "LZ"]
    # the height of the block hangs on the lever arm, whose a-priori value is exact
    truth = made.points[[made.block.point_names.index(name) for name in found.points.names]]
    assert np.abs(found.points.coordinates - truth).max() < 0.5
    assert np.count_nonzero(found.residuals.kind == "attitude") == 15


@pytest.mark.parametrize(
    ("changes", "where"),
    [
        ({"stations": orip.Stations(["P1", "P1"], np.zeros((2, 3)), 0.1)}, "stations[1]"),
        ({"antennas": [{"name": "A", "unknown": ["QX"]}]}, "antennas[0]"),
    ],
)
def test_wrong_stations_and_antennas_are_named_by_table_and_row(changes: dict[str, Any], where: str) -> None:
    with pytest.raises(orip.InputError) as error:
        orip.Block(**arrays_of(noisy(synthetic_block("convergent", "api"), 2)), **changes)
    assert where in str(error.value)


def test_distances_directions_elements_and_starting_values() -> None:
    made = synthetic_block("convergent", "api", noise_mm=0.005)
    given = arrays_of(noisy(made, 2))
    names, truth = made.block.point_names, made.points
    length = float(np.linalg.norm(truth[3] - truth[1]))
    east, north = (truth[7] - truth[5])[:2]
    found = orip.Block(
        **given,
        distances=orip.Distances(["L"], [names[1]], [names[3]], [length], 0.001),
        directions=orip.Directions(["S"], [names[5]], [names[7]], [np.degrees(np.arctan2(east, north)) % 360.0], 0.01),
        elements=orip.Elements(["P1"], "PHOTO", ["Z0"], [made.orientations[0, 2]], 0.01),
        preliminary_points=orip.PreliminaryPoints(names[:2], truth[:2]),
    ).adjust()
    residuals = found.residuals
    rows = {kind: np.flatnonzero(residuals.kind == kind) for kind in ("distance", "direction", "element")}
    assert {kind: len(row) for kind, row in rows.items()} == {"distance": 1, "direction": 1, "element": 1}
    assert [residuals.unit[row[0]] for row in rows.values()] == ["m", "degrees", "m"]
    assert residuals.observed[rows["distance"][0]] == length
    assert np.abs(residuals.residual[rows["distance"]]) < 0.005
    (zero_direction,) = found.zero_directions
    assert zero_direction.set == "S"
    # the reading is the azimuth, and a single one fixes R: it has the reading's error, and those of the points
    assert 0.01 * min(1.0, found.sigma0) <= zero_direction.sd < 1.0
    assert abs((zero_direction.value + 180.0) % 360.0 - 180.0) < 4.0 * zero_direction.sd


def _in_arrays(table: type[Any], records: Any, **columns: str) -> Any:
    """Return a table of the API from records: its columns by the names that these have in records."""
    return table(**{column: [getattr(one, name) for one in records] for column, name in columns.items()})


def test_points_on_figures_are_those_of_the_block_of_records() -> None:
    made = figure_block(1, max_iterations=30, start_down_weight=30).block
    figures = _in_arrays(orip.Figures, made.figure_points, figure="figure", kind="kind", point="point", error="error")
    found = orip.Block(**arrays_of(made), figures=figures, max_iterations=30, start_down_weight=30).adjust()
    expected = solution(made)
    assert found.sigma0 == pytest.approx(expected.sigma0, rel=1e-6)
    for own, other in zip(found.figures, expected.figures, strict=True):
        assert (own.name, own.kind, own.points) == (other.name, other.kind, other.points)
        assert own.sd_place == pytest.approx(other.sd_place, rel=1e-4)


def test_given_directions_are_observed() -> None:
    made = noisy(synthetic_block("convergent", "api", noise_mm=0.005), 2)
    names, truth = made.point_names, made.point_start
    lines = orip.GivenDirections(["G"], [names[1]], [names[3]], [2.0 * (truth[3] - truth[1])], 0.5)
    found = orip.Block(**arrays_of(made), given_directions=lines).adjust()
    rows = np.flatnonzero(found.residuals.kind == "given direction")
    assert [found.residuals.component[row] for row in rows] == ["side", "up"]
    assert set(found.residuals.photo[rows]) == {"G"}
    assert np.abs(found.residuals.residual[rows]).max() < 2.0


def test_covariances_of_control_are_those_of_records() -> None:
    made = noisy(synthetic_block("convergent", "api", noise_mm=0.005), 2)
    held = [point for point in made.control_points if all(error and error > 0.0 for error in point.errors)]
    made = replace(made, control_points=tuple(held))
    random = np.random.default_rng(8)
    errors = np.array([point.errors for point in held]).ravel()
    mixed = random.normal(size=(len(errors), 4 * len(errors)))
    correlations = mixed @ mixed.T
    correlations /= np.sqrt(np.outer(np.diag(correlations), np.diag(correlations)))
    covariance = correlations * np.outer(errors, errors)
    given = arrays_of(made)
    given["control_points"] = orip.ControlPoints(
        given["control_points"].name, given["control_points"].coordinates, covariance=covariance
    )
    found = orip.Block(**given, max_iterations=30, start_down_weight=30).adjust()
    whole = correlated_block(made, correlations)
    expected = solution(redefined(whole, max_iterations=30, start_down_weight=30))
    assert found.sigma0 == pytest.approx(expected.sigma0, rel=1e-6)
    place = {name: row for row, name in enumerate(expected.points.names)}
    rows = [place[name] for name in found.points.names]
    assert np.allclose(found.points.coordinates, expected.points.values[rows], atol=1e-5)
    # each point's own
    blocks = covariance.reshape(len(held), 3, len(held), 3)[np.arange(len(held)), :, np.arange(len(held))]
    given["control_points"] = replace(given["control_points"], covariance=blocks)
    own = orip.Block(**given).adjust()
    assert own.sigma0 != pytest.approx(found.sigma0, rel=1e-9)


def correlated_block(block: Block, correlations: np.ndarray) -> Block:
    """Return a block whose control points have coefficients of correlation (3 n, 3 n)."""
    points = block.control_points

    def part(one: int, other: int) -> np.ndarray:
        return correlations[3 * one : 3 * one + 3, 3 * other : 3 * other + 3]

    pairs = [
        PointCorrelation(points[a].name, points[b].name, tuple(map(tuple, part(a, b).tolist())))
        for a in range(len(points))
        for b in range(a + 1, len(points))
    ]
    own = tuple(
        replace(point, correlations=(part(row, row)[0, 1], part(row, row)[0, 2], part(row, row)[1, 2]))
        for row, point in enumerate(points)
    )
    return replace(block, control_points=own, control_correlations=tuple(pairs))


def test_a_block_that_cannot_be_solved_says_why() -> None:
    made = synthetic_block("convergent", "api", control="none")
    given = arrays_of(made.block)
    given["photos"] = replace(given["photos"], orientation=None)
    with pytest.raises(orip.NotSolvableError, match="could not be oriented"):
        orip.Block(**given).adjust()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"alpha": 0.01}, "go with snoop=True"),
        ({"snoop": True, "alpha": 0.7}, "alpha is 0.7; it is a probability from 1e-09 to 0.5"),
        ({"snoop": True, "sigma0": "a priori"}, "one of apriori, posteriori"),
    ],
)
def test_options_that_do_not_go_together(options: dict[str, object], message: str) -> None:
    with pytest.raises(orip.UsageError, match=message):
        normal_case(50.0, -40.0, 20.0, 20.0).adjust(**options)
