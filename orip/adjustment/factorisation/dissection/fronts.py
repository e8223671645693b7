"""Elimination at one node: its front is formed, factored, and reduced to its border.

With the own unknowns first a front is (A, B^T; B, C). Its factor has L with L L^T = A and E = B L^-T, and what remains
for the nodes above is C - E E^T.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import lapack, solve_triangular

from orip.arrays import FloatArray, IntArray


class Shape(NamedTuple):
    """A node as its front needs it: the number of its own unknowns, and places of its children's borders in it."""

    own: int
    children: tuple[IntArray, ...]


class FrontScale(NamedTuple):
    """What is done to the equations of a node before they are factored.

    Attributes
    ----------
    factors : array (f,)
        Of rows and columns of the front; 0 for unknowns that are removed.
    added : array (o,)
        To the diagonal of its own unknowns.
    """

    factors: FloatArray
    added: FloatArray


class FrontFactor(NamedTuple):
    """Factor of a front: L (o, o) and E (r, o)."""

    lower: FloatArray
    below: FloatArray


def eliminate_front(
    matrix: FloatArray, shape: Shape, scale: FrontScale, *of_children: FloatArray | None
) -> tuple[FrontFactor | None, FloatArray | None]:
    """Return the factor of a front and what remains for the border (r, r); None where it has no factor.

    Parameters
    ----------
    matrix : array (f, f)
        What the node's own observations add to the normal equations.
    shape : Shape
    scale : FrontScale
    of_children : arrays or None
        What remained of the children's fronts.
    """
    remainders = [remainder for remainder in of_children if remainder is not None]
    if len(remainders) < len(of_children):
        return None, None
    front = matrix * scale.factors * scale.factors[:, None]
    # what is not finite has no part in anything either
    removed = scale.factors == 0.0
    front[removed], front[:, removed] = 0.0, 0.0
    for places, remainder in zip(shape.children, remainders, strict=True):
        front[np.ix_(places, places)] += remainder
    own = shape.own
    front[np.arange(own), np.arange(own)] += scale.added
    if not own:
        return FrontFactor(np.zeros((0, 0)), np.zeros((len(front), 0))), front
    if not np.isfinite(front).all():
        return None, None
    lower, info = lapack.dpotrf(front[:own, :own], lower=1, clean=1)
    if info != 0:
        return None, None
    below = solve_triangular(lower, front[own:, :own].T, lower=True).T
    return FrontFactor(np.asarray(lower), np.asarray(below)), front[own:, own:] - below @ below.T


def pivots_of(factor: FrontFactor | None) -> FloatArray | None:
    """Return the diagonal (o,) of L; None where there is no factor."""
    return None if factor is None else np.diag(factor.lower).copy()


def reduce_front(
    factor: FrontFactor, shape: Shape, right: FloatArray, *of_children: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return c = L^-1 b (o, k) of right-hand sides (o, k), and what they add to those of the border (r, k)."""
    own = shape.own
    front = np.zeros((own + len(factor.below), right.shape[1]))
    front[:own] = right
    for places, added in zip(shape.children, of_children, strict=True):
        front[places] += added
    reduced = solve_triangular(factor.lower, front[:own], lower=True) if own else front[:0]
    return np.asarray(reduced), np.asarray(front[own:] - factor.below @ reduced)


def substitute_front(
    factor: FrontFactor, shape: Shape, reduced: FloatArray, of_border: FloatArray | None
) -> tuple[FloatArray, list[FloatArray]]:
    """Return the own unknowns (o, k) from c (o, k) and those of the border (r, k), and the children's borders."""
    border = np.zeros((0, reduced.shape[1])) if of_border is None else of_border
    rest = reduced - factor.below.T @ border
    own = solve_triangular(factor.lower, rest, lower=True, trans="T") if shape.own else rest
    front = np.vstack([own, border])
    return np.asarray(own), [front[places] for places in shape.children]


def invert_front(
    factor: FrontFactor, shape: Shape, of_border: FloatArray | None
) -> tuple[FloatArray, list[FloatArray]]:
    """Return the inverse of the whole matrix in the places of a front (f, f), and those of its children's borders.

    With G = -E L^-1 and the inverse Z of the border it is (L^-T L^-1 + G^T Z G, G^T Z; Z G, Z): Takahashi's recursion
    (1973) by fronts.
    """
    own = shape.own
    border = np.zeros((0, 0)) if of_border is None else of_border
    inverse = solve_triangular(factor.lower, np.eye(own), lower=True) if own else np.zeros((0, 0))
    multiplier = -factor.below @ inverse
    below = border @ multiplier
    found = np.empty((own + len(border),) * 2)
    found[:own, :own] = inverse.T @ inverse + multiplier.T @ below
    found[own:, :own], found[:own, own:], found[own:, own:] = below, below.T, border
    return found, [found[np.ix_(places, places)] for places in shape.children]


def front_times(matrix: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return the equations of a node times vectors (f, k)."""
    return np.asarray(matrix @ vectors)


def is_finite(matrix: FloatArray) -> bool:
    """Return whether all elements are numbers."""
    return bool(np.isfinite(matrix).all())


def elements(matrix: FloatArray, rows: IntArray, columns: IntArray) -> FloatArray:
    """Return some elements of a front."""
    return np.asarray(matrix[rows, columns])


def own_rows(matrix: FloatArray, count: int) -> FloatArray:
    """Return the rows of the own unknowns."""
    return np.ascontiguousarray(matrix[:count])


def adjusted_front(matrix: FloatArray, factors: FloatArray, left: FloatArray, right: FloatArray) -> FloatArray:
    """Return a front with rows and columns multiplied by factors (f,), less L R^T of matrices (f, k)."""
    return np.asarray(matrix * factors * factors[:, None] - left @ right.T)
