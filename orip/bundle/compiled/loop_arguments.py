"""Matrices and movements as the compiled loop over photo points takes them."""

from __future__ import annotations

import numpy as np

from orip.adjustment.factorisation.band import Arrangement, BandMatrix
from orip.adjustment.factorisation.cholesky import Symmetric
from orip.adjustment.factorisation.null_space import Amounts, PointMovements
from orip.arrays import FloatArray

MOVEMENTS = 8
"""As MOST_MOVEMENTS of inner_constraints.h."""


def movements(points: PointMovements) -> tuple[object, ...]:
    """Return the arrays of the movements of points."""
    coefficients = np.zeros((3, 4, MOVEMENTS))
    coefficients[:, :, : points.coefficients.shape[1]] = np.swapaxes(points.coefficients, 1, 2)
    others = (np.ascontiguousarray(array) for array in (points.free, points.defining))
    return (np.ascontiguousarray(points.homogeneous), coefficients, *others)


def amounts_of(amounts: Amounts | None, arrangement: Arrangement) -> tuple[object, ...]:
    """Return the arrays of the amounts of movements, those of reduced unknowns in their places; empty without them."""
    nothing, no_flags = np.empty(0), np.empty(0, dtype=bool)
    if amounts is None:
        return nothing, nothing, no_flags, no_flags, nothing, nothing
    with_reduced = np.zeros((len(arrangement.places), MOVEMENTS))
    d = len(amounts.own)
    with_reduced[:, :d] = amounts.with_reduced[arrangement.columns]
    half_of_own = np.zeros(MOVEMENTS)
    half_of_own[:d] = amounts.own / 2.0
    return (*movements(amounts.points), with_reduced, half_of_own)


def whole(size: int) -> Arrangement:
    """Return the arrangement of a full matrix."""
    return Arrangement(np.arange(size), size, size)


def stored(matrix: Symmetric) -> tuple[FloatArray, FloatArray]:
    """Return band and border of a matrix; a full one is a band alone."""
    found = (matrix.band, matrix.border) if isinstance(matrix, BandMatrix) else (matrix, np.empty(0))
    return np.ascontiguousarray(found[0]), np.ascontiguousarray(found[1])


def measures(matrix: Symmetric) -> tuple[int, int, int]:
    """Return the stride of columns in memory, the number of banded places and the number of all."""
    size = len(matrix)
    if isinstance(matrix, BandMatrix):
        return matrix.arrangement.width, matrix.arrangement.banded, size
    return size, size, size
