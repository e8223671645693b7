"""Point blocks of three unknowns, eliminated together, and symmetric matrices after a linear substitution of unknowns.

Each block is factored with diagonal pivoting, so that a coordinate that nothing determines (the depth of a point with
one ray) is found by the digits its pivot loses, and is removed alone. It is scaled by the diagonal it would have if
every ray were square to all axes: a diagonal of its own would be scaled to 1 even where it is nothing but rounding, as
along the base of two photos for a point on that line.

Both are formed some columns at a time, with the few rows of T that these need; full matrices at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Protocol

import numpy as np
from msgspec import Struct
from scipy.sparse import bsr_array, csr_array

from orip.adjustment.factorisation.band import Arrangement, BandMatrix, band_of, columns_of, stored_part, zero_matrix
from orip.adjustment.factorisation.cholesky import Symmetric
from orip.adjustment.factorisation.fronts import DissectedMatrix
from orip.adjustment.factorisation.null_space import LOST_ALL, MovementSums, PointMovements, movement_sums
from orip.arrays import BoolArray, FloatArray, IntArray, parts
from orip.threads import by_threads

_AS_LARGE = 1e-9
"""Pivots that differ by less than this part are taken in order: rounding must not decide which is removed."""


class BlockFactors(Struct, frozen=True):
    """Factors of b blocks.

    Parameters
    ----------
    half : array (b, 3, 3)
        H with H^T H = inverse of the block; rows of removed coordinates are zero.
    pivots : array (b, 3)
        What remained of each coordinate's diagonal element at its turn, as a part of its full diagonal; 1 if fixed.
    removed : array (b, 3) of bool
    """

    half: FloatArray
    pivots: FloatArray
    removed: BoolArray

    @property
    def lost_digits(self) -> FloatArray:
        """Return the digits (b, 3) that each coordinate lost; `LOST_ALL` where nothing was left."""
        left = self.pivots > 0.0
        return np.where(left, -np.log10(np.where(left, self.pivots, 1.0)), LOST_ALL)


class Coupling(Protocol):
    """H N_pr (3 b, m): the eliminated points' rows of the triangular factor. It need not be stored."""

    def times(self, reduced: FloatArray) -> FloatArray:
        """Return it times vectors (m,) or (m, k)."""

    def transposed_times(self, points: FloatArray) -> FloatArray:
        """Return its transpose times vectors (3 b,) or (3 b, k)."""

    def of_blocks(self, chosen: IntArray) -> csr_array:
        """Return the rows (3 c, m) of some blocks (c,), which are in ascending order."""

    def movement_sums(self, points: PointMovements) -> MovementSums:
        """Return what the points contribute to the amounts of movements."""


class StoredCoupling(Struct, frozen=True):
    """Coupling as a sparse matrix (3 b, m).

    Parameters
    ----------
    matrix : sparse array (3 b, m)
    half : array (b, 3, 3)
        H.
    """

    matrix: csr_array
    half: FloatArray

    def times(self, reduced: FloatArray) -> FloatArray:
        """Return it times vectors (m,) or (m, k)."""
        return np.asarray(self.matrix @ reduced)

    def transposed_times(self, points: FloatArray) -> FloatArray:
        """Return its transpose times vectors (3 b,) or (3 b, k)."""
        return np.asarray(self.matrix.T @ points)

    def of_blocks(self, chosen: IntArray) -> csr_array:
        """Return the rows (3 c, m) of some blocks (c,), which are in ascending order."""
        return csr_array(self.matrix[(3 * chosen[:, None] + np.arange(3)).ravel()])

    def movement_sums(self, points: PointMovements) -> MovementSums:
        """Return what the points contribute to the amounts of movements."""
        return movement_sums(points, self.half, self.matrix)


class EliminatedNormals(Struct, frozen=True):
    """Normal equations with all blocks eliminated: the reduced system, and what leads back to the blocks.

    Parameters
    ----------
    matrix : array, BandMatrix or DissectedMatrix (m, m)
        Of the reduced system.
    right : array (m,)
    diagonal : array (m,)
        Of the reduced unknowns in the complete matrix, before any elimination.
    blocks : BlockFactors
    coupling : Coupling
    block_right : array (3 b,)
        H times the blocks' right-hand side.
    """

    matrix: Symmetric
    right: FloatArray
    diagonal: FloatArray
    blocks: BlockFactors
    coupling: Coupling
    block_right: FloatArray


def factorise_blocks(
    blocks: FloatArray, full_diagonal: FloatArray, fixed: BoolArray, max_lost_digits: float
) -> BlockFactors:
    """Factor symmetric 3 x 3 blocks.

    Parameters
    ----------
    blocks : array (b, 3, 3)
        Blocks of the normal equations; rows and columns of fixed coordinates are ignored.
    full_diagonal : array (b, 3)
        For each coordinate the squares of all partials by the block, summed over the observations that depend on it.
    fixed : array (b, 3) of bool
        Coordinates that are no unknowns.
    max_lost_digits : float

    Returns
    -------
    BlockFactors
    """
    count = len(blocks)
    diagonal = np.einsum("bii->bi", blocks)
    empty = ~fixed & (diagonal <= 0.0)
    scale = np.where(fixed | empty, 0.0, 1.0 / np.sqrt(np.where(diagonal > 0.0, full_diagonal, 1.0)))
    remainder = blocks * scale[:, :, None] * scale[:, None, :]
    # rows of `half` are L^-1 in the order of elimination, grown beside the remainder
    accumulated = np.broadcast_to(np.eye(3), (count, 3, 3)).copy()
    half = np.zeros((count, 3, 3))
    kept = np.where(empty, 0.0, 1.0)
    removed = empty.copy()
    open_places = ~fixed & ~empty
    every = np.arange(count)
    for step in range(3):
        pivots = np.where(open_places, np.einsum("bii->bi", remainder), -np.inf)
        largest = pivots.max(axis=1, keepdims=True)
        place = (pivots >= largest - _AS_LARGE * np.abs(largest)).argmax(axis=1)
        pivot = pivots[every, place]
        has_turn = open_places.any(axis=1)
        sound = has_turn & (pivot >= 10.0**-max_lost_digits)
        undetermined = has_turn & ~sound
        kept[every[has_turn], place[has_turn]] = pivot[has_turn]
        removed[every[undetermined], place[undetermined]] = True
        open_places[every[has_turn], place[has_turn]] = False

        row = np.where(sound[:, None], remainder[every, place], 0.0)
        root = np.sqrt(np.where(sound, pivot, 1.0))
        half[:, step] = np.where(sound[:, None], accumulated[every, place] / root[:, None], 0.0)
        multiplier = row / root[:, None] ** 2
        remainder -= multiplier[:, :, None] * row[:, None, :]
        # the pivot's own row must not be changed by itself: its multiplier is 1
        accumulated -= multiplier[:, :, None] * np.where(sound[:, None], accumulated[every, place], 0.0)[:, None, :]
    return BlockFactors(half * scale[:, None, :], kept, removed)


def times_half(half: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return H v (3 b,) or (3 b, k) for blocks H (b, 3, 3)."""
    by_block = vectors.reshape(len(half), 3, *vectors.shape[1:])
    product = np.empty(by_block.shape)

    def multiply(part: slice) -> None:
        if vectors.ndim == 1:
            np.einsum("bij,bj->bi", half[part], by_block[part], out=product[part])
        else:
            np.matmul(half[part], by_block[part], out=product[part])

    by_threads(multiply, parts(len(half)))
    return product.reshape(vectors.shape)


def times_transposed_half(half: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return H^T v (3 b,) or (3 b, k) for blocks H (b, 3, 3)."""
    return times_half(np.swapaxes(half, 1, 2), vectors)


def block_diagonal(blocks: FloatArray) -> bsr_array:
    """Return b blocks (b, 3, 3) as a sparse block-diagonal matrix."""
    count = len(blocks)
    return bsr_array((blocks, np.arange(count), np.arange(count + 1)), shape=(3 * count, 3 * count))


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
