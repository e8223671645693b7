"""Cholesky factorisation of a wide band whose columns reach down to different places: its envelope.

Elimination fills no column beyond the last place that it, or one before it, is coupled with (Jennings 1966). Columns go
panel by panel; all within a panel reach equally far, so that each panel is a full matrix.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from msgspec import Struct
from scipy.linalg import lapack

from orip.adjustment.factorisation.lapack import (
    eliminate_panel,
    solve_panel,
    symmetric_times,
    transposed_solve_panel,
)
from orip.arrays import FloatArray, IntArray

COLUMNS = 128
"""Columns of a panel: with so many a product of matrices takes far longer than fetching them from memory."""


class Panel(NamedTuple):
    """Columns from `start` on to that before `end`, whose rows go on to that before `reach`."""

    start: int
    end: int
    reach: int


def panels_of(reach: IntArray) -> list[Panel]:
    """Return the panels of columns that reach (n,) down to the place before a given one each."""
    borders = [*range(0, len(reach), COLUMNS), len(reach)]
    return [Panel(start, end, int(reach[end - 1])) for start, end in pairwise(borders)]


def reach_of_panels(last: IntArray) -> IntArray:
    """Return how far columns (n,) reach in panels.

    Parameters
    ----------
    last : array (n,) of int
        Last place that each column is coupled with.
    """
    count = len(last)
    farthest = np.maximum.accumulate(np.maximum(last, np.arange(count))) + 1
    ends = np.minimum(np.arange(count) // COLUMNS * COLUMNS + COLUMNS, count)
    return np.asarray(farthest[ends - 1])


def width_of(reach: IntArray) -> int:
    """Return the width of a band in whose storage the panels are matrices of LAPACK, with columns so far apart."""
    return max(panel.reach - panel.start for panel in panels_of(reach))


def effort_of(reach: IntArray) -> float:
    """Return the multiplications that the factorisation takes; a full matrix takes a sixth of its size cubed."""
    effort = 0.0
    for start, end, last in panels_of(reach):
        columns, below = end - start, last - end
        effort += columns**3 / 6.0 + columns * below * (columns + below) / 2.0
    return effort


class EnvelopeFactor(Struct, frozen=True):
    """The Cholesky factor of a band (n, w + 1).

    Parameters
    ----------
    band : array (n, w + 1)
        L by columns, as far as these reach.
    reach : array (n,) of int
        The place after the last one of each column.
    """

    band: FloatArray
    reach: IntArray

    @property
    def diagonal(self) -> FloatArray:
        """Return the diagonal (n,) of the factor."""
        return self.band[:, 0]

    def reduce(self, right: FloatArray) -> FloatArray:
        """Return c = L^-1 right for right-hand sides (n,) or (n, k)."""
        vectors = _rows_of(right)
        for panel in panels_of(self.reach):
            solve_panel(self.band, *panel, vectors)
        return vectors.T.reshape(right.shape)

    def back_substitute(self, reduced_right: FloatArray) -> FloatArray:
        """Return the solution (n,) or (n, k) of L^T x = c."""
        vectors = _rows_of(reduced_right)
        for panel in reversed(panels_of(self.reach)):
            transposed_solve_panel(self.band, *panel, vectors)
        return vectors.T.reshape(reduced_right.shape)

    def inverse(self) -> FloatArray:
        """Return the inverse (n, w + 1) as far as columns reach.

        Takahashi's recursion (1973), panel by panel from the last one: below a panel with L = (D; E) the inverse is
        Z G with G = -E D^-1 and the part Z that is known already, and the panel's own is D^-T D^-1 + G^T Z G.
        """
        result = np.zeros_like(self.band)
        for start, end, reach in reversed(panels_of(self.reach)):
            inverse, _ = lapack.dtrtri(_rectangle(self.band, start, end, start, end).T, lower=1)
            inverse = np.tril(inverse)
            multiplier = -_rectangle(self.band, start, end, end, reach).T @ inverse
            below = symmetric_times(result, end, multiplier)
            own = inverse.T @ inverse + multiplier.T @ below
            _rectangle(result, start, end, end, reach)[:] = below.T
            square = _rectangle(result, start, end, start, end)
            np.copyto(square, own, where=np.triu(np.ones(own.shape, dtype=bool)))
        return result


def factorise_envelope(band: FloatArray, reach: IntArray) -> EnvelopeFactor | None:
    """Return the factor of a band (n, w + 1) in LAPACK's lower storage by columns; None if it has none.

    Parameters
    ----------
    band : array (n, w + 1)
        Its width is that of `width_of`, or larger.
    reach : array (n,) of int
        As `reach_of_panels` returns it.
    """
    factor = np.empty_like(band)
    for start, end, last in panels_of(reach):
        factor[start:end, : last - start] = band[start:end, : last - start]
    for panel in panels_of(reach):
        if eliminate_panel(factor, *panel):
            return None
    # not every LAPACK stops at a pivot that is not a number
    return EnvelopeFactor(factor, reach) if np.isfinite(factor[:, 0]).all() else None


def _rows_of(vectors: FloatArray) -> FloatArray:
    """Return a copy (k, n) of vectors (n,) or (n, k)."""
    return np.array(np.atleast_2d(vectors.T), order="C")


def _rectangle(band: FloatArray, start: int, end: int, first: int, last: int) -> FloatArray:
    """Return a view (end - start, last - first) of columns of a band from row `first` on to that before `last`.

    What stands above the diagonal belongs to other columns.
    """
    stride = band.shape[1] - 1
    elements = band.reshape(-1)[start * stride + first :]
    return np.lib.stride_tricks.as_strided(elements, (end - start, last - first), (8 * stride, 8))
