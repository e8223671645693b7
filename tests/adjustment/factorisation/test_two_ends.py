"""The factor of a band begun at both ends, against full matrices."""

from __future__ import annotations

import numpy as np
import pytest

from orip.adjustment.factorisation.band import add_product
from orip.adjustment.factorisation.band_cholesky import factorise_from_both_ends
from orip.arrays import FloatArray


def band_of(matrix: FloatArray, width: int) -> FloatArray:
    """Return the lower band of a matrix by columns; what is beyond its last row must not matter."""
    band = np.full((len(matrix), width + 1), np.nan)
    for below in range(width + 1):
        band[: len(matrix) - below, below] = np.diag(matrix, -below)
    return band


def positive_band(count: int, width: int) -> FloatArray:
    """Return a positive definite matrix of a condition of some hundred."""
    random = np.random.default_rng([count, width])
    lower = np.tril(np.triu(random.normal(size=(count, count)), -width), -1) / np.sqrt(width)
    lower += np.diag(random.uniform(1.0, 2.0, count))
    return np.asarray(lower @ lower.T)


SIZES = [(2, 1), (9, 8), (40, 20), (41, 20), (60, 20), (200, 7), (333, 70), (700, 1), (300, 150)]
"""Number of unknowns and width: with halves of nothing, shorter and longer than the middle, and of several panels."""


@pytest.mark.parametrize(("count", "width"), SIZES)
def test_solution_pivots_and_inverse_are_those_of_the_full_matrix(count: int, width: int) -> None:
    matrix = positive_band(count, width)
    found = factorise_from_both_ends(band_of(matrix, width))
    assert found is not None
    right = np.random.default_rng(1).normal(size=(count, 3))
    for side in (right, right[:, 0]):
        wanted = np.linalg.solve(matrix, side)
        reduced = found.reduce(side)
        # the condition takes three of sixteen digits
        assert np.allclose(found.back_substitute(reduced), wanted, rtol=1e-11, atol=1e-11 * np.abs(wanted).max())
        assert np.allclose(np.sum(reduced**2, axis=0), np.sum(side * wanted, axis=0), rtol=1e-11)
    assert 2.0 * np.log(found.diagonal).sum() == pytest.approx(np.linalg.slogdet(matrix)[1], rel=1e-11)
    inverse, wanted = found.inverse(), np.linalg.inv(matrix)
    for below in range(width + 1):
        kept = inverse[: count - below, below]
        assert np.allclose(kept, np.diag(wanted, -below), rtol=1e-10, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.parametrize("place", [0, 30, 99, 100, 150, 199])
def test_a_band_that_is_not_positive_definite_has_no_factor(place: int) -> None:
    matrix = positive_band(200, 20)
    matrix[place, place] = -1.0
    assert factorise_from_both_ends(band_of(matrix, 20)) is None


def test_a_product_is_added_within_the_band() -> None:
    matrix = positive_band(150, 9)
    factors = np.random.default_rng(2).normal(size=(150, 4))
    band = band_of(matrix, 9)
    add_product(band, factors, factors)
    wanted = band_of(matrix + factors @ factors.T, 9)
    inside = np.isfinite(wanted)
    assert np.allclose(band[inside], wanted[inside], rtol=1e-13, atol=1e-13)
