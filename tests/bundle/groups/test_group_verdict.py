"""Groups of observations that contradict all others are named, though thousands of photo points fit."""

from __future__ import annotations

import re

import numpy as np
import pytest
from monte_carlo.grouped_blocks import STATION_ERROR, exact_block, grouped_block, verdict_of
from monte_carlo.planted_groups import KINDS, block_of
from monte_carlo.simulated_blocks import solved
from support.synthetic_block import SyntheticBlock

from orip.bundle.groups.figures import GroundGroups, GroupFigures, ground_tests, is_testable, photo_test
from orip.bundle.groups.held_cameras import held_cameras
from orip.bundle.groups.hypotheses import SINGLE_CONTROL, hypotheses, number_of_shifts
from orip.bundle.groups.observation_groups import observation_groups
from orip.bundle.groups.verdict import FAMILY, GroupVerdict, limits_of_tests
from orip.bundle.groups.words import group_diagnosis, group_name
from orip.bundle.methods import Method, adjust_block
from orip.records.block import Block
from orip.records.results.solution import Solution
from orip.structs import replace

STATIONS_OFF = {"X0": 0.04 / 0.02, "Y0": -0.03 / 0.02, "Z0": 0.25 / 0.03}
"""In a-priori errors: stations of a survey receiver, 4, -3 and 25 cm off, with errors of 2, 2 and 3 cm."""


def solution_of(block: Block) -> Solution:
    return adjust_block(block, Method(), lambda _: None, lambda: False)[0]


def with_stations_off(block: Block) -> Block:
    elements = tuple(
        replace(element, value=element.value + STATIONS_OFF[element.kind] * element.error) for element in block.elements
    )
    return replace(block, elements=elements)


def first(verdict: GroupVerdict) -> set[str]:
    return {group_name(group) for group in verdict.contradictions[0].groups}


def test_clean_groups_do_not_contradict_one_another() -> None:
    solution = solution_of(grouped_block("none", 1).block)
    assert solution.verdict in {
        "Converged; all observations fit, and all unknowns are determined",
        "Converged; 1 note on what is weak",
    }
    assert not any(group.doubted for group in solution.groups)
    assert {group.kind for group in solution.groups} == {"photo", "control", "element", "distance", "check"}


def test_redundancies_of_the_groups_sum_up_to_that_of_the_block() -> None:
    solution = solution_of(grouped_block("none", 2).block)
    measured = [group.redundancy for group in solution.groups if group.kind != "check"]
    assert sum(measured) == pytest.approx(solution.redundancy, abs=1e-6)
    assert sum(group.number for group in solution.groups if group.kind != "check") == solution.observations


def test_stations_of_a_receiver_with_an_antenna_offset_are_named() -> None:
    solution = solution_of(with_stations_off(grouped_block("none", 3).block))
    assert re.match(r"Converged, but the exposure stations are all off by X0 .*, Z0 \+0\.4", solution.verdict)
    stations = {group.component: group for group in solution.groups if group.of == "PHOTO"}
    offset = STATIONS_OFF["Z0"] * STATION_ERROR
    assert abs(stations["Z0"].shift - offset) < 4.0 * stations["Z0"].shift_sd
    assert solution.diagnosis[0].code == "group"
    assert "antenna" in solution.diagnosis[0].remedy


def test_without_check_points_nothing_tells_stations_from_control() -> None:
    block = with_stations_off(grouped_block("none", 4).block)
    control = tuple(point for point in block.control_points if point.kind == "control")
    _, verdict = verdict_of(replace(block, control_points=control))
    (diagnosis, *_) = group_diagnosis(verdict.contradictions, "m")
    assert diagnosis.where == "exposure stations and control points"
    assert re.match(r"the exposure stations are all off by X0 .*, Z0 \+0\.4", diagnosis.text)
    assert "it cannot be told whether instead it is a shift of the control points in X, Y and Z" in diagnosis.text


def test_one_wrong_check_point_is_named_and_not_all_of_them() -> None:
    block = grouped_block("none", 5).block
    wrong = next(point for point in block.control_points if point.kind == "check")
    x, y, z = wrong.coordinates
    assert z is not None
    moved = replace(wrong, coordinates=(x, y, z + 1000.0))
    control = tuple(moved if point is wrong else point for point in block.control_points)
    solution = solution_of(replace(block, control_points=control))
    # it is compared, and has no influence
    assert solution.verdict.startswith(f"Converged, but check point {wrong.name} differs by -1000 m in Z")


def test_the_mean_of_correlated_residuals_scatters_as_its_standard_deviation_says() -> None:
    ratios = [
        [group.mean / group.mean_sd for group in verdict_of(grouped_block("none", run).block)[1].groups[2:]]
        for run in range(12)
    ]
    # chi-square of 12 runs of ten means: 0.1 % beyond these limits, more runs in the long Monte Carlo study
    squares = float(np.mean(np.square(ratios)))
    assert 0.4 < squares < 2.0


def test_coordinates_of_a_free_network_are_no_check() -> None:
    block = grouped_block("none", 6).block
    free = replace(block, definition=replace(block.definition, datum="free"))
    _, verdict = verdict_of(free)
    assert {group.kind for group in verdict.groups} == {"photo", "distance"}


def test_a_camera_whose_photo_points_scatter_more_than_the_others_is_named() -> None:
    made: SyntheticBlock = exact_block(7)
    block, random = grouped_block("none", 7).block, np.random.default_rng(7)
    cameras = (*block.cameras, replace(block.cameras[0], name="WORN"))
    of_photo = np.arange(len(block.photos)) % 4 == 0
    points = block.photo_points
    scatter = 3.0 * points.error * random.normal(size=points.xy.shape) * of_photo[points.photo][:, None]
    photos = tuple(
        replace(photo, camera="WORN") if worn else photo for photo, worn in zip(block.photos, of_photo, strict=True)
    )
    mixed = replace(
        block,
        cameras=cameras,
        photos=photos,
        photo_camera=of_photo.astype(np.int64),
        photo_points=replace(points, xy=points.xy + scatter),
    )
    _, verdict = verdict_of(mixed)
    (diagnosis, *_) = group_diagnosis(verdict.contradictions, "m")
    assert diagnosis.text.startswith("the residuals of camera WORN's photo points are ")
    assert len(made.cameras) == 1


@pytest.mark.parametrize("kind", KINDS)
def test_all_tests_of_a_block_share_the_probability_of_an_error(kind) -> None:
    found = solved(block_of(kind, 0, None))
    rows = [part.rows for part in found.problem.observations]
    figures = GroupFigures.of(found, np.concatenate([part.error for part in rows]))
    checks = {point.name for point in found.block.control_points if point.kind == "check"}
    groups = observation_groups(found, checks)
    photos = [photo_test(group, figures) for group in groups if group.kind == "photo"]
    ground = GroundGroups.of(found, [group for group in groups if group.kind != "photo"], figures)
    sums = ground.sums_with_checks()
    tested, shown = [*photos, *ground_tests(ground, figures)], is_testable(sums, np.diag(sums.covariance()))
    limits = limits_of_tests(tested, number_of_shifts(ground, sums))
    parts = [
        SINGLE_CONTROL if test.is_single_control else 1.0
        for test in hypotheses(ground)
        if shown[list(test.columns)].any()
    ]
    others = sum(len(set(group.log_p) - {"mean"}) for group in tested) + len(photos)
    assert len(parts) > len(ground.groups) / 2
    assert sum(parts) * np.exp(limits.shift) + others * np.exp(limits.other) == pytest.approx(FAMILY, rel=1e-12)


def test_what_unknowns_absorb_of_a_held_camera_is_never_more_than_all() -> None:
    """The normal equations may be those before the last iteration, whose rows are hardly different."""
    solved_block = solved(grouped_block("none", 1).block)
    correction = 0.03 * np.random.default_rng(1).normal(size=solved_block.problem.layout.size)
    nearby = replace(solved_block, state=solved_block.problem.update(solved_block.state, correction))
    held = held_cameras(nearby, solved_block.weight_factors)
    assert held is not None
    left = held.sums.square - held.sums.right.T @ held.sums.moved
    scale = np.sqrt(np.diag(held.sums.square))
    assert np.linalg.eigvalsh(left / np.outer(scale, scale)).min() > -1e-10


def test_held_cameras_of_single_photos_add_up_to_one_held_camera() -> None:
    block = grouped_block("none", 1).block
    cameras = tuple(replace(block.cameras[0], name=photo.name) for photo in block.photos)
    photos = tuple(replace(photo, camera=photo.name) for photo in block.photos)
    each = replace(block, cameras=cameras, photos=photos, photo_camera=np.arange(len(photos)))
    together, single = (held_cameras(found, found.weight_factors) for found in (solved(block), solved(each)))
    assert together is not None
    assert single is not None
    for row, group in enumerate(together.groups):
        mine = [place for place, one in enumerate(single.groups) if one.component == group.component]
        assert len(mine) == len(photos)
        sums = single.sums
        assert sums.values[mine].sum() == pytest.approx(together.sums.values[row], rel=1e-9, abs=1e-9)
        assert sums.square[np.ix_(mine, mine)].sum() == pytest.approx(together.sums.square[row, row], rel=1e-12)
        assert np.allclose(sums.right[:, mine].sum(axis=1), together.sums.right[:, row], rtol=1e-9, atol=1e-9)
