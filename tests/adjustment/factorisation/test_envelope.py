"""Wide bands whose columns reach differently far, against full matrices."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import csr_array

from orip.adjustment.factorisation.band import Arrangement, BandMatrix, arranged, zero_matrix
from orip.adjustment.factorisation.band_cholesky import factorise_band
from orip.adjustment.factorisation.cholesky import factorise
from orip.adjustment.factorisation.lapack import COLUMNS, effort_of, factorise_envelope, reach_of_panels, width_of
from orip.arrays import FloatArray, IntArray
from orip.threads import limited_threads

MAX_LOST = 12.0


def closed_ring(
    groups: int = 220, size: int = 3, reach: int = 30, border: int = 5
) -> tuple[IntArray, csr_array, FloatArray]:
    """Return groups of unknowns around a ring, coupled with neighbours and with a border, in random order."""
    random = np.random.default_rng(1)
    touched = np.zeros((groups, groups + 1))
    for row in range(groups):
        touched[row, (row + np.arange(reach)) % groups] = 1.0
    touched[:, :groups] = touched[:, random.permutation(groups)]
    touched[:, groups] = 1.0
    group = np.repeat(np.arange(groups + 1), [size] * groups + [border])
    design = np.repeat(touched[:, group], 12, axis=0)
    design *= random.normal(size=design.shape)
    normals = design.T @ design
    scale = np.sqrt(np.diag(normals))
    return group, csr_array(touched), normals / np.outer(scale, scale)


def wide_band(matrix: FloatArray, arrangement: Arrangement | None) -> BandMatrix:
    assert arrangement is not None
    assert arrangement.reach is not None
    made = zero_matrix(arrangement)
    made.add(csr_array(matrix))
    return made


def test_a_ring_is_folded_into_a_wide_band() -> None:
    group, touched, matrix = closed_ring()
    arrangement = arranged(group, touched)
    made = wide_band(matrix, arrangement)
    assert arrangement is not None
    assert arrangement.reach is not None
    assert arrangement.banded == 660
    assert sorted(arrangement.places) == list(range(665))
    # each photo of a ring is coupled with 29 on either side; folded, 58 photos come after one, and those of its panel
    assert arrangement.width < 3 * 58 + COLUMNS + 24
    assert np.array_equal(made.toarray(), matrix)
    assert np.array_equal(made.diagonal(), np.diag(matrix))
    factors = np.random.default_rng(2).uniform(0.5, 2.0, len(matrix))
    made.scale(factors)
    assert np.allclose(made.toarray(), matrix * np.outer(factors, factors), rtol=1e-14)
    vectors = np.random.default_rng(7).normal(size=(len(matrix), 3))
    less = wide_band(matrix, arrangement)
    less.subtract_product(vectors, vectors)
    coupled = np.nonzero(matrix)
    assert np.allclose(less[coupled], (matrix - vectors @ vectors.T)[coupled], atol=1e-12)
    last = int(np.argmax(arrangement.places * (arrangement.places < 660)))
    first = int(np.argmin(arrangement.places))
    with pytest.raises(IndexError, match="no observation in common"):
        made[np.array([first]), np.array([last])]


def test_where_all_are_coupled_the_matrix_stays_full() -> None:
    group, touched, _ = closed_ring(reach=140)
    assert arranged(group, touched) is None


def test_solution_and_selected_inverse_are_those_of_the_full_matrix() -> None:
    group, touched, matrix = closed_ring()
    found = factorise_band(wide_band(matrix, arranged(group, touched)), MAX_LOST, np.zeros(len(matrix), dtype=bool))
    right = np.random.default_rng(3).normal(size=(len(matrix), 2))
    for side in (right, right[:, 0]):
        reduced, wanted = found.reduce(side), np.linalg.solve(matrix, side)
        # the condition takes four of sixteen digits
        assert np.allclose(found.back_substitute(reduced), wanted, rtol=1e-9, atol=1e-9)
        assert np.allclose(np.sum(reduced**2, axis=0), np.sum(side * wanted, axis=0), rtol=1e-9)
    coupled = np.nonzero(matrix)
    assert np.allclose(found.inverse()[coupled], np.linalg.inv(matrix)[coupled], rtol=1e-8, atol=1e-9)


def test_the_full_matrix_names_the_same_columns_as_not_determined() -> None:
    group, touched, matrix = closed_ring()
    mix = np.eye(len(matrix))
    mix[:, 13], mix[:, 302] = mix[:, 12], mix[:, 300]
    singular = mix.T @ matrix @ mix
    scale = np.sqrt(np.diag(singular))
    singular /= np.outer(scale, scale)
    empty = np.zeros(len(matrix), dtype=bool)
    empty[500] = True
    singular[empty] = singular[:, empty] = 0.0
    found = factorise_band(wide_band(singular, arranged(group, touched)), MAX_LOST, empty)
    full = factorise(singular.copy(), MAX_LOST, empty)
    assert found.removed.sum() == 3
    assert np.array_equal(found.removed, full.removed)
    kept = ~found.removed
    wanted = np.diag(np.linalg.inv(singular[np.ix_(kept, kept)]))
    assert not found.inverse().diagonal()[~kept].any()
    assert np.allclose(found.inverse().diagonal()[kept], wanted, rtol=1e-7)


@pytest.mark.parametrize("count", [1, COLUMNS - 1, COLUMNS, 2 * COLUMNS + 1])
def test_columns_of_all_lengths(count: int) -> None:
    random = np.random.default_rng(count)
    last = np.minimum(np.arange(count) + random.integers(0, 90, size=count), count - 1)
    reach = reach_of_panels(last)
    lower = np.tril(random.normal(size=(count, count))) / np.sqrt(count) + 2.0 * np.eye(count)
    lower[np.arange(count)[:, None] >= reach] = 0.0
    matrix = lower @ lower.T
    band = np.full((count, width_of(reach) + 1), np.nan)
    for column in range(count):
        rows = matrix[column : column + band.shape[1], column]
        band[column, : len(rows)] = rows
    found = factorise_envelope(band, reach)
    assert found is not None
    side = random.normal(size=count)
    wanted = np.linalg.solve(matrix, side)
    # the condition takes two of sixteen digits
    assert np.allclose(found.back_substitute(found.reduce(side)), wanted, rtol=1e-12, atol=1e-12 * np.abs(wanted).max())
    assert 2.0 * np.log(found.diagonal).sum() == pytest.approx(np.linalg.slogdet(matrix)[1], rel=1e-11)
    inverse, every = found.inverse(), np.linalg.inv(matrix)
    for column, end in enumerate(reach):
        assert np.allclose(inverse[column, : end - column], every[column:end, column], atol=1e-12 * np.abs(every).max())
    assert 0.0 < effort_of(reach) <= (COLUMNS + 90 + COLUMNS) ** 2 * count


def test_a_factor_is_the_same_on_any_number_of_threads() -> None:
    count = 6 * COLUMNS + 17  # several strips below a panel
    random = np.random.default_rng(4)
    reach = reach_of_panels(np.full(count, count - 1))
    matrix = random.normal(size=(count, count))
    matrix = matrix @ matrix.T / count + 2.0 * np.eye(count)
    band = np.zeros((count, width_of(reach) + 1))
    for column in range(count):
        band[column, : count - column] = matrix[column:, column]
    factors = []
    for threads in (1, 2, 5):
        with limited_threads(threads):
            found = factorise_envelope(band, reach)
        assert found is not None
        factors.append([found.band[column, : count - column].tobytes() for column in range(count)])
    assert factors[0] == factors[1] == factors[2]
    wanted = np.linalg.cholesky(matrix)
    assert np.allclose(np.frombuffer(b"".join(factors[0])), wanted.T[np.triu_indices(count)], rtol=1e-11, atol=1e-13)


def test_an_envelope_that_is_not_positive_definite_has_no_factor() -> None:
    reach = reach_of_panels(np.minimum(np.arange(300) + 40, 299))
    band = np.zeros((300, 300))
    band[:, 0] = 1.0
    for bad in (-1.0, np.nan):
        band[200, 0] = bad
        assert factorise_envelope(band, reach) is None
