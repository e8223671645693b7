"""Which control points agree with each other, as far as the rays let them: wrong ones may carry the datum at first.

Rays alone say where control points are up to a datum that is nearly free. The differences e between their given and
these coordinates have the cofactors V of both, in which the datum is a large common part. A few control points fix it:
the others are then expected where V says, e_j - V_jS V_SS^-1 e_S, with V_jj - V_jS V_SS^-1 V_Sj (conditional normal
distribution; Mardia, Kent and Bibby 1979, *Multivariate analysis*, section 3.2). A block may bend as much as its rays
allow, which a similarity of the points would take for errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from orip.arrays import BoolArray, FloatArray, IntArray
from orip.prelim.sampling import subsets

_CARRYING = 3
"""Control points that fix a datum."""

_HYPOTHESES = 200
"""Sets of three that are tried: with half of the points wrong, one in eight is right."""

_ROUNDS = 10


class ControlDifferences(NamedTuple):
    """Given minus predicted coordinates of m control points, divided by the a-priori errors of the given ones.

    Attributes
    ----------
    difference : array (k,)
    cofactor : array (k, k)
        Of the prediction alone.
    places : sequence of m arrays of int
        The rows of each control point.
    """

    difference: FloatArray
    cofactor: FloatArray
    places: Sequence[IntArray]


def agreeing_control(found: ControlDifferences, limits: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Return the largest set of control points that agree with each other.

    Parameters
    ----------
    found : ControlDifferences
    limits : array (m,)
        Largest root of the square sum of a control point that fits; it depends on the number of its coordinates.

    Returns
    -------
    agrees : array (m,) of bool
        All False with fewer than three control points.
    misfit : array (m,)
        Root of the square sum by which each differs from what those that agree predict.
    """
    count = len(found.places)
    if count < _CARRYING:
        return np.zeros(count, dtype=bool), np.zeros(count)
    best, least = np.zeros(count, dtype=bool), np.inf
    for chosen in subsets(count, _CARRYING, _HYPOTHESES):
        carries = np.zeros(count, dtype=bool)
        carries[chosen] = True
        # one that fits badly costs no more than one that just does not fit
        cost = float(np.sum(np.minimum(misfits(found, carries) / limits, 1.0) ** 2))
        if cost < least:
            best, least = carries, cost
    return _settled(found, best, limits)


def _settled(found: ControlDifferences, carries: BoolArray, limits: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Let all that fits carry the datum, and take the worst that does not out, until nothing changes."""
    for _ in range(_ROUNDS):
        misfit = misfits(found, carries)
        grown: BoolArray = carries | (misfit <= limits)
        while grown.sum() > _CARRYING:
            misfit = misfits(found, grown)
            inside = np.where(grown, misfit / limits, 0.0)
            if inside.max() <= 1.0:
                break
            grown[int(np.argmax(inside))] = False
        if (grown == carries).all():
            break
        carries = grown
    return carries, misfits(found, carries)


def misfits(found: ControlDifferences, carries: BoolArray) -> FloatArray:
    """Return how far each control point (m,) is from what those that carry the datum predict of it.

    One that carries it is compared with what the others that do predict.
    """
    covariance = found.cofactor + np.eye(len(found.difference))
    rows = np.concatenate([found.places[place] for place in np.flatnonzero(carries).tolist()])
    inverse = np.linalg.inv(covariance[np.ix_(rows, rows)])
    weighted = inverse @ found.difference[rows]
    across = covariance[:, rows]
    left, spread = found.difference - across @ weighted, covariance - across @ inverse @ across.T
    result, first = np.zeros(len(found.places)), 0
    for place, of_point in enumerate(found.places):
        if carries[place]:
            own = slice(first, first + len(of_point))
            first = own.stop
            square = weighted[own] @ np.linalg.solve(inverse[own, own], weighted[own])
        else:
            square = left[of_point] @ np.linalg.solve(spread[np.ix_(of_point, of_point)], left[of_point])
        result[place] = np.sqrt(max(float(square), 0.0))
    return result
