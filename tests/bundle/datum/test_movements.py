"""Movements of a whole block: photo coordinates do not change, and sums over points are those of the stored matrix."""

from __future__ import annotations

import numpy as np
import pytest
from aerial_blocks import aerial_block

from orip.bundle.datum.movements import movements_of_block
from orip.bundle.problem import pose_problem
from orip.bundle.starting_state import starting_state
from orip.bundle.unknowns import CONSTANT
from orip.records.block import Block
from orip.structs import replace

BLOCK = replace(aerial_block(12, 60), control_points=())


def with_constants() -> Block:
    """Return the block with some constant coordinates of points."""
    constant = BLOCK.constant_points.copy()
    constant[3, 1] = constant[7, :2] = True
    return replace(BLOCK, constant_points=constant)


def test_no_photo_coordinate_changes() -> None:
    problem, state = pose_problem(BLOCK), starting_state(BLOCK)
    design = problem.design(state)
    changes = movements_of_block(state, problem.unknowns).dense()
    # what the parts add up to is zero but for the rounding of sums of some ten terms
    assert np.abs(design @ changes).max() < 1e-13 * (abs(design) @ np.abs(changes)).max()
    assert np.linalg.matrix_rank(changes) == 7


@pytest.mark.parametrize("block", [BLOCK, with_constants()], ids=["free", "some constant"])
def test_sums_over_points_are_those_of_the_stored_matrix(block: Block) -> None:
    unknowns, random = pose_problem(block).unknowns, np.random.default_rng(6)
    combinations = random.normal(size=(7, 5))
    found = movements_of_block(starting_state(block), unknowns).combined(combinations)
    dense = found.dense()
    points = np.arange(0, len(block.point_names), 3)
    inner = np.zeros_like(dense)
    columns = unknowns.points[points]
    inner[columns[columns != CONSTANT]] = dense[columns[columns != CONSTANT]]
    vector = random.normal(size=len(dense))
    for wanted, computed in (
        (dense @ combinations.T[:, 0], found.times(combinations.T[:, 0])),
        (inner.T @ vector, found.transposed_at(points, vector)),
        (inner.T @ dense, found.squares_at(points)),
    ):
        assert np.allclose(computed, wanted, rtol=1e-12, atol=1e-12 * np.abs(wanted).max())
