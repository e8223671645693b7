"""A design matrix that is stored: sparse products give the normal equations and the precision."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.sparse import csr_array

from orip.adjustment.equations import BlockNormals, BlockPrecision, Layout
from orip.adjustment.factorisation.band import band_of
from orip.adjustment.factorisation.cholesky import Symmetric
from orip.adjustment.factorisation.elimination import (
    BlockFactors,
    Coupling,
    EliminatedNormals,
    StoredCoupling,
    block_diagonal,
    factorise_blocks,
)
from orip.adjustment.factorisation.null_space import Amounts
from orip.arrays import FloatArray, IntArray

_CHUNK_NUMBERS = 4_000_000
"""Numbers gathered at a time, which bounds the memory of the blockwise products."""


class SparseRows(Struct, frozen=True):
    """Rows of the design matrix as a sparse matrix (n, m + 3 b)."""

    stored: csr_array

    def matrix(self) -> csr_array:
        """Return the design matrix."""
        return self.stored

    def some(self, chosen: IntArray) -> csr_array:
        """Return some rows of the design matrix."""
        return self.stored[chosen]

    def eliminated(
        self, weights: FloatArray, residual: FloatArray, layout: Layout, max_lost_digits: float, damping: float
    ) -> EliminatedNormals:
        """Return the weighted normal equations with their blocks eliminated."""
        root_weights = np.sqrt(weights)
        weighted, misclosure = scale_rows(self.stored, root_weights), -residual * root_weights
        reduced_design, block_design = weighted[:, : layout.reduced], weighted[:, layout.reduced :]
        complete = (reduced_design.T @ reduced_design).tocsr()
        fixed_places = layout.fixed[layout.reduced :].reshape(-1, 3)
        blocks = diagonal_blocks(block_design) * (1.0 + damping * np.eye(3))
        factors = factorise_blocks(blocks, _full_diagonals(block_design), fixed_places, max_lost_digits)
        half = block_diagonal(factors.half)
        coupling = (half @ (block_design.T @ reduced_design)).tocsr()
        block_right = half @ (block_design.T @ misclosure)
        matrix = (complete - coupling.T @ coupling).tocsr()
        return EliminatedNormals(
            matrix=matrix.toarray() if layout.arrangement is None else band_of(matrix, layout.arrangement),
            right=reduced_design.T @ misclosure - coupling.T @ block_right,
            diagonal=complete.diagonal(),
            blocks=factors,
            coupling=StoredCoupling(coupling, factors.half),
            block_right=block_right,
        )

    def block_normals(self, root_weights: FloatArray, misclosure: FloatArray, layout: Layout) -> BlockNormals:
        """Return the normal equations of the blocks alone."""
        block_design = scale_rows(self.stored, root_weights)[:, layout.reduced :]
        block_of_row = _blocks_of_rows(block_design)
        touching = block_of_row >= 0
        sums = np.zeros(layout.blocks)
        np.add.at(sums, block_of_row[touching], misclosure[touching] ** 2)
        return BlockNormals(diagonal_blocks(block_design), block_design.T @ misclosure, sums)

    def right_side(self, root_weights: FloatArray, misclosure: FloatArray, layout: Layout) -> FloatArray:
        """Return the right-hand side of the normal equations."""
        del layout
        return np.asarray(self.stored.T @ (root_weights * misclosure))

    def precision(
        self, factors: BlockFactors, coupling: Coupling, inverse: Symmetric, amounts: Amounts | None
    ) -> BlockPrecision:
        """Return cofactors of the blocks and leverages."""
        assert isinstance(coupling, StoredCoupling), "the normal equations are those of these rows"
        half, stored = factors.half, coupling.matrix
        inner = np.eye(3) + _quadratic_blocks(stored, inverse, len(half))
        blocks = np.swapaxes(half, 1, 2) @ inner @ half
        if amounts is not None:
            amounts.transform_blocks(blocks, half, stored)
        return BlockPrecision(blocks, self.leverages(factors, stored, inverse))

    def leverages(self, factors: BlockFactors, coupling: csr_array, inverse: Symmetric) -> FloatArray:
        """Return h = a Q a^T of each row a, from the row freed of its point."""
        reduced = len(inverse)
        in_blocks = self.stored[:, reduced:] @ block_diagonal(np.swapaxes(factors.half, 1, 2))
        freed = (self.stored[:, :reduced] - in_blocks @ coupling).tocsr()
        of_points = in_blocks.multiply(in_blocks).sum(axis=1)
        return quadratic_rows(freed, inverse) + np.asarray(of_points, dtype=np.float64).ravel()


def scale_rows(matrix: csr_array, factors: FloatArray) -> csr_array:
    """Return the matrix with each row multiplied by its factor; the pattern is kept, zeros included."""
    data = matrix.data * np.repeat(factors, np.diff(matrix.indptr))
    return csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)


def diagonal_blocks(block_design: csr_array) -> FloatArray:
    """Return the 3 x 3 diagonal blocks (b, 3, 3) of D^T D, for rows that each touch one block at most."""
    elements = block_design.tocoo()
    return squared_blocks(elements.row, elements.col, elements.data, block_design.shape[1] // 3)


def squared_blocks(row: IntArray, column: IntArray, value: FloatArray, count: int) -> FloatArray:
    """Return what `diagonal_blocks` returns, of `count` blocks, from the elements of D."""
    rows = int(row.max(initial=-1)) + 1
    dense, block_of_row = np.zeros((rows, 3)), np.full(rows, -1)
    dense[row, column % 3] = value
    block_of_row[row] = column // 3
    used = block_of_row >= 0
    result = np.zeros((count, 3, 3))
    np.add.at(result, block_of_row[used], dense[used][:, :, None] * dense[used][:, None, :])
    return result


def _full_diagonals(block_design: csr_array) -> FloatArray:
    """Return for each coordinate (b, 3) the squares of all rows of D in which it occurs; see `factorise_blocks`."""
    coordinates = block_design.tocoo()
    squares = np.bincount(coordinates.row, coordinates.data**2, block_design.shape[0])
    sums = np.bincount(coordinates.col, squares[coordinates.row], block_design.shape[1])
    return np.asarray(sums.reshape(-1, 3), dtype=np.float64)


def _blocks_of_rows(block_design: csr_array) -> NDArray[np.int64]:
    """Return the block that each row touches, -1 for none."""
    coordinates = block_design.tocoo()
    block = np.full(block_design.shape[0], -1)
    block[coordinates.row] = coordinates.col // 3
    return block


def _groups_by_length(indptr: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield (number of columns k, rows that have k of them), in pieces of bounded memory."""
    lengths = np.diff(indptr)
    for length in np.unique(lengths[lengths > 0]):
        rows = np.flatnonzero(lengths == length)
        piece = max(1, _CHUNK_NUMBERS // int(length * length))
        for start in range(0, len(rows), piece):
            yield int(length), rows[start : start + piece]


def quadratic_rows(matrix: csr_array, inner: Symmetric) -> FloatArray:
    """Return a Q a^T for each row a of a sparse matrix."""
    result = np.zeros(matrix.shape[0])
    for length, rows in _groups_by_length(matrix.indptr):
        places = matrix.indptr[rows][:, None] + np.arange(length)
        columns, values = matrix.indices[places], matrix.data[places]
        gathered = inner[columns[:, :, None], columns[:, None, :]]
        result[rows] = np.einsum("ni,nij,nj->n", values, gathered, values, optimize=True)
    return result


def _quadratic_blocks(matrix: csr_array, inner: Symmetric, count: int) -> FloatArray:
    """Return B Q B^T (count, 3, 3) for each triple of rows B of a sparse matrix."""
    result = np.zeros((count, 3, 3))
    if not count:
        return result
    triples = matrix.tobsr(blocksize=(3, 1))
    for length, blocks in _groups_by_length(triples.indptr):
        places = triples.indptr[blocks][:, None] + np.arange(length)
        columns = triples.indices[places]
        values = triples.data[places][:, :, :, 0]
        gathered = inner[columns[:, :, None], columns[:, None, :]]
        result[blocks] = np.einsum("nia,nij,njb->nab", values, gathered, values, optimize=True)
    return result
