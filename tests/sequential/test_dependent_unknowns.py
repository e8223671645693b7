"""Unknowns that depend on others, while a block is not determined: the triangle has the rank of its equations."""

from __future__ import annotations

import numpy as np
import pytest

from orip.online.sequential.hyper_rows import ReducedRows
from orip.online.sequential.triangle import Triangle

PHOTOS = 12
"""Of six unknowns each: more than one panel."""


def _equations(random: np.random.Generator) -> list[ReducedRows]:
    """Return equations of groups of up to three photos each, too few for some of them."""
    found = []
    for first in range(PHOTOS - 2):
        columns = 6 * first + np.arange(6 * int(random.integers(1, 4)))
        count = int(random.integers(1, 8))
        found.append(ReducedRows(columns, random.normal(size=(count, len(columns))), random.normal(size=count)))
    return found


def _dense(equations: list[ReducedRows]) -> tuple[np.ndarray, np.ndarray]:
    design = np.zeros((sum(len(rows.right) for rows in equations), 6 * PHOTOS))
    start = 0
    for rows in equations:
        design[start : start + len(rows.right), rows.columns] = rows.rows
        start += len(rows.right)
    return design, np.concatenate([rows.right for rows in equations])


@pytest.mark.parametrize("seed", range(6))
def test_built_and_updated_triangles_of_undetermined_photos_have_the_rank_of_their_equations(seed: int) -> None:
    equations = _equations(np.random.default_rng(seed))
    design, right = _dense(equations)
    rank = np.linalg.matrix_rank(design)
    assert rank < 6 * PHOTOS
    rest = right - design @ np.linalg.lstsq(design, right, rcond=None)[0]
    built, updated = Triangle(6 * PHOTOS), Triangle(6 * PHOTOS)
    built.build(equations)
    for rows in equations:
        updated.update(rows)
    for triangle in (built, updated):
        assert triangle.rank == rank
        # conditions of random partials are up to some 1e3, of the 16 digits
        assert triangle.factor.T @ triangle.factor == pytest.approx(design.T @ design, abs=1e-11)
        assert triangle.factor.T @ triangle.right == pytest.approx(design.T @ right, abs=1e-11)
        assert triangle.residual_square_sum == pytest.approx(float(rest @ rest), abs=1e-10)
