"""A design matrix whose rows of photo points are computed where they are needed, and the unknowns that they couple."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Protocol

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.sparse import csr_array

from orip.adjustment.equations import BlockNormals, BlockPrecision, Layout
from orip.adjustment.factorisation.cholesky import Symmetric
from orip.adjustment.factorisation.elimination import BlockFactors, Coupling, EliminatedNormals, block_diagonal
from orip.adjustment.factorisation.null_space import Amounts
from orip.adjustment.sparse_rows import SparseRows, quadratic_rows, squared_blocks
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.compiled.photo_loop import Contributions
from orip.bundle.kinds.photo_point import PhotoPointObservations
from orip.bundle.state import BlockState
from orip.bundle.unknowns import CONSTANT, Unknowns


class PointLoop(Protocol):
    """What passes over the photo points of a block, in one process or in several; see `PhotoPointLoop`."""

    @property
    def points(self) -> PhotoPointObservations:
        """Return the photo points."""

    def staying(self) -> NDArray[np.int64]:
        """Return the rows of photo points of points that are not eliminated."""

    def residuals(self, state: BlockState, others: int = 0) -> tuple[FloatArray, BoolArray]:
        """Return residuals divided by their a-priori errors, and which of them can be computed.

        Arrays (2 n + others,): those of further observations, which the caller fills in, come last.
        """

    def block_normals(
        self, state: BlockState, root_weights: FloatArray, misclosure: FloatArray, others: BlockNormals, layout: Layout
    ) -> BlockNormals:
        """Return the normal equations of the points."""

    def right_side(
        self, state: BlockState, root_weights: FloatArray, misclosure: FloatArray, others: FloatArray, layout: Layout
    ) -> FloatArray:
        """Return the right-hand side (m + 3 b,) of photo points, and of others, with nothing eliminated."""

    def eliminate(
        self,
        state: BlockState,
        weights: FloatArray,
        residual: FloatArray,
        others: Contributions,
        layout: Layout,
        max_lost_digits: float,
        damping: float,
    ) -> EliminatedNormals:
        """Return the normal equations of photo points and `others`, points eliminated."""

    def precision(self, coupling: Coupling, inverse: Symmetric, amounts: Amounts | None) -> BlockPrecision:
        """Return cofactors (b, 3, 3) of the points and leverages (2 n,)."""


class StreamedRows(Struct, frozen=True):
    """Rows of the design matrix of a block at a state; photo points come first.

    Parameters
    ----------
    loop : PointLoop
    state : BlockState
    others : SparseRows
        Rows that the loop does not compute; each touches either reduced unknowns or one point.
    other_rows : array (k,) of int
        Their numbers among all rows.
    complete : callable
        Returns the whole matrix.
    """

    loop: PointLoop
    state: BlockState
    others: SparseRows
    other_rows: NDArray[np.int64]
    complete: Callable[[BlockState], csr_array]

    def matrix(self) -> csr_array:
        """Return the design matrix."""
        return self.complete(self.state)

    def some(self, chosen: IntArray) -> csr_array:
        """Return some rows of the design matrix; it is computed only if photo points are among them."""
        stored = np.isin(chosen, self.other_rows).all()
        return self.others.some(np.searchsorted(self.other_rows, chosen)) if stored else self.matrix()[chosen]

    def eliminated(
        self, weights: FloatArray, residual: FloatArray, layout: Layout, max_lost_digits: float, damping: float
    ) -> EliminatedNormals:
        """Return the weighted normal equations with their blocks eliminated."""
        stored = self.others.stored
        # sparse slices and products of a handful of rows would take longer than all photo points of a small block
        row = np.repeat(np.arange(len(self.other_rows)), np.diff(stored.indptr))
        root = np.sqrt(weights[self.other_rows])
        value, misclosures = stored.data * root[row], (-residual[self.other_rows] * root)[row]
        right = np.zeros(layout.size)
        np.add.at(right, stored.indices, value * misclosures)
        of_blocks = stored.indices >= layout.reduced
        others = Contributions(
            matrix=_squared(row[~of_blocks], stored.indices[~of_blocks], value[~of_blocks], layout.reduced),
            right=right[: layout.reduced],
            blocks=squared_blocks(
                row[of_blocks], stored.indices[of_blocks] - layout.reduced, value[of_blocks], layout.blocks
            ),
            block_right=right[layout.reduced :],
        )
        photos = slice(0, self.loop.points.xy.size)
        return self.loop.eliminate(
            self.state, weights[photos], residual[photos], others, layout, max_lost_digits, damping
        )

    def block_normals(self, root_weights: FloatArray, misclosure: FloatArray, layout: Layout) -> BlockNormals:
        """Return the normal equations of the blocks alone."""
        others = self.others.block_normals(root_weights[self.other_rows], misclosure[self.other_rows], layout)
        photos = slice(0, self.loop.points.xy.size)
        return self.loop.block_normals(self.state, root_weights[photos], misclosure[photos], others, layout)

    def right_side(self, root_weights: FloatArray, misclosure: FloatArray, layout: Layout) -> FloatArray:
        """Return the right-hand side of the normal equations."""
        others = self.others.right_side(root_weights[self.other_rows], misclosure[self.other_rows], layout)
        photos = slice(0, self.loop.points.xy.size)
        return self.loop.right_side(self.state, root_weights[photos], misclosure[photos], others, layout)

    def precision(
        self, factors: BlockFactors, coupling: Coupling, inverse: Symmetric, amounts: Amounts | None
    ) -> BlockPrecision:
        """Return cofactors of the blocks and leverages."""
        del factors
        found = self.loop.precision(coupling, inverse, amounts)
        photos = self.loop.points.xy.size
        leverage = np.zeros(np.count_nonzero(self.other_rows >= photos) + photos)
        leverage[:photos] = found.leverage
        leverage[self.other_rows] = self._other_leverages(found.blocks, inverse)
        return BlockPrecision(found.blocks, leverage)

    def _other_leverages(self, blocks: FloatArray, inverse: Symmetric) -> FloatArray:
        """Return the leverages of the rows that touch reduced unknowns, or one point, but never both."""
        in_reduced, in_blocks = self.others.stored[:, : len(inverse)], self.others.stored[:, len(inverse) :]
        touched = np.unique(in_blocks.indices // 3)
        in_touched = in_blocks[:, (3 * touched[:, None] + np.arange(3)).ravel()]
        of_points = (in_touched @ block_diagonal(blocks[touched])).multiply(in_touched).sum(axis=1)
        return quadratic_rows(in_reduced.tocsr(), inverse) + np.asarray(of_points, dtype=np.float64).ravel()


def _squared(row: IntArray, column: IntArray, value: FloatArray, size: int) -> csr_array:
    """Return A^T A (m, m) of a matrix (n, m) from its elements, in the order of its rows."""
    if not len(row):
        return csr_array((size, size))
    start = np.concatenate([[0], np.cumsum(np.bincount(row))])
    matrix = csr_array((value, column, start), shape=(len(start) - 1, size))
    return (matrix.T @ matrix).tocsr()


_CORRELATED = ("ANTENNA", "CAMERA")
"""Groups of unknowns whose correlations across records are results, where there are antennas."""


def touched_groups(
    unknowns: Unknowns,
    others: Iterable[IntArray | NDArray[np.int32]],
    touching: IntArray,
    touched: IntArray,
    count: int,
) -> tuple[IntArray, csr_array, BoolArray]:
    """Return the group (m,) of each reduced unknown, what touches the groups (r, g), and which are central (g,).

    A group is a record, or a tied point. Where antennas have unknowns, their correlations with each other and with
    those of cameras are results: these groups are central.

    Parameters
    ----------
    unknowns : Unknowns
    others : iterable of arrays (n, k) of int
        Unknowns that other observations touch, kind by kind; their rows come after the eliminated points.
    touching, touched : arrays (k,) of int
        Pairs of an eliminated point, or of points of the same photos, and a reduced unknown.
    count : int
        Number of these points.
    """
    groups = groups_of_unknowns(unknowns)
    rows_of, columns_of, first = [touching], [touched], count
    for columns in others:
        rows, places = np.nonzero((columns != CONSTANT) & (columns < unknowns.layout.reduced))
        rows_of.append(first + rows)
        columns_of.append(columns[rows, places].astype(np.int64))
        first += len(columns)
    names = unknowns.names.reduced
    kinds = np.array([names[place].group for place in np.flatnonzero(np.diff(groups, prepend=-1))])
    central = np.isin(kinds, _CORRELATED) & ("ANTENNA" in kinds)
    row, column = np.concatenate(rows_of), groups[np.concatenate(columns_of)]
    return groups, csr_array((np.ones(len(row)), (row, column)), shape=(first, len(kinds))), central


def groups_of_unknowns(unknowns: Unknowns) -> IntArray:
    """Return the group (m,) of each reduced unknown, ascending from 0."""
    records = [(name.group, name.name) for name in unknowns.names.reduced]
    changes = (one != other for one, other in pairwise(records))
    return np.cumsum([0, *changes])[: unknowns.layout.reduced]
