"""Precision and reliability: cofactors of all unknowns, redundancy numbers, sigma0.

Assumes uncorrelated observations with a-priori errors, and the normal equations factored at the solution with its final
weights. Cofactors are for sigma0 = 1; a standard deviation is sigma0 times the root of a cofactor.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from orip.adjustment.equations import Equations, Layout
from orip.adjustment.normals import SolvedNormals, block_diagonal

FloatArray = NDArray[np.float64]

_CHUNK_NUMBERS = 4_000_000
"""Numbers gathered at a time: bounds the memory of the blockwise products."""


@dataclass(frozen=True, slots=True)
class Cofactors:
    """Cofactors (sigma0 = 1) with zero rows and columns for fixed and removed unknowns.

    Parameters
    ----------
    reduced : array (m, m)
    blocks : array (b, 3, 3)
    leverage : array (n,)
        h_i = a_i Q a_i^T of every observation equation, disregarded ones included.
    """

    reduced: FloatArray
    blocks: FloatArray
    leverage: FloatArray


@dataclass(frozen=True, slots=True)
class VarianceOfUnitWeight:
    """The figures that judge the adjustment as a whole.

    Parameters
    ----------
    sigma0 : float
        From the observations with weight factor 1, on `redundancy_used`; NaN without redundancy.
    sigma0_all : float
        From all active observations, on `redundancy`; NaN without redundancy.
    redundancy : int
        n - u + removed.
    redundancy_used : float
        Sum of the redundancy numbers of observations with weight factor 1.
    redundancy_numbers : array (n,)
        r_i = 1 - wf_i h_i; NaN for inactive observations.
    """

    sigma0: float
    sigma0_all: float
    redundancy: int
    redundancy_used: float
    redundancy_numbers: FloatArray


def cofactors(equations: Equations, normals: SolvedNormals, layout: Layout) -> Cofactors:
    """Return the cofactors of all unknowns and of all computed observations.

    With the points' rows B of the triangular factor and Q the inverse of the reduced system, a point block's cofactor
    is H^T (I + B Q B^T) H, and an observation's a Q a^T follows from its row freed of the point: a_r - a_p H^T B.
    """
    inverse = normals.factor.inverse()
    coupling = normals.coupling
    half = normals.blocks.half
    inner = np.eye(3) + _quadratic_blocks(coupling, inverse, layout.blocks)
    blocks = np.swapaxes(half, 1, 2) @ inner @ half

    reduced_design = equations.design[:, : layout.reduced]
    reduced_design.data = reduced_design.data / normals.scale[reduced_design.indices]
    in_blocks = equations.design[:, layout.reduced :] @ block_diagonal(np.swapaxes(half, 1, 2))
    freed = (reduced_design - in_blocks @ coupling).tocsr()
    leverage = _quadratic_rows(freed, inverse) + np.asarray(in_blocks.multiply(in_blocks).sum(axis=1)).ravel()
    return Cofactors(inverse / np.outer(normals.scale, normals.scale), blocks, leverage)


def variance_of_unit_weight(
    equations: Equations, weight_factors: FloatArray, leverage: FloatArray, effective_unknowns: int
) -> VarianceOfUnitWeight:
    """Return sigma0 and the redundancy numbers.

    Parameters
    ----------
    equations : Equations
        At the solution.
    weight_factors, leverage : arrays (n,)
    effective_unknowns : int
        u without the removed ones.

    Returns
    -------
    VarianceOfUnitWeight
    """
    active = equations.active
    numbers = np.where(active, 1.0 - weight_factors * leverage, np.nan)
    redundancy = int(np.count_nonzero(active)) - effective_unknowns
    full = active & (weight_factors >= 1.0)
    used = float(np.sum(numbers[full]))
    squares = np.where(equations.exact, 0.0, equations.residual**2)
    return VarianceOfUnitWeight(
        sigma0=_root_of_mean(float(np.sum(squares[full])), used),
        sigma0_all=_root_of_mean(float(np.sum(squares[active])), redundancy),
        redundancy=redundancy,
        redundancy_used=used,
        redundancy_numbers=numbers,
    )


def _root_of_mean(square_sum: float, redundancy: float) -> float:
    # a redundancy that is zero but for rounding says nothing about the observations
    return float(np.sqrt(square_sum / redundancy)) if redundancy > 1e-6 else float("nan")


def _groups_by_length(indptr: NDArray[np.int64]) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield (number of columns k, rows that have k of them), in pieces of bounded memory."""
    lengths = np.diff(indptr)
    for length in np.unique(lengths[lengths > 0]):
        rows = np.flatnonzero(lengths == length)
        piece = max(1, _CHUNK_NUMBERS // int(length * length))
        for start in range(0, len(rows), piece):
            yield int(length), rows[start : start + piece]


def _quadratic_rows(matrix: csr_array, inner: FloatArray) -> FloatArray:
    """Return a Q a^T for each row a of a sparse matrix."""
    result = np.zeros(matrix.shape[0])
    for length, rows in _groups_by_length(matrix.indptr):
        places = matrix.indptr[rows][:, None] + np.arange(length)
        columns, values = matrix.indices[places], matrix.data[places]
        gathered = inner[columns[:, :, None], columns[:, None, :]]
        result[rows] = np.einsum("ni,nij,nj->n", values, gathered, values, optimize=True)
    return result


def _quadratic_blocks(matrix: csr_array, inner: FloatArray, count: int) -> FloatArray:
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
