"""Band with a border against full matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from orip.adjustment.factorisation.band import arranged, zero_matrix
from orip.adjustment.factorisation.band_cholesky import factorise_band
from orip.adjustment.factorisation.cholesky import factorise

MAX_LOST = 12.0
NONE = np.zeros(0, dtype=bool)


def chain(groups=100, size=6, reach=2, border=5, seed=1):
    """Return groups of unknowns along a line, each coupled with its neighbours and with a border, shuffled."""
    random = np.random.default_rng(seed)
    count = groups + 1
    touched = np.zeros((groups, count))
    for row in range(groups):
        touched[row, row : min(groups, row + reach)] = 1.0
        touched[row, groups] = 1.0
    order = random.permutation(groups)
    touched = touched[:, np.append(order, groups)]
    group = np.repeat(np.arange(count), [size] * groups + [border])
    design = np.repeat(touched[:, group], 20, axis=0)
    design *= random.normal(size=design.shape)
    normals = design.T @ design
    scale = np.sqrt(np.diag(normals))
    return group, csr_array(touched), normals / np.outer(scale, scale)


def banded(matrix, arrangement):
    made = zero_matrix(arrangement)
    made.add(csr_array(matrix))
    return made


def test_arrangement_is_narrow_and_keeps_every_element():
    group, touched, matrix = chain()
    arrangement = arranged(group, touched)
    assert arrangement.banded == 600
    assert arrangement.width < 30
    assert sorted(arrangement.places) == list(range(605))
    made = banded(matrix, arrangement)
    assert np.array_equal(made.toarray(), matrix)
    assert np.array_equal(made.diagonal(), np.diag(matrix))
    vectors = np.random.default_rng(7).normal(size=(len(matrix), 3))
    assert np.allclose(made.times(vectors), matrix @ vectors, atol=1e-12)
    assert np.array_equal(made[np.arange(6)[:, None], np.arange(6)], matrix[:6, :6])
    less = banded(matrix, arrangement)
    less.subtract_product(vectors, vectors)
    rows, columns = np.nonzero(matrix)
    assert np.allclose(less[rows, columns], (matrix - vectors @ vectors.T)[rows, columns], atol=1e-12)
    factors = np.random.default_rng(2).uniform(0.5, 2.0, len(matrix))
    made.scale(factors)
    assert np.allclose(made.toarray(), matrix * np.outer(factors, factors), rtol=1e-14)
    far = np.argmax(np.abs(arrangement.places - arrangement.places[0]) * (arrangement.places < 600))
    with pytest.raises(IndexError, match="no observation in common"):
        made[np.array([0]), np.array([far])]


def test_small_and_wide_systems_stay_full():
    group, touched, _ = chain(groups=20)
    assert arranged(group, touched) is None
    assert arranged(np.repeat(np.arange(100), 6), csr_array(np.ones((1, 100)))) is None


@pytest.mark.parametrize("border", [5, 0])
def test_solution_and_selected_inverse_are_those_of_the_full_matrix(border):
    group, touched, matrix = chain(border=border)
    arrangement = arranged(group, touched)
    none = np.zeros(len(matrix), dtype=bool)
    found = factorise_band(banded(matrix, arrangement), MAX_LOST, none)
    right = np.random.default_rng(3).normal(size=(len(matrix), 2))
    for side in (right, right[:, 0]):
        reduced = found.reduce(side)
        wanted = np.linalg.solve(matrix, side)
        assert np.allclose(found.back_substitute(reduced), wanted, rtol=1e-9, atol=1e-9)
        assert np.allclose(np.sum(reduced**2, axis=0), np.sum(side * wanted, axis=0), rtol=1e-9)
    inverse = np.linalg.inv(matrix)
    selected = found.inverse()
    coupled = np.nonzero(matrix)
    assert np.allclose(selected[coupled], inverse[coupled], rtol=1e-8, atol=1e-9)


def test_columns_without_observations_are_left_out():
    group, touched, matrix = chain()
    empty = np.zeros(len(matrix), dtype=bool)
    empty[[7, 100, 602]] = True
    matrix[empty] = 0.0
    matrix[:, empty] = 0.0
    found = factorise_band(banded(matrix, arranged(group, touched)), MAX_LOST, empty)
    right = np.random.default_rng(4).normal(size=len(matrix))
    solution = found.back_substitute(found.reduce(right))
    assert not solution[empty].any()
    used = np.ix_(~empty, ~empty)
    assert np.allclose(solution[~empty], np.linalg.solve(matrix[used], right[~empty]), rtol=1e-9, atol=1e-9)
    assert found.removed[empty].all()
    assert not found.inverse().diagonal()[empty].any()
    assert np.allclose(found.inverse().diagonal()[~empty], np.diag(np.linalg.inv(matrix[used])), rtol=1e-8)


def weakened(matrix, pairs, digits):
    """Return the matrix in which the second unknown of a pair is the first one up to a part of 10^(-digits / 2)."""
    mix = np.eye(len(matrix))
    for one, other in pairs:
        mix[:, other] = mix[:, one] + 10.0 ** (-digits / 2.0) * mix[:, other]
    weak = mix.T @ matrix @ mix
    scale = np.sqrt(np.diag(weak))
    return weak / np.outer(scale, scale)


PAIRS = {"in a group": [(12, 13)], "several": [(12, 13), (13, 14), (300, 302)], "in the border": [(600, 601)]}


@pytest.mark.parametrize("pairs", PAIRS)
def test_weak_columns_are_kept(pairs):
    group, touched, matrix = chain()
    weak = weakened(matrix, PAIRS[pairs], 7.0)
    none = np.zeros(len(matrix), dtype=bool)
    found = factorise_band(banded(weak, arranged(group, touched)), MAX_LOST, none)
    full = factorise(weak.copy(), MAX_LOST, none)
    assert not found.removed.any()
    assert not full.removed.any()
    right = weak @ np.random.default_rng(5).normal(size=len(weak))
    # seven lost digits leave nine
    assert np.allclose(
        found.back_substitute(found.reduce(right)), full.back_substitute(full.reduce(right)), rtol=1e-7, atol=1e-7
    )
    wanted = full.inverse()
    coupled = np.nonzero(weak)
    assert np.allclose(found.inverse()[coupled], wanted[coupled], rtol=1e-7, atol=1e-7 * np.abs(wanted).max())


@pytest.mark.parametrize("pairs", PAIRS)
def test_the_full_matrix_names_the_same_columns_as_not_determined(pairs):
    group, touched, matrix = chain()
    singular = weakened(matrix, PAIRS[pairs], 40.0)
    arrangement = arranged(group, touched)
    none = np.zeros(len(matrix), dtype=bool)
    found = factorise_band(banded(singular, arrangement), MAX_LOST, none)
    full = factorise(singular.copy(), MAX_LOST, none)
    assert found.removed.sum() == len(PAIRS[pairs])
    assert np.array_equal(found.removed, full.removed)
    assert (found.lost_digits[found.removed] > MAX_LOST).all()
    right = singular @ np.random.default_rng(5).normal(size=len(matrix))
    solution = found.back_substitute(found.reduce(right))
    assert not solution[found.removed].any()
    assert np.allclose(singular @ solution, right, atol=1e-9)
    assert not found.inverse().diagonal()[found.removed].any()
    kept = ~found.removed
    wanted = np.diag(np.linalg.inv(singular[np.ix_(kept, kept)]))
    assert np.allclose(found.inverse().diagonal()[kept], wanted, rtol=1e-7)


@pytest.mark.slow
def test_many_columns_that_are_not_determined_stay_a_band():
    group, touched, matrix = chain(groups=150)
    random = np.random.default_rng(6)
    # nothing tells the second unknown of a group from the first one, in forty of the groups
    pairs = [(6 * int(group), 6 * int(group) + 1) for group in random.choice(150, 40, replace=False)]
    singular = weakened(matrix, pairs, 40.0)
    arrangement = arranged(group, touched)
    none = np.zeros(len(matrix), dtype=bool)
    found = factorise_band(banded(singular, arrangement), MAX_LOST, none)
    full = factorise(singular.copy(), MAX_LOST, none)
    assert sorted(np.flatnonzero(found.removed)) == sorted(other for _, other in pairs)
    assert np.array_equal(found.removed, full.removed)
