"""Cholesky factorisation of a band with a border, from one end or from both, and its selected inverse."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray
from scipy.linalg import lapack

from orip.adjustment.factorisation.band import (
    PANEL,
    Arrangement,
    BandMatrix,
    add_product,
    columns_of,
    from_the_end,
    stored_part,
)
from orip.adjustment.factorisation.lapack import (
    EnvelopeFactor,
    factorise_envelope,
    factorise_in_place,
    reduce_in_place,
    solve_lower,
    substitute_in_place,
)
from orip.adjustment.factorisation.null_space import factor_of_determined
from orip.arrays import FloatArray
from orip.structs import replace
from orip.threads import at_once, available_threads

# The first half of the unknowns is eliminated forwards, the other half backwards; they are coupled with each other by
# the unknowns between them alone, as many as the band is wide, which are eliminated last. The halves go to two threads,
# and the result does not depend on whether there is a second one.

T = TypeVar("T")

_WORK_OF_A_THREAD = 1e6
"""Multiplications from which a second thread pays: half a millisecond with one vector, which waits for memory."""


class Half(Struct, frozen=True):
    """Columns of the factor of the unknowns of one half.

    Parameters
    ----------
    band : array (h, w + 1)
        From the half's end of the band to the middle; the last rows lie in the middle.
    to_middle : array (q, c)
        L by the unknowns of the middle of the last q columns, in the middle's own order; others have none.
    """

    band: FloatArray
    to_middle: FloatArray

    def reduced(self, vectors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return L^-1 of vectors (k, h), and what they take off those of the middle (k, c)."""
        reduce_in_place(self.band, vectors)
        return vectors, vectors[:, len(self.band) - len(self.to_middle) :] @ self.to_middle

    def substituted(self, vectors: FloatArray, of_middle: FloatArray) -> FloatArray:
        """Return the solution (k, h) of L^T x = c from c (k, h) and the solution of the middle (k, c)."""
        vectors[:, len(self.band) - len(self.to_middle) :] -= of_middle @ self.to_middle.T
        substitute_in_place(self.band, vectors)
        return vectors

    def put_inverse(self, of_middle: FloatArray, result: FloatArray) -> None:
        """Put the inverse of the whole matrix in the columns of the half, as a band, into an array (h, w + 1).

        Takahashi's recursion (1973), panel by panel from the middle: below a panel with L = (D; E) the inverse is Z G
        with G = -E D^-1 and the part Z that is known already, and the panel's own is D^-T D^-1 + G^T Z G.

        Parameters
        ----------
        of_middle : array (w, w)
            The inverse of the matrix in the w unknowns that follow.
        result : array (h, w + 1)
        """
        count, width = len(self.band), self.band.shape[1] - 1
        known = _Known(of_middle)
        for start in range((count - 1) // PANEL * PANEL, -1, -PANEL):
            panel = columns_of(self.band[start : start + PANEL])
            size = len(panel)
            inverse, _ = lapack.dtrtri(panel[:, :size].T, lower=1)
            multiplier = -panel[:, size:].T @ inverse
            below = known.matrix @ multiplier
            found = np.empty((size, size + width))
            found[:, :size] = inverse.T @ inverse + multiplier.T @ below
            found[:, size:] = below.T
            result[start : start + size] = stored_part(found)
            known.put_before(found)


class _Known:
    """The inverse in the w unknowns that were computed last, within a larger array in which it moves to the front."""

    def __init__(self, matrix: FloatArray) -> None:
        self.width = len(matrix)
        self.room = np.empty((2 * self.width + 4 * PANEL,) * 2)
        self.first = len(self.room) - self.width
        self.matrix[:] = matrix

    @property
    def matrix(self) -> FloatArray:
        """Return the inverse (w, w)."""
        part = slice(self.first, self.first + self.width)
        return self.room[part, part]

    def put_before(self, panel: FloatArray) -> None:
        """Put columns (count, count + w) before it; as many are dropped at its end."""
        count, rows = panel.shape
        if count > self.first:
            kept = self.matrix.copy()
            self.first = len(self.room) - self.width
            self.matrix[:] = kept
        first, middle, end = self.first - count, self.first, self.first - count + rows
        self.room[first:middle, first:end] = panel
        self.room[middle:end, first:middle] = panel[:, count:].T
        self.first = first


class TwoEndedFactor(Struct, frozen=True):
    """The Cholesky factor of a band (n, w + 1).

    Parameters
    ----------
    first, last : Half
        The last one from the end of the band backwards.
    middle : array (c, c)
        L of what remains of the c unknowns between them.
    """

    first: Half
    last: Half
    middle: FloatArray

    @property
    def diagonal(self) -> FloatArray:
        """Return the diagonal (n,) of the factor, in the order of the unknowns."""
        return np.concatenate([self.first.band[:, 0], np.diag(self.middle), self.last.band[::-1, 0]])

    def reduce(self, right: FloatArray) -> FloatArray:
        """Return c = L^-1 right for right-hand sides (n,) or (n, k)."""
        first, middle, last = self._parts(right)
        tasks = partial(self.first.reduced, first), partial(self.last.reduced, last)
        (first, from_first), (last, from_last) = self._at_once(tasks, first.size)
        rest = solve_lower(self.middle, (middle - from_first - from_last).T).T
        return self._joined(first, rest, last, right)

    def back_substitute(self, reduced_right: FloatArray) -> FloatArray:
        """Return the solution (n,) or (n, k) of L^T x = c."""
        first, middle, last = self._parts(reduced_right)
        middle = solve_lower(self.middle, middle.T, transposed=True).T
        tasks = partial(self.first.substituted, first, middle), partial(self.last.substituted, last, middle)
        first, last = self._at_once(tasks, first.size)
        return self._joined(first, middle, last, reduced_right)

    def inverse(self) -> FloatArray:
        """Return the inverse within the band (n, w + 1)."""
        width, count = self.first.band.shape[1] - 1, len(self.first.band)
        result = np.zeros((len(self.first.band) + len(self.middle) + len(self.last.band), width + 1))
        of_middle, _ = lapack.dpotri(self.middle, lower=1)
        of_middle = np.tril(of_middle) + np.tril(of_middle, -1).T
        middle = np.zeros((len(of_middle), len(of_middle) + width))
        middle[:, : len(of_middle)] = of_middle
        result[count : count + len(of_middle)] = stored_part(middle)
        # its columns reach into those of the middle, which have nothing there
        last = from_the_end(result, len(self.last.band))
        tasks = (
            partial(self.first.put_inverse, of_middle, result[:count]),
            partial(self.last.put_inverse, of_middle[::-1, ::-1], last),
        )
        self._at_once(tasks, width * count * PANEL)
        return result

    def _parts(self, vectors: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return copies of the vectors of both halves and the middle, (k, h) each; those of the last run backwards."""
        rows = np.atleast_2d(vectors.T)
        first, count = len(self.first.band), rows.shape[1]
        last = count - len(self.last.band)
        return rows[:, :first].copy(), rows[:, first:last].copy(), rows[:, last:][:, ::-1].copy()

    def _joined(self, first: FloatArray, middle: FloatArray, last: FloatArray, like: FloatArray) -> FloatArray:
        rows = np.hstack([first, middle, last[:, ::-1]])
        return rows.T.reshape(like.shape)

    def _at_once(self, tasks: tuple[Callable[[], T], Callable[[], T]], vectors: int) -> list[T]:
        return _both(tasks, float(vectors) * self.first.band.shape[1])


def factorise_from_both_ends(band: FloatArray) -> TwoEndedFactor | None:
    """Return the factor of a band (n, w + 1), n > w, in LAPACK's lower storage by columns; None if it has none."""
    count, width = len(band), band.shape[1] - 1
    first = (count - width) // 2
    # large arrays of a thread would be freed for that thread alone
    columns = band[:first], from_the_end(band, count - width - first)
    tasks = [partial(_half, part, np.empty((len(part) + width, width + 1))) for part in columns]
    forwards, backwards = _both(tasks, float(first) * width**2)
    if forwards is None or backwards is None:
        return None
    (one, of_one), (other, of_other) = forwards, backwards
    remaining = columns_of(band[first : first + width])[:, :width].T
    remaining -= of_one
    # the other half has the unknowns of the middle in the order in which it comes to them
    remaining -= of_other[::-1, ::-1]
    middle, info = lapack.dpotrf(remaining, lower=1, clean=1)
    other = replace(other, to_middle=other.to_middle[:, ::-1])
    return TwoEndedFactor(one, other, np.asarray(middle)) if info == 0 else None


def _half(columns: FloatArray, band: FloatArray) -> tuple[Half, FloatArray] | None:
    """Return the factor of the columns of a half (h, w + 1), and what it takes off the middle; None if it has none.

    The factor is made in an array `band` (h + w, w + 1).
    """
    count, width = len(columns), columns.shape[1] - 1
    band[:count] = columns
    # the columns before do not depend on what stands in the middle: it only has to have a factor
    band[count:] = 0.0
    band[count:, 0] = width + 1.0
    if factorise_in_place(band):
        return None
    coupled = min(width, count)
    to_middle = columns_of(band[count - coupled : count])[:, coupled:]
    return Half(band[:count], to_middle), to_middle.T @ to_middle


def _both(tasks: Sequence[Callable[[], T]], work: float) -> list[T]:
    """Return what two tasks of so many multiplications each return."""
    return at_once(tasks) if work >= _WORK_OF_A_THREAD and available_threads() > 1 else [task() for task in tasks]


# A full matrix of the same unknowns names the same ones as not determined (`orip.adjustment.factorisation.null_space`).


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
