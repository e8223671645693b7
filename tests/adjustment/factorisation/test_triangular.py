"""Systems with a lower triangle."""

from __future__ import annotations

import numpy as np
import pytest

from orip.adjustment.factorisation.lapack import solve_lower

LOWER = np.array([[2.0, np.nan, np.nan], [1.0, 4.0, np.nan], [3.0, 5.0, 8.0]])
"""What stands above the diagonal is not read."""


@pytest.mark.parametrize("lower", [LOWER, np.asfortranarray(LOWER), np.hstack([LOWER, LOWER])[:, :3]])
def test_solutions_by_hand(lower: np.ndarray) -> None:
    right = np.array([2.0, 9.0, 21.0])
    assert solve_lower(lower, right).tolist() == [1.0, 2.0, 1.0]
    assert solve_lower(lower, np.column_stack([right, 2.0 * right])).tolist() == [[1.0, 2.0], [2.0, 4.0], [1.0, 2.0]]
    assert solve_lower(lower, np.array([7.0, 13.0, 8.0]), transposed=True).tolist() == [1.0, 2.0, 1.0]
    assert right.tolist() == [2.0, 9.0, 21.0]


def test_nothing_to_solve() -> None:
    assert solve_lower(np.zeros((0, 0)), np.zeros((0, 2))).shape == (0, 2)
    assert solve_lower(np.eye(3), np.zeros((3, 0))).shape == (3, 0)


def test_what_has_no_solution_is_refused() -> None:
    with pytest.raises(ValueError, match="infs or NaNs"):
        solve_lower(np.eye(2), np.array([1.0, np.nan]))
    with pytest.raises(np.linalg.LinAlgError, match="element 2"):
        solve_lower(np.diag([1.0, 0.0]), np.ones(2))
