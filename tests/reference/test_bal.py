"""A problem of Bundle Adjustment in the Large (Agarwal et al. 2010): Ladybug, 49 photos with a camera each, no control.

Ten of its points lie behind all cameras that they were measured in, at the start and at the published minimum: their 31
rays have a residual by the formula, but no camera can see these points, and orip does not count them.
"""

from __future__ import annotations

import numpy as np
import pytest
from bal import ALL_RAYS_COST, MINIMUM_COST, RAYS_FROM_BEHIND, START_COST, bal_block
from reference.published_data import data_set

from orip.bundle.problem import pose_problem, starting_state
from orip.bundle.solve import solve_block
from orip.model.block import Block


@pytest.fixture(scope="module")
def ladybug() -> Block:
    return bal_block(data_set("bal") / "problem-49-7776-pre.txt")


def cost_of_rays_from_behind(block: Block) -> tuple[int, float]:
    """Return how many points are behind the camera, and their part of the cost by the formula of the collection."""
    state, points = starting_state(block), block.photo_points
    rotations = np.swapaxes(state.rotations, 1, 2)[points.photo]
    seen = np.einsum("nij,nj->ni", rotations, state.points[points.point] - state.centres[points.photo])
    behind = seen[:, 2] > 0.0
    c, a3, a5 = (state.cameras[points.photo[behind], place, None] for place in (0, 4, 5))
    p = -seen[behind, :2] / seen[behind, 2:]
    r2 = np.sum(p**2, axis=1, keepdims=True)
    residual = c * (1.0 + a3 * c**2 * r2 + a5 * c**4 * r2**2) * p - points.xy[behind]
    return int(np.count_nonzero(behind)), 0.5 * float(np.sum(residual**2))


def test_cost_at_the_start_is_the_published_one(ladybug: Block) -> None:
    equations = pose_problem(ladybug).linearise(starting_state(ladybug))
    count, behind = cost_of_rays_from_behind(ladybug)
    assert count == RAYS_FROM_BEHIND
    assert np.count_nonzero(~equations.active) == 2 * count
    # published to two decimals
    assert 0.5 * np.sum(equations.residual[equations.active] ** 2) + behind == pytest.approx(START_COST, abs=0.006)


def test_minimum_is_reached(ladybug: Block) -> None:
    solved = solve_block(ladybug, lambda _: None, lambda: False)
    equations = solved.adjusted.linearised.equations
    assert np.count_nonzero(~equations.active) == 2 * RAYS_FROM_BEHIND
    # points at infinity let the cost fall on and on, in the ninth digit
    cost = 0.5 * float(np.sum(equations.residual[equations.active] ** 2))
    assert cost == pytest.approx(MINIMUM_COST, rel=1e-8)
    assert cost < ALL_RAYS_COST
