"""The compiled loop over all photo points of a block: one pass gives the normal equations, and no matrix is stored.

Points are eliminated one after the other. Where the extension could not be built, and for blocks with additional
parameters, the stored matrix of `orip.adjustment.sparse_rows` does the same, slower.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csr_array

from orip.adjustment.band import Arrangement, BandMatrix, Symmetric, band_of
from orip.adjustment.elimination import BlockFactors, EliminatedNormals
from orip.adjustment.equations import BlockPrecision, Layout
from orip.bundle.photo_point import PhotoPointObservations
from orip.bundle.state import State
from orip.bundle.unknowns import CONSTANT, Unknowns

try:
    from orip.bundle import _observation_loop as compiled
except ImportError:  # the extension is built where there is a compiler
    _IS_COMPILED = False
else:
    _IS_COMPILED = True

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

_RUN_ELEMENTS = 11


class Contributions(NamedTuple):
    """What other observations add to the normal equations before the points are eliminated.

    Attributes
    ----------
    matrix : sparse array (m, m)
    right : array (m,)
    blocks : array (b, 3, 3)
    block_right : array (3 b,)
    """

    matrix: csr_array
    right: FloatArray
    blocks: FloatArray
    block_right: FloatArray


@dataclass(frozen=True, slots=True)
class Pattern:
    """Where the photo points of eliminated points go in the normal equations.

    A run is the unknowns of a camera or of a photo, in consecutive columns; runs of photos follow those of cameras.

    Parameters
    ----------
    order, start : arrays (k,), (b + 1,)
        Photo points of point after point, and where each point's begin.
    camera_at, photo_at : arrays (n,)
        Where the camera's and the photo's unknowns begin among those that the point is coupled with.
    run_first, run_count : arrays (r,)
        First column and number of unknowns.
    run_elements : array (r, 11)
        Numbers of the unknowns among the 11 camera, 3 + 3 photo and 3 point partials.
    runs_start, runs : arrays (b + 1,), (l,)
        Runs that a point is coupled with, by column.
    coupling_start, coupling_columns : arrays (b + 1,), (c,)
        The same unknown by unknown.
    """

    order: IntArray
    start: IntArray
    camera_at: IntArray
    photo_at: IntArray
    run_first: IntArray
    run_count: IntArray
    run_elements: IntArray
    runs_start: IntArray
    runs: IntArray
    coupling_start: IntArray
    coupling_columns: IntArray


@dataclass(frozen=True, slots=True)
class PhotoLoop:
    """The photo points of a block with the pattern of their normal equations.

    Parameters
    ----------
    points : PhotoPointObservations
    pattern : Pattern
    eliminated : array (n,) of bool
        Photo points of points that are eliminated; the others are for somebody else to add.
    """

    points: PhotoPointObservations
    pattern: Pattern
    eliminated: BoolArray

    def residuals(self, state: State) -> tuple[FloatArray, BoolArray]:
        """Return residuals (2 n,) divided by their a-priori errors, and which can be computed (2 n,)."""
        residual = np.empty(self.points.xy.size)
        in_front = np.empty(len(self.points.xy), dtype=np.uint8)
        compiled.residuals(*self._observations(state), residual, in_front)
        return residual, np.repeat(in_front.astype(bool), 2)

    def eliminate(
        self,
        state: State,
        root_weights: FloatArray,
        misclosure: FloatArray,
        others: Contributions,
        layout: Layout,
        max_lost_digits: float,
    ) -> EliminatedNormals:
        """Return the normal equations of photo points and `others`, points eliminated.

        Parameters
        ----------
        state : State
        root_weights, misclosure : arrays (2 n,)
            Root of the weight factors, and weighted residuals with opposite sign; see `Rows.eliminated`.
        others : Contributions
            Its arrays of blocks are used up.
        layout : Layout
        max_lost_digits : float
        """
        m, b = layout.reduced, layout.blocks
        arrangement = layout.arrangement or _whole(m)
        columns = arrangement.columns
        matrix = band_of(others.matrix, arrangement)
        diagonal, right = others.matrix.diagonal()[columns], others.right[columns]
        half, lost = np.empty((b, 3, 3)), np.empty((b, 3))
        removed = np.empty((b, 3), dtype=np.uint8)
        coupling = np.empty((len(self.pattern.coupling_columns), 3, 1))
        compiled.eliminate(
            *self._observations(state), *self._pattern(arrangement), root_weights / self.points.rows.error, misclosure,
            np.ascontiguousarray(layout.fixed[m:]), others.blocks, others.block_right, diagonal, right,
            half, lost, removed, coupling, matrix.band, matrix.border,
            max_lost_digits, arrangement.width, arrangement.banded,
        )  # fmt: skip
        return EliminatedNormals(
            matrix.toarray() if layout.arrangement is None else matrix,
            right[arrangement.places],
            diagonal[arrangement.places],
            BlockFactors(half, lost, removed.astype(bool)),
            bsr_array((coupling, self.pattern.coupling_columns, self.pattern.coupling_start), shape=(3 * b, m)),
            others.block_right,
        )

    def precision(
        self, state: State, factors: BlockFactors, coupling: csr_array | bsr_array, inverse: Symmetric
    ) -> BlockPrecision:
        """Return cofactors (b, 3, 3) of the points and leverages (2 n,), zero where `eliminated` is not."""
        blocks, leverage = np.empty_like(factors.half), np.zeros(self.points.xy.size)
        longest = int(np.diff(self.pattern.coupling_start).max(initial=0))
        size = len(inverse)
        if isinstance(inverse, BandMatrix):
            arrangement, width, stored = inverse.arrangement, inverse.arrangement.width, (inverse.band, inverse.border)
        else:
            arrangement, width, stored = _whole(size), size, (inverse, np.empty(0))
        compiled.precision(
            *self._observations(state), *self._pattern(arrangement), np.ascontiguousarray(factors.half), coupling.data,
            *map(np.ascontiguousarray, stored), blocks, leverage, np.empty(3 * longest),
            width, arrangement.banded, size,
        )  # fmt: skip
        return BlockPrecision(blocks, leverage)

    def touched(self) -> tuple[IntArray, IntArray]:
        """Return pairs of a block and the first unknown of a camera or photo that it is coupled with."""
        pattern = self.pattern
        block = np.repeat(np.arange(len(pattern.runs_start) - 1), np.diff(pattern.runs_start))
        is_unknown = pattern.run_count[pattern.runs] > 0
        return block[is_unknown], pattern.run_first[pattern.runs[is_unknown]]

    def _observations(self, state: State) -> tuple[NDArray[np.generic], ...]:
        points = self.points
        arrays = (
            state.cameras, state.centres, state.rotations, state.rotation_basis(), state.points, points.camera,
            points.photo, points.point, points.at_measured, points.xy, points.rows.error,
        )  # fmt: skip
        return tuple(np.ascontiguousarray(each) for each in arrays)

    def _pattern(self, arrangement: Arrangement) -> tuple[IntArray, ...]:
        p = self.pattern
        return (
            p.order, p.start, p.camera_at, p.photo_at, arrangement.places[p.run_first], p.run_count, p.run_elements,
            p.runs_start, p.runs, p.coupling_start,
        )  # fmt: skip


def _whole(size: int) -> Arrangement:
    """Return the arrangement of a full matrix: a band as wide as it."""
    return Arrangement(np.arange(size), size, max(size - 1, 0))


def is_compiled() -> bool:
    """Whether the compiled loop is there."""
    return _IS_COMPILED


def photo_loop(points: PhotoPointObservations, unknowns: Unknowns) -> PhotoLoop | None:
    """Return the loop over the photo points of a block; None with additional parameters, which it does not know.

    Parameters
    ----------
    points : PhotoPointObservations
    unknowns : Unknowns
    """
    if points.sets:
        return None
    layout = unknowns.layout
    block = _blocks_of_points(unknowns)[points.point]
    eliminated = block >= 0
    order = np.flatnonzero(eliminated)
    order = order[np.argsort(block[order], kind="stable")]
    first, count, elements = _runs(unknowns)

    # each point's distinct runs, by their columns
    by_column = np.argsort(first, kind="stable")
    rank = np.empty_like(by_column)
    rank[by_column] = np.arange(len(by_column))
    runs_of_rows = np.stack([points.camera, len(unknowns.cameras) + points.photo])[:, order]
    keys, place = np.unique(block[order] * len(first) + rank[runs_of_rows], return_inverse=True)
    runs, run_block = by_column[keys % len(first)], keys // len(first)
    begins = np.concatenate([[0], np.cumsum(count[runs])])
    runs_start = _starts(run_block, layout.blocks)
    within = begins[:-1] - begins[runs_start[run_block]]
    at = np.zeros((2, len(block)), dtype=np.int64)
    at[:, order] = within[place.reshape(2, -1)]
    columns = np.repeat(first[runs] - begins[:-1], count[runs]) + np.arange(begins[-1])
    pattern = Pattern(
        order, _starts(block[order], layout.blocks), at[0].copy(), at[1].copy(), first, count, elements, runs_start,
        runs, begins[runs_start], columns,
    )  # fmt: skip
    return PhotoLoop(points, pattern, eliminated)


def _blocks_of_points(unknowns: Unknowns) -> IntArray:
    """Return the number of each point's eliminated block, -1 for points that stay in the reduced system."""
    first = unknowns.points.max(axis=1, initial=CONSTANT) - unknowns.layout.reduced
    block = np.where(first >= 0, first // 3, -1)
    # a point that is constant altogether has no column that tells its block; any block without unknowns will do
    constant = np.flatnonzero((unknowns.points == CONSTANT).all(axis=1))
    free = np.setdiff1d(np.arange(unknowns.layout.blocks), block[block >= 0])
    block[constant[: len(free)]] = free
    return np.asarray(block)


def _runs(unknowns: Unknowns) -> tuple[IntArray, IntArray, IntArray]:
    """Return first column (r,), number (r,) and elements (r, 11) of the unknowns of all cameras and photos."""
    table = np.full((len(unknowns.cameras) + len(unknowns.photos), _RUN_ELEMENTS), CONSTANT)
    table[: len(unknowns.cameras)] = unknowns.cameras
    table[len(unknowns.cameras) :, :6] = unknowns.photos
    is_unknown = table != CONSTANT
    elements = np.argsort(np.where(is_unknown, table, unknowns.layout.size), axis=1, kind="stable")
    elements[len(unknowns.cameras) :] += _RUN_ELEMENTS
    first = np.where(is_unknown, table, unknowns.layout.size).min(axis=1)
    return np.where(is_unknown.any(axis=1), first, 0), is_unknown.sum(axis=1), elements


def _starts(sorted_numbers: IntArray, count: int) -> IntArray:
    return np.searchsorted(sorted_numbers, np.arange(count + 1)).astype(np.int64)
