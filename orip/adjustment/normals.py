"""Normal equations: formed from the observation equations, points eliminated, solved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import bsr_array, csr_array

from orip.adjustment.cholesky import Factor, factorise
from orip.adjustment.elimination import BlockFactors, factorise_blocks
from orip.adjustment.equations import Equations, Layout

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class SolvedNormals:
    """The factored normal equations and their solution.

    Parameters
    ----------
    correction : array (m + 3 b,)
        Zero for fixed and removed unknowns.
    reduced_square_sum : float
        dx^T N dx.
    scale : array (m,)
        Root of the complete diagonal of the reduced unknowns; 1 where it is zero.
    factor : Factor
        Of the reduced system divided by `scale` on both sides.
    blocks : BlockFactors
    coupling : sparse array (3 b, m)
        H N_pr / scale: the eliminated points' rows of the triangular factor.
    removed : array (m + 3 b,) of bool
        Unknowns that the observations do not determine.
    lost_digits : array (m + 3 b,)
    """

    correction: FloatArray
    reduced_square_sum: float
    scale: FloatArray
    factor: Factor
    blocks: BlockFactors
    coupling: csr_array
    removed: NDArray[np.bool_]
    lost_digits: FloatArray

    def solve(self, right: FloatArray) -> FloatArray:
        """Return N^-1 right for right-hand sides (m + 3 b, k); zero for fixed and removed unknowns."""
        size = len(self.scale)
        half = block_diagonal(self.blocks.half)
        block_right = half @ right[size:]
        reduced = right[:size] / self.scale[:, None] - self.coupling.T @ block_right
        solution = self.factor.back_substitute(self.factor.reduce(reduced))
        return np.vstack([solution / self.scale[:, None], half.T @ (block_right - self.coupling @ solution)])


def solve_normals(
    equations: Equations, weight_factors: FloatArray, layout: Layout, max_lost_digits: float
) -> SolvedNormals:
    """Form, reduce and solve the normal equations of one iteration.

    Parameters
    ----------
    equations : Equations
    weight_factors : array (n,)
        Inactive observations get no weight whatever stands here.
    layout : Layout
    max_lost_digits : float

    Returns
    -------
    SolvedNormals
    """
    root = np.sqrt(np.where(equations.active, weight_factors, 0.0))
    weighted = scale_rows(equations.design, root)
    misclosure = -equations.residual * root
    reduced_design, block_design = weighted[:, : layout.reduced], weighted[:, layout.reduced :]

    matrix = (reduced_design.T @ reduced_design).toarray()
    blocks = diagonal_blocks(block_design)
    fixed_places = layout.fixed[layout.reduced :].reshape(-1, 3)
    block_factors = factorise_blocks(blocks, fixed_places, max_lost_digits)
    half = block_diagonal(block_factors.half)

    held = layout.fixed[: layout.reduced]
    diagonal = np.where(held, 0.0, np.diag(matrix))
    scale = np.where(diagonal > 0.0, np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0)), 1.0)
    coupling = (half @ (block_design.T @ reduced_design)).tocsr()
    coupling.data /= scale[coupling.indices]
    matrix /= scale[:, None] * scale[None, :]
    matrix -= (coupling.T @ coupling).toarray()

    block_right = half @ (block_design.T @ misclosure)
    right = reduced_design.T @ misclosure / scale - coupling.T @ block_right
    factor = factorise(matrix, max_lost_digits, diagonal <= 0.0)
    reduced_right = factor.reduce(right)
    reduced_solution = factor.back_substitute(reduced_right)
    block_solution = half.T @ (block_right - coupling @ reduced_solution)
    return SolvedNormals(
        correction=np.concatenate([reduced_solution / scale, block_solution]),
        reduced_square_sum=float(reduced_right @ reduced_right + block_right @ block_right),
        scale=scale,
        factor=factor,
        blocks=block_factors,
        coupling=coupling,
        removed=np.concatenate([factor.removed & ~held, block_factors.removed.ravel()]),
        lost_digits=np.concatenate([factor.lost_digits, block_factors.lost_digits.ravel()]),
    )


def scale_rows(matrix: csr_array, factors: FloatArray) -> csr_array:
    """Return the matrix with each row multiplied by its factor; the pattern is kept, zeros included."""
    data = matrix.data * np.repeat(factors, np.diff(matrix.indptr))
    return csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)


def block_diagonal(blocks: FloatArray) -> bsr_array:
    """Return b blocks (b, 3, 3) as a sparse block-diagonal matrix."""
    count = len(blocks)
    return bsr_array((blocks, np.arange(count), np.arange(count + 1)), shape=(3 * count, 3 * count))


def diagonal_blocks(block_design: csr_array) -> FloatArray:
    """Return the 3 x 3 diagonal blocks (b, 3, 3) of D^T D, for rows that each touch one block at most."""
    rows, columns = block_design.shape
    coordinates = block_design.tocoo()
    dense = np.zeros((rows, 3))
    dense[coordinates.row, coordinates.col % 3] = coordinates.data
    block_of_row = np.full(rows, -1)
    block_of_row[coordinates.row] = coordinates.col // 3
    used = block_of_row >= 0
    result = np.zeros((columns // 3, 3, 3))
    np.add.at(result, block_of_row[used], dense[used][:, :, None] * dense[used][:, None, :])
    return result
