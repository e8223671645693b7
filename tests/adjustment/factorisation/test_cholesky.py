"""The factorisation that removes what is not determined, against numpy."""

from __future__ import annotations

import numpy as np
import pytest

from orip.adjustment.factorisation.cholesky import factorise
from orip.adjustment.factorisation.null_space import LOST_ALL, soft_movements

MAX_LOST = 12.0


def unit_diagonal(matrix):
    scale = np.sqrt(np.diag(matrix))
    return matrix / np.outer(scale, scale)


def regular(size, seed=1):
    design = np.random.default_rng(seed).normal(size=(3 * size, size))
    return unit_diagonal(design.T @ design)


def dependent(size, combinations, seed=2):
    """Return a matrix in which column `last` is the combination of others: a dict of last to their factors."""
    random = np.random.default_rng(seed)
    design = random.normal(size=(3 * size, size))
    for last, factors in combinations.items():
        design[:, last] = sum(factor * design[:, column] for column, factor in factors.items())
    return unit_diagonal(design.T @ design), design


def factorised(matrix, undetermined=()):
    flags = np.zeros(len(matrix), dtype=bool)
    flags[list(undetermined)] = True
    return factorise(matrix.copy(), MAX_LOST, flags)


@pytest.mark.parametrize("size", [1, 2, 17, 64, 65, 130, 200])
def test_regular_matrix_is_factored_solved_and_inverted(size):
    matrix = regular(size)
    factor = factorised(matrix)
    assert not factor.removed.any()
    lower = np.tril(factor.lower)
    assert np.allclose(lower @ lower.T, matrix, atol=1e-13)
    right = np.random.default_rng(3).normal(size=(size, 4))
    assert np.allclose(factor.back_substitute(factor.reduce(right)), np.linalg.solve(matrix, right), atol=1e-11)
    assert np.allclose(factor.inverse(), np.linalg.inv(matrix), atol=1e-11)


def test_digits_lost_are_those_of_each_pivot():
    matrix = regular(20)
    pivots = np.diag(np.linalg.cholesky(matrix)) ** 2
    assert np.allclose(factorised(matrix).lost_digits, -np.log10(pivots), atol=1e-12)


@pytest.mark.parametrize("size", [12, 80, 150])
def test_as_many_columns_are_removed_as_combinations_are_dependent(size):
    matrix, _ = dependent(size, {5: {0: 1.0, 1: -2.0}, size - 1: {2: 1.0, 3: 1.0, 4: 1.0}})
    factor = factorised(matrix)
    assert np.flatnonzero(factor.removed).tolist() == [5, size - 1]
    assert (factor.lost_digits[factor.removed] > MAX_LOST).all()
    assert factor.lost_digits[~factor.removed].max() < 3.0


def test_solution_with_removed_columns_is_that_of_the_other_unknowns():
    matrix, _ = dependent(90, {7: {0: 1.0, 1: 1.0}, 70: {2: 1.0, 69: -1.0}})
    factor = factorised(matrix)
    kept = ~factor.removed
    right = (matrix @ np.random.default_rng(4).normal(size=(90, 2)))[:, 0]
    solution = factor.back_substitute(factor.reduce(right))
    assert (solution[factor.removed] == 0.0).all()
    assert np.allclose(solution[kept], np.linalg.solve(matrix[np.ix_(kept, kept)], right[kept]), atol=1e-9)
    # a right-hand side of the normal equations: with the dependent columns at zero the residuals are the same
    assert np.allclose(matrix @ solution, right, atol=1e-9)


def test_inverse_has_zeros_for_removed_columns_and_is_the_inverse_of_the_rest():
    matrix, _ = dependent(75, {66: {0: 2.0, 65: 1.0}})
    factor = factorised(matrix)
    inverse, kept = factor.inverse(), ~factor.removed
    assert not inverse[factor.removed].any()
    assert not inverse[:, factor.removed].any()
    assert np.allclose(inverse[np.ix_(kept, kept)], np.linalg.inv(matrix[np.ix_(kept, kept)]), atol=1e-9)


@pytest.mark.parametrize("place", [3, 70, 140])
def test_a_nearly_dependent_column_is_kept(place):
    # 8 digits are lost, less than removal demands
    random = np.random.default_rng(5)
    design = random.normal(size=(500, 150))
    design[:, place] = design[:, 0] + 1e-4 * random.normal(size=500)
    matrix = unit_diagonal(design.T @ design)
    factor = factorised(matrix)
    assert not factor.removed.any()
    assert 7.0 < factor.lost_digits[place] < 9.0
    assert factor.inverse()[place, place] == pytest.approx(np.linalg.inv(matrix)[place, place], rel=1e-6)


@pytest.mark.parametrize("limit", [5.0, 7.0, 9.0, 11.0, 13.0])
def test_the_limit_means_the_same_over_its_range(limit):
    # one movement a digit: pairs of columns that differ by 10^-k, so that the stiffness of their difference is 10^-2k
    random = np.random.default_rng(6)
    design = random.normal(size=(500, 60))
    digits = np.arange(4.0, 16.0)
    for place, lost in enumerate(digits):
        design[:, 20 + place] = design[:, place] + 10.0 ** (-lost / 2.0) * random.normal(size=500)
    factor = factorise(unit_diagonal(design.T @ design), limit, np.zeros(60, dtype=bool))
    # the difference of two columns of unit length, made a unit vector, has half the square of the difference
    wanted = 20 + np.flatnonzero(digits + np.log10(2.0) > limit)
    assert set(np.flatnonzero(factor.removed)) ^ set(wanted) <= {20 + int(limit) - 4}
    assert (factor.lost_digits[factor.removed] > limit - 0.1).all()


def test_of_two_columns_that_are_the_same_and_nearly_a_third_one_is_removed():
    random = np.random.default_rng(7)
    design = random.normal(size=(400, 70))
    design[:, 5] = design[:, 0] + 1e-4 * random.normal(size=400)
    design[:, 69] = design[:, 5]
    factor = factorised(unit_diagonal(design.T @ design))
    assert factor.removed.sum() == 1
    # 5 and 69 are the same: which of them stays is a matter of rounding
    assert factor.removed[[5, 69]].sum() == 1


@pytest.mark.parametrize("soft", [[], [0.5], [0.5, 0.1], [0.5, 0.3, 0.01]])
@pytest.mark.parametrize("next_one", [2.0, 50.0, 1e3, 1e6, 1e12])
def test_movements_are_soft_on_one_side_of_the_limit(soft, next_one):
    size, limit = 60, 1e-8
    random = np.random.default_rng(6)
    axes, _ = np.linalg.qr(random.normal(size=(size, size)))
    stiffness = np.concatenate([limit * np.array([*soft, next_one, 4.0 * next_one]), np.full(size, 1e8 * limit)])[:size]
    found = soft_movements(
        lambda x: axes @ (stiffness[:, None] * (axes.T @ x)),
        lambda x: axes @ ((axes.T @ x) / stiffness[:, None]),
        np.arange(size),
        size,
        limit,
    )
    # the softest movement comes out to many digits, those between it and the next ones to fewer
    assert len(found.stiffness) == len(soft)
    assert np.allclose(np.sort(found.stiffness)[:1], limit * np.array(soft[-1:]), rtol=1e-3)


def test_columns_without_observations_are_removed_at_once():
    matrix = np.zeros((6, 6))
    matrix[np.ix_([0, 2, 3, 5], [0, 2, 3, 5])] = regular(4)
    factor = factorised(matrix, undetermined=(1, 4))
    assert np.flatnonzero(factor.removed).tolist() == [1, 4]
    assert factor.lost_digits[[1, 4]].tolist() == [LOST_ALL, LOST_ALL]
    assert np.diag(factor.lower)[[1, 4]].tolist() == [1.0, 1.0]
    assert np.allclose(factor.inverse()[np.ix_([0, 2, 3, 5], [0, 2, 3, 5])], np.linalg.inv(regular(4)), atol=1e-12)


def test_columns_without_observations_beside_dependent_ones():
    matrix, _ = dependent(40, {30: {0: 1.0, 1: 1.0}})
    padded = np.zeros((42, 42))
    padded[1:41, 1:41] = matrix
    factor = factorised(padded, undetermined=(0, 41))
    assert np.flatnonzero(factor.removed).tolist() == [0, 31, 41]


def test_nothing_is_determined():
    factor = factorised(np.zeros((3, 3)), undetermined=(0, 1, 2))
    assert factor.removed.all()
    assert not factor.inverse().any()
    assert factor.back_substitute(factor.reduce(np.ones(3))).tolist() == [0.0, 0.0, 0.0]


def test_no_unknowns_at_all():
    factor = factorised(np.zeros((0, 0)))
    assert factor.inverse().shape == (0, 0)
    assert factor.back_substitute(factor.reduce(np.zeros(0))).shape == (0,)


def test_reduced_right_hand_side_gives_the_drop_of_the_square_sum():
    matrix = regular(30)
    right = np.random.default_rng(8).normal(size=30)
    reduced = factorised(matrix).reduce(right)
    assert reduced @ reduced == pytest.approx(right @ np.linalg.solve(matrix, right), rel=1e-12)


def test_the_factor_takes_the_place_of_what_is_given():
    matrix, _ = dependent(70, {69: {0: 1.0}})
    factor = factorise(matrix, MAX_LOST, np.zeros(70, dtype=bool))
    assert factor.removed.sum() == 1
    assert np.shares_memory(factor.lower, matrix)


@pytest.mark.parametrize("where", [(3, 3), (5, 2)])
def test_columns_of_a_matrix_that_is_not_finite_are_all_removed(where):
    matrix = regular(12)
    matrix[where] = matrix[where[::-1]] = np.nan
    assert factorised(matrix).removed.all()


def test_a_matrix_that_may_not_be_written_is_copied():
    matrix = regular(30)
    matrix.setflags(write=False)
    factor = factorise(matrix, MAX_LOST, np.zeros(30, dtype=bool))
    assert np.allclose(np.tril(factor.lower) @ np.tril(factor.lower).T, matrix, atol=1e-13)
