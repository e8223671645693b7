"""A point of which as many rays meet at another place is named first, in the status and in the verdict."""

from __future__ import annotations

import numpy as np
import pytest
from support.synthetic_block import synthetic_block

from orip.bundle.methods import adjust_block
from orip.bundle.problem import pose_problem
from orip.bundle.starting_state import starting_state
from orip.bundle.verdict import TWO_PLACES
from orip.records.results.solution import Solution
from orip.solving.solve import PLAIN
from orip.structs import replace

NOISE_MM = 0.005
ELSEWHERE = np.array([0.05, -0.04, 0.06])


def solution(seed: str, wrong: int, right: int) -> tuple[Solution, str]:
    """Return the solution of a block with a point of so many rays that meet elsewhere, and at it; and its name."""
    made = synthetic_block("convergent", f"places {seed}", noise_mm=NOISE_MM, precision_mm=NOISE_MM)
    block, points = made.block, made.block.photo_points
    control = {point.name for point in block.control_points}
    point = next(row for row, name in enumerate(block.point_names) if name not in control)
    rays = np.flatnonzero(points.point == point)
    truth = replace(block, photo_orientation=made.orientations, point_start=made.points)
    moved = made.points.copy()
    moved[point] += ELSEWHERE
    images = [
        pose_problem(start).linearise(starting_state(start)).residual[: points.xy.size].reshape(-1, 2)
        for start in (truth, replace(truth, point_start=moved))
    ]
    xy = points.xy.copy()
    xy[rays[:wrong]] += ((images[1] - images[0]) * points.error)[rays[:wrong]]
    kept = np.setdiff1d(np.arange(len(xy)), rays[wrong + right :])
    start = replace(truth, photo_points=replace(points, xy=xy).of(kept))
    found, _ = adjust_block(start, PLAIN, lambda _: None, lambda: False)
    return found, block.point_names[point]


@pytest.mark.parametrize("seed", ["a", "b", "c"])
def test_as_many_rays_elsewhere_are_said_first(seed: str) -> None:
    found, name = solution(seed, wrong=2, right=2)
    places = [one for one in found.diagnosis if one.code == TWO_PLACES]
    assert [one.where for one in places] == [f"point {name}"]
    assert found.status == "doubtful"
    assert f"point {name} may be at another place" in found.verdict


@pytest.mark.parametrize(("wrong", "right"), [(2, 4), (0, 4)])
def test_where_more_rays_are_right_nothing_is_said(wrong: int, right: int) -> None:
    found, _ = solution("d", wrong, right)
    assert TWO_PLACES not in [one.code for one in found.diagnosis]
    assert "another place" not in found.verdict


def test_rays_that_meet_behind_their_photos_have_no_other_place() -> None:
    made = synthetic_block("strip", "behind")
    points = made.block.photo_points
    (row, other) = np.flatnonzero(points.point == 1)
    xy = points.xy.copy()
    xy[[row, other]] *= -1.0
    block = replace(
        made.block, photo_orientation=made.orientations, point_start=made.points, control_points=(),
        photo_points=replace(points, xy=xy),
    )  # fmt: skip
    problem, state = pose_problem(block), starting_state(block)
    equations = problem.linearise(state)
    weights = np.ones(len(equations.residual))
    weights[2 * row] = 0.1
    assert problem.other_places(state, equations, weights, 3.0) == []
