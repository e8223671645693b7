"""Point blocks of three unknowns, eliminated from the normal equations together.

Each block is factored with diagonal pivoting, so that a coordinate that nothing determines (the depth of a point with
one ray) is found by the digits its pivot loses, and is removed alone. It is scaled by the diagonal it would have if
every ray were square to all axes: a diagonal of its own would be scaled to 1 even where it is nothing but rounding, as
along the base of two photos for a point on that line.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from msgspec import Struct
from scipy.sparse import bsr_array, csr_array

from orip.adjustment.factorisation.cholesky import Symmetric
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
