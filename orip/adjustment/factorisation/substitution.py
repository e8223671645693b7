"""Symmetric matrices after a linear substitution of their unknowns: T^T N T, and T Q T^T where N has its elements.

Both are formed some columns at a time, with the few rows of T that these need; full matrices at once.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.sparse import csr_array

from orip.adjustment.factorisation.band import Arrangement, BandMatrix, band_of, columns_of, stored_part, zero_matrix
from orip.adjustment.factorisation.cholesky import Symmetric
from orip.adjustment.factorisation.fronts import DissectedMatrix
from orip.arrays import FloatArray, IntArray

_COLUMNS = 192
"""Columns of a band that are taken at once."""


def contracted(matrix: Symmetric, by: csr_array, others: csr_array, arrangement: Arrangement | None) -> Symmetric:
    """Return T^T N T + O.

    Parameters
    ----------
    matrix : array or BandMatrix (h, h)
        N: full, or of a band the lower triangle.
    by : sparse array (h, m)
        T.
    others : sparse array (m, m)
        O.
    arrangement : Arrangement or None
        That of the result: a band if N is one.
    """
    if arrangement is None or not isinstance(matrix, BandMatrix):
        assert isinstance(matrix, np.ndarray), "a full matrix comes from a full one"
        return np.asarray(by.T @ (by.T @ matrix).T + others.toarray())
    found = band_of(others, arrangement)
    ordered = _in_places(by, matrix.arrangement, arrangement)
    for first, panel in _halves(matrix):
        of_columns, of_rows = ordered[first : first + len(panel)], ordered[_rows(matrix, first, panel)]
        used, dense = _dense(of_columns)
        products = np.asarray(of_rows.T @ (panel.T @ dense))
        touched = np.unique(of_rows.indices)
        _add(found, touched, used, products[touched])
    return found


def expanded(inverse: Symmetric, by: csr_array, arrangement: Arrangement | None) -> Symmetric:
    """Return T Q T^T, of a band the elements that are stored.

    Parameters
    ----------
    inverse : array or BandMatrix (m, m)
        Q.
    by : sparse array (h, m)
        T.
    arrangement : Arrangement or None
        That of the result: a band if Q is one.
    """
    assert not isinstance(inverse, DissectedMatrix), "blocks with rigs are not divided"
    if arrangement is None or not isinstance(inverse, BandMatrix):
        assert isinstance(inverse, np.ndarray), "a full matrix comes from a full one"
        return np.ascontiguousarray(by @ (by @ inverse).T)
    found = zero_matrix(arrangement)
    ordered = _in_places(by, arrangement, inverse.arrangement)
    banded, width = arrangement.banded, arrangement.width
    for first in range(0, banded, _COLUMNS):
        count = min(_COLUMNS, banded - first)
        rows = slice(first, min(first + count + width, banded))
        panel = np.zeros((count, count + width))
        panel[:, : rows.stop - first] = _product(inverse, ordered[first : first + count], ordered[rows])
        found.band[first : first + count] = stored_part(panel)
    for first in range(0, len(by.indptr) - 1 if banded < len(found) else 0, 4 * _COLUMNS):
        rows = slice(first, min(first + 4 * _COLUMNS, len(found)))
        found.border[:, rows] = _product(inverse, ordered[banded:], ordered[rows])
    return found


def _in_places(by: csr_array, rows: Arrangement, columns: Arrangement) -> csr_array:
    """Return T with its rows and columns in the order of their places."""
    found = by[rows.columns].tocsr()
    return csr_array((found.data, columns.places[found.indices], found.indptr), shape=found.shape)


def _halves(matrix: BandMatrix) -> Iterator[tuple[int, FloatArray]]:
    """Yield first columns and panels (count, r) whose sum with its transposed is the matrix; rows as `_rows` says."""
    banded = matrix.arrangement.banded
    for first in range(0, banded, _COLUMNS):
        panel = columns_of(matrix.band[first : first + _COLUMNS])[:, : banded - first]
        np.einsum("ii->i", panel[:, : len(panel)])[:] /= 2.0
        yield first, panel
    if banded < len(matrix):
        border = np.tril(matrix.border, banded)
        own = np.arange(len(border))
        border[own, banded + own] /= 2.0
        yield banded, border


def _rows(matrix: BandMatrix, first: int, panel: FloatArray) -> slice:
    """Return the places of the rows of a panel: those from its first column on, or all of the border's."""
    return slice(0, len(matrix)) if first == matrix.arrangement.banded else slice(first, first + panel.shape[1])


def _dense(some: csr_array) -> tuple[IntArray, FloatArray]:
    """Return the columns (u,) of rows (n, m) that are not empty, and the rows over them (n, u)."""
    used, place = np.unique(some.indices, return_inverse=True)
    found = np.zeros((some.shape[0], len(used)))
    found[np.repeat(np.arange(some.shape[0]), np.diff(some.indptr)), place] = some.data
    return used.astype(np.int64), found


def _add(matrix: BandMatrix, rows: IntArray, columns: IntArray, products: FloatArray) -> None:
    """Add P + P^T, of products P (r, c) at some places, to the lower triangle of a band."""
    i, j = np.broadcast_arrays(rows[:, None], columns)
    low, high = np.minimum(i, j), np.maximum(i, j)
    values, banded = np.where(i == j, 2.0 * products, products), matrix.arrangement.banded
    in_border = high >= banded
    np.add.at(matrix.border, (high[in_border] - banded, low[in_border]), values[in_border])
    in_band = ~in_border & (high - low <= matrix.arrangement.width)
    np.add.at(matrix.band, (low[in_band], (high - low)[in_band]), values[in_band])


def _product(inverse: BandMatrix, one: csr_array, other: csr_array) -> FloatArray:
    """Return the elements (a, b) of T Q T^T of some rows (a, m) and columns (b, m) of T; zero where Q is not stored."""
    (rows, by_rows), columns = _dense(one), np.unique(other.indices).astype(np.int64)
    i, j = np.broadcast_arrays(rows[:, None], columns)
    low, high = np.minimum(i, j), np.maximum(i, j)
    banded, found = inverse.arrangement.banded, np.zeros(i.shape)
    in_border = high >= banded
    found[in_border] = inverse.border[high[in_border] - banded, low[in_border]]
    in_band = ~in_border & (high - low <= inverse.arrangement.width)
    found[in_band] = inverse.band[low[in_band], (high - low)[in_band]]
    # the rows of the band that is formed are many, and sparse
    place = np.searchsorted(columns, other.indices)
    sparse = csr_array((other.data, place, other.indptr), shape=(other.shape[0], len(columns)))
    return np.asarray((sparse @ (by_rows @ found).T).T)
