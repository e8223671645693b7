"""Cholesky factorisation of a band with a border, its selected inverse, and the digits that its columns lose.

A column of the band that has lost more than five digits at its turn is deferred. What then remains is a small full
matrix of deferred columns and border, and goes on as such (see `orip.adjustment.cholesky`): deferred columns by largest
pivot, and then the border. A full matrix of unknowns in the same order names the same ones as not determined.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve, lapack, solve_triangular

from orip.adjustment.band import Arrangement, BandMatrix
from orip.adjustment.cholesky import DEFERRAL_DIGITS, LOST_ALL, Elimination
from orip.arrays import FloatArray

_PANEL = 64


@dataclass(frozen=True, slots=True)
class BandFactor:
    """The factor of the columns that are determined.

    Parameters
    ----------
    arrangement : Arrangement
    band : array (banded, width + 1)
        L of the band.
    spread : array (banded, k)
        A^-1 B^T, with the band A and the k rows of the border B, without those that are not determined.
    corner : array (k, k)
        L of what remains of the border's own unknowns.
    at_border : array (k,)
        Places of the border's unknowns in the order of their elimination; deferred ones have theirs within the band,
        where they are empty.
    lost_digits : array (m,)
    removed : array (m,) of bool
        Columns that are not determined.
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
        own = np.flatnonzero(self.at_border >= banded)
        border = np.zeros((size - banded, size))
        border[self.at_border[own] - banded] = rows[own]
        found = BandMatrix(self.arrangement, band, border)
        if self.removed.any():
            found.scale((~self.removed).astype(np.float64))
        return found

    def _taking_part(self, vectors: FloatArray) -> NDArray[np.bool_]:
        return ~self.removed if vectors.ndim == 1 else ~self.removed[:, None]


def factorise_band(matrix: BandMatrix, max_lost_digits: float, undetermined: NDArray[np.bool_]) -> BandFactor:
    """Factorise a symmetric positive semidefinite band with a border, removing what is not determined.

    Parameters
    ----------
    matrix : BandMatrix
        Scaled so that the diagonal was 1 before any elimination; what it holds is used up.
    max_lost_digits : float
        A column that loses more is removed.
    undetermined : array (m,) of bool
        Columns known to have no observation at all; they are removed at once.

    Returns
    -------
    BandFactor
    """
    banded, size = matrix.arrangement.banded, len(matrix)
    held = undetermined[matrix.arrangement.columns]
    if held.any():
        matrix.scale((~undetermined).astype(np.float64))
        matrix.band[held[:banded], 0] = 1.0
    lower, info = lapack.dpbtrf(matrix.band.T, lower=1)
    band, deferred = np.asarray(lower).T, np.empty(0, dtype=np.int64)
    if info > 0 or not (band[:, 0] ** 2 >= 10.0**-DEFERRAL_DIGITS).all():
        band, deferred = _factorised_with_deferral(matrix.band)
    own = banded + np.flatnonzero(~held[banded:])
    rows = np.array([_row_of(matrix, int(place)) for place in deferred]).reshape(-1, size)
    border = np.vstack([matrix.border[own - banded], rows])
    return _with_border(matrix.arrangement, band, border, np.append(own, deferred), len(own), held, max_lost_digits)


def _with_border(
    arrangement: Arrangement,
    band: FloatArray,
    border: FloatArray,
    at_border: NDArray[np.int64],
    own: int,
    held: NDArray[np.bool_],
    max_lost_digits: float,
) -> BandFactor:
    """Return the factor of a band and the rows of its border, `own` ones and deferred ones."""
    banded, count = arrangement.banded, len(at_border)
    coupled = border[:, :banded].copy()
    # what couples the border's unknowns with each other is no part of the band
    coupled[:, at_border[own:]] = 0.0
    half = _solved(band, coupled.T, "N")
    spread = _solved(band, half, "T")
    corner = border[:, at_border]
    # rows of the border end at their diagonal elements, those of deferred columns do not
    corner[:own] = np.tril(corner[:own])
    corner[:own, own:] = corner[own:, :own].T
    corner[:own, :own] += np.tril(corner[:own, :own], -1).T
    lost = np.where(held, LOST_ALL, 0.0)
    lost[:banded] += np.where(held[:banded], 0.0, -2.0 * np.log10(band[:, 0]))
    work = Elimination(corner - half.T @ half, np.zeros((count, count)), [], np.zeros(count), spread)
    removed = work.eliminate_by_size([*range(own, count)], max_lost_digits, range(own))
    removed += work.eliminate_by_size(work.eliminate_in_order(np.arange(own)), max_lost_digits)
    order = np.array(work.order, dtype=np.int64)
    lost[at_border] = work.lost
    held = held.copy()
    held[at_border[removed]] = True
    return BandFactor(
        arrangement, band, spread[:, order], work.factor[order, : len(order)], at_border[order],
        lost[arrangement.places], held[arrangement.places],
    )  # fmt: skip


def _factorised_with_deferral(band: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Return L of a band without the columns that lose too many digits, and the places of these (k,).

    Panel by panel; what is to be taken off the places that follow is carried along as a full matrix.
    """
    banded, width = len(band), band.shape[1] - 1
    result = np.zeros_like(band)
    deferred: list[int] = []
    carried = np.zeros((0, 0))
    for start in range(0, banded, _PANEL):
        count = min(_PANEL, banded - start)
        rows = count + min(width, banded - start - count)
        window = np.zeros((rows, rows))
        window[: len(carried), : len(carried)] = carried
        panel = _panel(band, start, count, rows) + window[:, :count]
        for place in _defer_lossy(panel, count):
            deferred.append(start + place)
            before = np.arange(max(0, deferred[-1] - width), start)
            result[before, deferred[-1] - before] = 0.0
        panel[count:] = solve_triangular(panel[:count], panel[count:].T, lower=True).T
        carried = window[count:, count:] - panel[count:] @ panel[count:].T
        _put_panel(result, start, panel)
    return result, np.array(deferred, dtype=np.int64)


def _defer_lossy(panel: FloatArray, count: int) -> list[int]:
    """Put L into the first rows of a panel, its lossy columns replaced by those of a unit matrix; return these."""
    deferred: list[int] = []
    block = np.tril(panel[:count])
    while True:
        lower, info = lapack.dpotrf(block, lower=1, clean=1)
        pivots = np.diag(lower)[: info - 1 if info > 0 else count] ** 2
        lossy = np.flatnonzero(~(pivots >= 10.0**-DEFERRAL_DIGITS))
        bad = int(lossy[0]) if len(lossy) else info - 1
        if bad < 0:
            panel[:count] = lower
            return deferred
        deferred.append(bad)
        block[bad, :bad] = block[bad:, bad] = panel[:, bad] = 0.0
        block[bad, bad] = 1.0


def _solved(band: FloatArray, right: FloatArray, trans: str) -> FloatArray:
    """Return L^-1 right, or L^-T right for "T", with the factor L of a band."""
    if not right.size:
        return right
    found, _ = lapack.dtbtrs(band.T, right, uplo="L", trans=trans)
    return np.asarray(found).reshape(right.shape)


def _row_of(matrix: BandMatrix, place: int) -> FloatArray:
    """Return the full row (m,) of a place in the band."""
    band, width = matrix.band, matrix.arrangement.width
    row = np.zeros(len(matrix))
    row[len(band) :] = matrix.border[:, place]
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
