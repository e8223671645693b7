"""Cofactors, redundancy numbers and sigma0, against dense matrices."""

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

from orip.adjustment.normals import solve_normals
from orip.adjustment.precision import cofactors, residual_cofactor, variance_of_unit_weight
from orip.structs import replace


def computed(equations, weights, layout):
    normals = solve_normals(equations, weights, layout, MAX_LOST)
    return normals, cofactors(equations, normals)


def assert_dense(found, dense, layout, equations):
    m = layout.reduced
    scale = np.sqrt(np.maximum(np.diag(dense), 1e-300))
    assert np.allclose(found.reduced / np.outer(scale[:m], scale[:m]), dense[:m, :m] / np.outer(scale[:m], scale[:m]))
    for block in range(layout.blocks):
        place = slice(m + 3 * block, m + 3 * block + 3)
        both = np.outer(scale[place], scale[place])
        assert np.allclose(found.blocks[block] / both, dense[place, place] / both, atol=1e-9)
    design = equations.design.toarray()
    assert np.allclose(found.leverage, np.einsum("ij,jk,ik->i", design, dense, design), atol=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
def test_cofactors_and_leverages_are_those_of_the_dense_inverse(shape):
    equations, layout = random_equations(21, **SHAPES[shape])
    weights = random_weights(22, len(equations.residual))
    _, found = computed(equations, weights, layout)
    assert_dense(found, pseudo_inverse(dense_normals(equations, weights)), layout, equations)


def test_removed_unknowns_have_zero_cofactors_and_the_others_those_without_them():
    singular, layout = singular_equations(23)
    weights = np.ones(len(singular.residual))
    normals, found = computed(singular, weights, layout)
    assert normals.removed.sum() == 2
    assert not found.reduced[normals.removed[:9]].any()
    dense = pseudo_inverse(dense_normals(singular, weights), normals.removed)
    assert_dense(found, dense, layout, singular)


@pytest.mark.parametrize("shape", SHAPES)
def test_redundancy_numbers_sum_up_to_the_redundancy(shape):
    equations, layout = random_equations(24, **SHAPES[shape])
    active = np.arange(len(equations.residual)) % 7 != 3
    equations = replace(equations, active=active)
    weights = random_weights(25, len(active))
    _, found = computed(equations, weights, layout)
    variance = variance_of_unit_weight(equations, weights, found.leverage, layout.unknowns)
    assert variance.redundancy == active.sum() - layout.unknowns
    assert abs(np.nansum(variance.redundancy_numbers) - variance.redundancy) < 1e-8
    assert np.isnan(variance.redundancy_numbers[~active]).all()
    assert variance.redundancy_numbers[active].min() > -1e-9
    assert variance.redundancy_numbers[active].max() < 1.0 + 1e-9


def test_redundancy_numbers_sum_up_when_unknowns_are_removed():
    equations, layout = random_equations(26)
    design = equations.design.toarray()
    design[:, 8] = design[:, 3]
    equations = equations_of(design, equations.residual)
    weights = random_weights(27, len(design))
    normals, found = computed(equations, weights, layout)
    effective = layout.unknowns - int(normals.removed.sum())
    variance = variance_of_unit_weight(equations, weights, found.leverage, effective)
    assert variance.redundancy == len(design) - layout.unknowns + 1
    assert abs(variance.redundancy_numbers.sum() - variance.redundancy) < 1e-8


def test_redundancy_numbers_are_the_diagonal_of_the_projection_onto_the_residuals():
    equations, layout = random_equations(28)
    weights = random_weights(29, len(equations.residual))
    _, found = computed(equations, weights, layout)
    variance = variance_of_unit_weight(equations, weights, found.leverage, layout.unknowns)
    weighted = np.sqrt(weights)[:, None] * equations.design.toarray()
    projection = np.eye(len(weights)) - weighted @ np.linalg.pinv(weighted, rcond=1e-14)
    assert np.allclose(variance.redundancy_numbers, np.diag(projection), atol=1e-7)


def test_sigma0_counts_observations_with_full_weight_and_sigma0_all_counts_every_one():
    residual = np.array([1.0, -2.0, 0.5, 10.0, 3.0])
    equations = replace(equations_of(np.ones((5, 1)), residual), active=np.array([True] * 4 + [False]))
    weights, leverage = np.array([1.0, 1.0, 1.0, 0.1, 0.0]), np.array([0.3, 0.2, 0.4, 1.0, 0.5])
    found = variance_of_unit_weight(equations, weights, leverage, 1)
    assert found.redundancy == 3
    assert found.redundancy_used == pytest.approx(0.7 + 0.8 + 0.6)
    assert found.sigma0 == pytest.approx(np.sqrt((1.0 + 4.0 + 0.25) / 2.1))
    assert found.sigma0_all == pytest.approx(np.sqrt((1.0 + 4.0 + 0.25 + 100.0) / 3.0))
    assert found.redundancy_numbers[3] == pytest.approx(0.9)


def test_exact_observations_are_redundancy_but_no_part_of_the_square_sums():
    equations = replace(equations_of(np.ones((3, 1)), np.array([1.0, 1.0, 50.0])), exact=np.array([False, False, True]))
    found = variance_of_unit_weight(equations, np.ones(3), np.full(3, 1.0 / 3.0), 1)
    assert found.redundancy == 2
    assert found.sigma0 == pytest.approx(1.0)
    assert found.sigma0_all == pytest.approx(1.0)


def test_without_redundancy_there_is_no_sigma0():
    found = variance_of_unit_weight(equations_of(np.eye(3), np.zeros(3)), np.ones(3), np.ones(3), 3)
    assert found.redundancy == 0
    assert np.isnan(found.sigma0)
    assert np.isnan(found.sigma0_all)


def propagated_cofactors(equations, weights):
    """Return var(v) / σ² by propagation of unit errors through the whole adjustment."""
    design = equations.design.toarray()
    inverse = pseudo_inverse(dense_normals(equations, weights))
    by_errors = design @ inverse @ design.T * weights - np.eye(len(design))
    return (by_errors**2).sum(axis=1)


def residual_cofactors(equations, weights, layout):
    _, found = computed(equations, weights, layout)
    return residual_cofactor(
        variance_of_unit_weight(equations, weights, found.leverage, layout.unknowns).redundancy_numbers, weights
    )


@pytest.mark.parametrize("factor", [1.0, 0.5, 0.05, 1e-3])
def test_the_variance_of_a_down_weighted_residual_is_that_of_propagated_errors(factor):
    equations, layout = random_equations(31)
    for row in range(0, len(equations.residual), 7):
        weights = np.ones(len(equations.residual))
        weights[row] = factor
        found = residual_cofactors(equations, weights, layout)[row]
        # both inverses are of matrices whose condition, scaled, is below 1e5
        assert found == pytest.approx(propagated_cofactors(equations, weights)[row], rel=1e-8, abs=1e-10)


def test_with_several_down_weighted_observations_the_variance_is_never_too_small_and_hardly_too_large():
    equations, layout = random_equations(33)
    weights = np.ones(len(equations.residual))
    weights[::9] = 0.3
    ratio = residual_cofactors(equations, weights, layout)[::9] / propagated_cofactors(equations, weights)[::9]
    assert ratio.min() > 1.0 - 1e-9
    assert np.median(ratio) < 1.1


def test_residuals_of_a_down_weighted_observation_scatter_as_their_cofactor_says():
    equations, layout = random_equations(32)
    weights = np.ones(len(equations.residual))
    row = int(np.argmax(computed(equations, weights, layout)[1].leverage))
    weights[row] = 0.2
    random = np.random.default_rng(34)
    design = equations.design.toarray()
    solution = pseudo_inverse(dense_normals(equations, weights)) @ (design.T * weights)
    errors = random.normal(size=(len(design), 20_000))
    scatter = np.var(design[row] @ (solution @ errors) - errors[row])
    # a variance estimated from 20 000 residuals has a standard deviation of 1 %
    assert residual_cofactors(equations, weights, layout)[row] == pytest.approx(scatter, rel=0.05)
