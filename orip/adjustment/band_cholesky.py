"""Cholesky factorisation of a band with a border, its selected inverse, and the digits that its columns lose.

A column of the band that has lost more than five digits at its turn is deferred into the border. Columns of the border
come last, so that the digits that each would lose, were it the very last one, can be told from the inverse. Where one
would lose more than allowed, something is not determined, and the full matrix has to say which: the two factorisations
name the same unknowns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, lapack, solve_triangular

from orip.adjustment.band import Arrangement, BandMatrix
from orip.adjustment.cholesky import DEFERRAL_DIGITS

FloatArray = NDArray[np.float64]

_MOST_DEFERRED = 20
_PANEL = 64


@dataclass(frozen=True, slots=True)
class BandFactor:
    """The factor of a matrix that is determined but for columns that no observation touches.

    Parameters
    ----------
    arrangement : Arrangement
    band : array (banded, width + 1)
        L of the band.
    spread : array (banded, k)
        A^-1 B^T, with the band A and the k rows of the border B.
    corner : array (k, k)
        L of what remains of the border's own unknowns.
    at_border : array (k,)
        Places of the border's unknowns; deferred ones have theirs within the band, where they are empty.
    lost_digits : array (m,)
    removed : array (m,) of bool
        Columns that no observation touches.
    """

    arrangement: Arrangement
    band: FloatArray
    spread: FloatArray
    corner: FloatArray
    at_border: NDArray[np.int64]
    lost_digits: FloatArray
    removed: NDArray[np.bool_]

    def reduce(self, right: FloatArray) -> FloatArray:
        """Return c = L^-1 right for right-hand sides (m,) or (m, k); rows are in the order of elimination."""
        ordered = np.where(self._taking_part(right), right, 0.0)[self.arrangement.columns]
        of_border = ordered[self.at_border]
        ordered[self.at_border] = 0.0
        in_band = ordered[: self.arrangement.banded]
        rest = of_border - self.spread.T @ in_band
        return np.concatenate([_solved(self.band, in_band, "N"), solve_triangular(self.corner, rest, lower=True)])

    def back_substitute(self, reduced_right: FloatArray) -> FloatArray:
        """Return the solution (m,) or (m, k) of L^T x = c, zero for removed columns."""
        banded = self.arrangement.banded
        of_border = solve_triangular(self.corner, reduced_right[banded:], lower=True, trans="T")
        ordered = np.zeros((len(self.removed), *reduced_right.shape[1:]))
        ordered[:banded] = _solved(self.band, reduced_right[:banded], "T") - self.spread @ of_border
        ordered[self.at_border] = of_border
        solution = ordered[self.arrangement.places]
        return np.where(self._taking_part(solution), solution, 0.0)

    def inverse(self) -> BandMatrix:
        """Return the inverse where the matrix has its band and border, zero for removed columns."""
        banded, size = self.arrangement.banded, len(self.removed)
        corner = cho_solve((self.corner, True), np.eye(len(self.corner)))
        cross = -self.spread @ corner
        band = _selected_inverse(self.band, -cross, self.spread)
        rows = np.zeros((len(corner), size))
        rows[:, :banded] = cross.T
        rows[:, self.at_border] = corner
        deferred = np.flatnonzero(self.at_border < banded)
        for row in deferred:
            _put_column(band, int(self.at_border[row]), rows[row, :banded])
        found = BandMatrix(self.arrangement, band, rows[np.flatnonzero(self.at_border >= banded)])
        return found.scaled((~self.removed).astype(np.float64))

    def _taking_part(self, vectors: FloatArray) -> NDArray[np.bool_]:
        return ~self.removed if vectors.ndim == 1 else ~self.removed[:, None]


def factorise_band(matrix: BandMatrix, max_lost_digits: float, undetermined: NDArray[np.bool_]) -> BandFactor | None:
    """Factorise a symmetric positive definite band with a border.

    Parameters
    ----------
    matrix : BandMatrix
        Scaled so that the diagonal was 1 before any elimination.
    max_lost_digits : float
    undetermined : array (m,) of bool
        Columns known to have no observation at all.

    Returns
    -------
    BandFactor or None
        None: the matrix is not determined, or nearly not.
    """
    arrangement = matrix.arrangement
    banded = arrangement.banded
    held = undetermined[arrangement.columns]
    matrix = matrix.scaled((~undetermined).astype(np.float64))
    matrix.band[held[:banded], 0] = 1.0
    at_border = np.arange(banded, len(matrix))
    border = matrix.border.copy()
    border[np.arange(len(at_border)), at_border] += held[banded:]
    while True:
        lower, info = lapack.dpbtrf(matrix.band.T, lower=1)
        bad = info - 1 if info > 0 else _first_lossy(np.asarray(lower)[0])
        if bad is None:
            break
        if len(at_border) - (len(matrix) - banded) == _MOST_DEFERRED:
            return None
        row = _row_of(matrix.band, bad, len(matrix))
        row[at_border] = border[:, bad]
        at_border, border = np.append(at_border, bad), np.vstack([border, row])
        border[:, bad] = row[at_border]
        _put_column(matrix.band, bad, np.zeros(banded))
        matrix.band[bad, 0] = 1.0
    return _with_border(arrangement, np.asarray(lower).T, border, at_border, undetermined, max_lost_digits)


def _first_lossy(pivots: FloatArray) -> int | None:
    lossy = np.flatnonzero(~(pivots**2 >= 10.0**-DEFERRAL_DIGITS))
    return int(lossy[0]) if len(lossy) else None


def _with_border(
    arrangement: Arrangement,
    band: FloatArray,
    border: FloatArray,
    at_border: NDArray[np.int64],
    undetermined: NDArray[np.bool_],
    max_lost_digits: float,
) -> BandFactor | None:
    banded, size = arrangement.banded, len(undetermined)
    coupled = border[:, :banded].copy()
    # what couples the border's unknowns with each other is no part of the band
    coupled[:, at_border[at_border < banded]] = 0.0
    corner = np.tril(border[:, at_border])
    corner += np.tril(corner, -1).T
    lost = np.zeros(size)
    half = _solved(band, coupled.T, "N")
    lower, info = lapack.dpotrf(corner - half.T @ half, lower=1, clean=1) if len(at_border) else (corner, 0)
    if info != 0:
        return None
    spread = _solved(band, half, "T")
    lost[:banded] = -2.0 * np.log10(band[:, 0])
    lost[at_border] = -2.0 * np.log10(np.diag(lower))
    factor = BandFactor(arrangement, band, spread, np.asarray(lower), at_border, lost[arrangement.places], undetermined)
    inverse = cho_solve((factor.corner, True), np.eye(len(at_border))) if len(at_border) else corner
    # eliminated last, a column's pivot over 1 + |x|² is its own cofactor over the squares of all in its column
    squares = np.sum((spread @ inverse) ** 2, axis=0) + np.sum(inverse**2, axis=0)
    if len(at_border) and np.log10(squares / np.diag(inverse)).max() > max_lost_digits:
        return None
    return factor


def _solved(band: FloatArray, right: FloatArray, trans: str) -> FloatArray:
    """Return L^-1 right, or L^-T right for "T", with the factor L of a band."""
    if not right.size:
        return right
    found, _ = lapack.dtbtrs(band.T, right, uplo="L", trans=trans)
    return np.asarray(found).reshape(right.shape)


def _row_of(band: FloatArray, place: int, size: int) -> FloatArray:
    """Return the full row (size,) of a place in a band."""
    width = band.shape[1] - 1
    row = np.zeros(size)
    first, last = max(0, place - width), min(len(band), place + width + 1)
    before = np.arange(first, place)
    row[before] = band[before, place - before]
    row[place:last] = band[place, : last - place]
    return row


def _put_column(band: FloatArray, place: int, values: FloatArray) -> None:
    """Overwrite row and column of a place in a band."""
    width = band.shape[1] - 1
    first, last = max(0, place - width), min(len(band), place + width + 1)
    before = np.arange(first, place)
    band[before, place - before] = values[before]
    band[place, : last - place] = values[place:last]


def _selected_inverse(band: FloatArray, spread_corner: FloatArray, spread: FloatArray) -> FloatArray:
    """Return the inverse of the whole within the band: Takahashi's recursion (1973), panel by panel from the end.

    Below a panel with L = (D; E) the inverse is Z G with G = -E D^-1 and the part Z known already, and the panel's own
    is D^-T D^-1 + G^T Z G. `spread_corner` (banded, k) @ `spread`.T is what the border adds.
    """
    banded, width = len(band), band.shape[1] - 1
    result = np.zeros_like(band)
    known = np.zeros((0, 0))
    for start in range((banded - 1) // _PANEL * _PANEL, -1, -_PANEL):
        count = min(_PANEL, banded - start)
        rows = count + min(width, banded - start - count)
        panel = _panel(band, start, count, rows)
        inverse = solve_triangular(panel[:count], np.eye(count), lower=True)
        multiplier = -panel[count:] @ inverse
        below = known[: rows - count, : rows - count] @ multiplier
        own = inverse.T @ inverse + multiplier.T @ below
        grown = np.empty((rows, rows))
        grown[:count, :count], grown[count:, :count], grown[:count, count:] = own, below, below.T
        grown[count:, count:] = known[: rows - count, : rows - count]
        known = grown
        added = spread[start : start + rows] @ spread_corner[start : start + count].T
        _put_panel(result, start, grown[:, :count] + added)
    return result


def _panel(band: FloatArray, start: int, count: int, rows: int) -> FloatArray:
    """Return rows from `start` of the `count` columns from there, as a full matrix (rows, count)."""
    width = band.shape[1] - 1
    panel = np.zeros((rows, count))
    for column in range(count):
        length = min(width + 1, rows - column)
        panel[column : column + length, column] = band[start + column, :length]
    return panel


def _put_panel(band: FloatArray, start: int, panel: FloatArray) -> None:
    width = band.shape[1] - 1
    rows, count = panel.shape
    for column in range(count):
        length = min(width + 1, rows - column)
        band[start + column, :length] = panel[column : column + length, column]
