"""Normal equations with eliminated blocks, against dense solutions."""

from __future__ import annotations

import numpy as np
import pytest
from adjustment.factorisation.linear_systems import (
    MAX_LOST,
    SHAPES,
    dense_normals,
    equations_of,
    pseudo_inverse,
    random_equations,
    random_weights,
    singular_equations,
)

from orip.adjustment.equations import Layout
from orip.adjustment.normals import solve_normals
from orip.structs import replace


def made(shape):
    equations, layout = random_equations(11, **SHAPES[shape])
    return equations, layout, random_weights(12, len(equations.residual))


@pytest.mark.parametrize("shape", SHAPES)
def test_correction_is_that_of_the_dense_system(shape):
    equations, layout, weights = made(shape)
    found = solve_normals(equations, weights, layout, MAX_LOST)
    right = equations.design.toarray().T @ (weights * -equations.residual)
    wanted = pseudo_inverse(dense_normals(equations, weights)) @ right
    scale = np.sqrt(np.maximum(np.diag(dense_normals(equations, weights)), 1e-300))
    assert np.allclose(found.correction * scale, wanted * scale, atol=1e-9)
    assert not found.removed[~layout.fixed].any()
    assert not found.correction[layout.fixed].any()


@pytest.mark.parametrize("shape", SHAPES)
def test_other_right_hand_sides_are_solved_alike(shape):
    equations, layout, weights = made(shape)
    found = solve_normals(equations, weights, layout, MAX_LOST)
    normals = dense_normals(equations, weights)
    right = normals @ np.random.default_rng(13).normal(size=(layout.size, 3))
    scale = np.sqrt(np.maximum(np.diag(normals), 1e-300))[:, None]
    assert np.allclose(found.solve(right) * scale, pseudo_inverse(normals) @ right * scale, rtol=1e-8, atol=1e-7)


@pytest.mark.parametrize("shape", SHAPES)
def test_square_sum_of_the_reduced_right_hand_side_is_the_drop_of_the_weighted_square_sum(shape):
    equations, layout, weights = made(shape)
    found = solve_normals(equations, weights, layout, MAX_LOST)
    after = equations.residual + equations.design @ found.correction
    drop = weights @ equations.residual**2 - weights @ after**2
    quadratic = found.correction @ dense_normals(equations, weights) @ found.correction
    assert found.reduced_square_sum == pytest.approx(drop, rel=1e-10)
    assert found.reduced_square_sum == pytest.approx(quadratic, rel=1e-10)


def test_inactive_observations_have_no_influence():
    equations, layout, weights = made("blocks")
    active = np.arange(len(weights)) % 5 != 1
    some = solve_normals(replace(equations, active=active), weights, layout, MAX_LOST)
    wild = replace(equations, active=active, residual=np.where(active, equations.residual, 1e6))
    assert np.array_equal(solve_normals(wild, weights, layout, MAX_LOST).correction, some.correction)
    alone = equations_of(equations.design.toarray()[active], equations.residual[active])
    assert np.allclose(
        solve_normals(alone, weights[active], layout, MAX_LOST).correction, some.correction, rtol=1e-9, atol=1e-12
    )


def test_unknowns_that_nothing_determines_are_removed_in_both_parts():
    singular, layout = singular_equations(14)
    weights, right = np.ones(len(singular.residual)), singular.design.toarray().T @ -singular.residual
    found = solve_normals(singular, weights, layout, MAX_LOST)
    # the scale of columns 3 and 8 decides which of them is named; both are the same unknown
    assert found.removed[:9].sum() == 1
    assert found.removed[[3, 8]].sum() == 1
    assert found.removed[9:12].sum() == 1
    assert found.removed.sum() == 2
    assert (found.lost_digits[found.removed] > MAX_LOST).all()
    normals = dense_normals(singular, weights)
    wanted = pseudo_inverse(normals, found.removed) @ right
    scale = np.sqrt(np.diag(normals))
    assert np.allclose(found.correction * scale, wanted * scale, atol=1e-8)


def test_an_unknown_without_observations_is_removed():
    equations, layout = random_equations(15)
    design = equations.design.toarray()
    design[:, 4] = 0.0
    design[:, 15] = 0.0
    found = solve_normals(equations_of(design, equations.residual), np.ones(len(design)), layout, MAX_LOST)
    assert np.flatnonzero(found.removed).tolist() == [4, 15]
    assert found.lost_digits[[4, 15]].tolist() == [99.0, 99.0]


def test_digits_lost_count_from_the_complete_diagonal():
    # x and the first coordinate of a point are seen as their sum, and x alone a thousand times less well
    design = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], [1e-3, 0.0, 0.0, 0.0]])
    layout = Layout(1, 1, np.zeros(4, dtype=bool))
    found = solve_normals(equations_of(design, np.zeros(4)), np.ones(4), layout, MAX_LOST)
    assert found.lost_digits[0] == pytest.approx(6.0, abs=1e-4)
