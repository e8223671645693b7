"""Cholesky factorisation of a band with a border, its selected inverse, and the removal of what is not determined.

A full matrix of the same unknowns names the same ones as not determined (`orip.adjustment.factorisation.null_space`).
"""

from __future__ import annotations

from functools import partial

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.linalg import lapack

from orip.adjustment.factorisation.band import Arrangement, BandMatrix, add_product
from orip.adjustment.factorisation.envelope import EnvelopeFactor, factorise_envelope
from orip.adjustment.factorisation.lapack import solve_lower
from orip.adjustment.factorisation.null_space import factor_of_determined
from orip.adjustment.factorisation.two_ends import TwoEndedFactor, factorise_from_both_ends
from orip.arrays import FloatArray


class BandFactor(Struct, frozen=True):
    """The factor of the columns that are determined.

    Parameters
    ----------
    arrangement : Arrangement
    band : TwoEndedFactor, or EnvelopeFactor of a wide band
    half : array (banded, k)
        L^-1 B^T, with the factor L of the band and the k rows of the border B, without those that are not determined.
    corner : array (k, k)
        L of what remains of the border's own unknowns.
    at_border : array (k,)
        Places of these unknowns.
    lost_digits : array (m,)
    removed : array (m,) of bool
        Columns that are not determined.
    """

    arrangement: Arrangement
    band: TwoEndedFactor | EnvelopeFactor
    half: FloatArray
    corner: FloatArray
    at_border: NDArray[np.int64]
    lost_digits: FloatArray
    removed: NDArray[np.bool_]

    def reduce(self, right: FloatArray) -> FloatArray:
        """Return c = L^-1 right for right-hand sides (m,) or (m, k); rows are in the order of elimination."""
        ordered = np.where(self._taking_part(right), right, 0.0)[self.arrangement.columns]
        of_border = ordered[self.at_border]
        ordered[self.at_border] = 0.0
        in_band = self.band.reduce(ordered[: self.arrangement.banded])
        return np.concatenate([in_band, solve_lower(self.corner, of_border - self.half.T @ in_band)])

    def back_substitute(self, reduced_right: FloatArray) -> FloatArray:
        """Return the solution (m,) or (m, k) of L^T x = c, zero for removed columns."""
        banded = self.arrangement.banded
        of_border = solve_lower(self.corner, reduced_right[banded:], transposed=True)
        ordered = np.zeros((len(self.removed), *reduced_right.shape[1:]))
        ordered[:banded] = self.band.back_substitute(reduced_right[:banded] - self.half @ of_border)
        ordered[self.at_border] = of_border
        solution = ordered[self.arrangement.places]
        return np.where(self._taking_part(solution), solution, 0.0)

    def inverse(self) -> BandMatrix:
        """Return the inverse where the matrix has its band and border, zero for removed columns."""
        banded, size = self.arrangement.banded, len(self.removed)
        corner = _inverse(self.corner)
        spread = self.band.back_substitute(self.half)
        cross = -spread @ corner
        band = self.band.inverse()
        add_product(band, spread, -cross, self.arrangement.reach)
        rows = np.zeros((len(corner), size))
        rows[:, :banded] = cross.T
        rows[:, self.at_border] = corner
        border = np.zeros((size - banded, size))
        border[self.at_border - banded] = rows
        found = BandMatrix(self.arrangement, band, border)
        if self.removed.any():
            found.scale((~self.removed).astype(np.float64))
        return found

    def _taking_part(self, vectors: FloatArray) -> NDArray[np.bool_]:
        return ~self.removed if vectors.ndim == 1 else ~self.removed[:, None]


def factorise_band(
    matrix: BandMatrix, max_lost_digits: float, undetermined: NDArray[np.bool_], first: int = 0
) -> BandFactor:
    """Factorise a symmetric positive semidefinite band with a border, removing what is not determined.

    Parameters
    ----------
    matrix : BandMatrix
        Scaled so that the diagonal was 1 before any elimination.
    max_lost_digits : float
        A movement whose stiffness has lost more is not determined; a column is removed for it.
    undetermined : array (m,) of bool
        Columns known to have no observation at all; they are removed at once.
    first : int
        Number of leading columns of which one is removed wherever it will do.

    Returns
    -------
    BandFactor
    """
    return factor_of_determined(
        partial(_factor, matrix),
        matrix.times,
        lambda: bool(np.isfinite(matrix.band).all() and np.isfinite(matrix.border).all()),
        undetermined,
        max_lost_digits,
        first,
    )


def _factor(matrix: BandMatrix, removed: NDArray[np.bool_], lost: FloatArray, shift: float) -> BandFactor | None:
    """Return the factor of the columns that are not removed, its diagonal enlarged; None if it has none."""
    arrangement, banded = matrix.arrangement, matrix.arrangement.banded
    left_out = removed[arrangement.columns]
    band, border = matrix.band, matrix.border
    if left_out.any():
        band, border = _without(matrix, left_out)
    if shift:
        band = band.copy()
        band[:, 0] += shift
    reach = arrangement.reach
    lower = factorise_from_both_ends(band) if reach is None else factorise_envelope(band, reach)
    if lower is None:
        return None
    at_border = banded + np.flatnonzero(~left_out[banded:])
    rows = border[at_border - banded]
    half = lower.reduce(rows[:, :banded].T)
    corner = np.tril(rows[:, at_border])
    corner += np.tril(corner, -1).T + shift * np.eye(len(corner)) - half.T @ half
    corner, info = lapack.dpotrf(corner, lower=1, clean=1) if len(corner) else (corner, 0)
    if info != 0:
        return None
    pivots = np.concatenate([lower.diagonal, np.ones(len(matrix) - banded)])
    pivots[at_border] = np.diag(corner)
    digits = np.where(left_out, lost[arrangement.columns], -2.0 * np.log10(pivots))
    return BandFactor(
        arrangement, lower, half, np.asarray(corner), at_border, digits[arrangement.places], removed.copy()
    )


def _inverse(lower: FloatArray) -> FloatArray:
    """Return the inverse (k, k) of the matrix with the factor L (k, k)."""
    if not len(lower):
        return np.zeros((0, 0))
    found, _ = lapack.dpotrs(lower, np.eye(len(lower)), lower=1)
    return np.asarray(found)


def _without(matrix: BandMatrix, left_out: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Return band and border with unit rows and columns at the places (m,) that are left out."""
    banded, width = matrix.arrangement.banded, matrix.arrangement.width
    kept = (~left_out).astype(np.float64)
    padded = np.append(kept[:banded], np.zeros(width))
    band = np.where(padded[:banded, None] * np.lib.stride_tricks.sliding_window_view(padded, width + 1), matrix.band, 0)
    band[left_out[:banded], 0] = 1.0
    return band, np.where(kept, matrix.border, 0.0)
