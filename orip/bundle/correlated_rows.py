"""Observations whose errors are correlated: their equations are decorrelated by the Cholesky factor of the covariance.

With the covariance C = L L^T of the observations the equations L^-1 v have independent errors (Strang and Borre 1997,
*Linear algebra, geodesy, and GPS*, pages 400 to 403). What is disregarded or left out comes last in the order, so that
the equations of the others are those of their own covariance.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from msgspec import Struct

from orip.arrays import BoolArray, FloatArray, IntArray


class CorrelatedRows(Struct, frozen=True):
    """k equations of observations with correlated errors.

    Parameters
    ----------
    rows : array (k,) of int
        Among those of their kind.
    correlation : array (k, k)
        Coefficients of the errors; the unit matrix where an observation is disregarded.
    whitening : array (k, k)
        From residuals, divided by their a-priori errors, to those of the equations, likewise divided.
    """

    rows: IntArray
    correlation: FloatArray
    whitening: FloatArray


def correlated_rows(rows: IntArray, correlation: FloatArray, used: BoolArray) -> CorrelatedRows:
    """Return the equations of observations, of which some are used (k,)."""
    both = used[:, None] & used
    effective = np.where(both, correlation, np.eye(len(rows)))
    return CorrelatedRows(rows, effective, whitening_of(effective, np.zeros(len(rows), dtype=bool)))


def rows_of_members(
    member: IntArray, axis: IntArray, error: FloatArray, whitening: FloatArray
) -> tuple[CorrelatedRows, ...]:
    """Return the equations of what has several components, such as stations, where their errors are correlated.

    Parameters
    ----------
    member, axis : arrays (n,) of int
        Which of the m, and which of its k components, an equation is of.
    error : array (n,)
        A-priori errors.
    whitening : array (m, k, k)
        From residuals of the components to those of the equations, in the same unit.
    """
    found = []
    for number in np.flatnonzero((whitening != np.eye(whitening.shape[1])).any(axis=(1, 2))):
        rows = np.flatnonzero(member == number)
        if len(rows) > 1:
            at = axis[rows]
            standard = whitening[number][np.ix_(at, at)] * error[rows] / error[rows, None]
            root = np.linalg.inv(standard)
            found.append(CorrelatedRows(rows, root @ root.T, standard))
    return tuple(found)


def whitening_of(correlation: FloatArray, last: BoolArray) -> FloatArray:
    """Return L^-1 of coefficients (k, k), with some observations (k,) after all others, in the given order of rows."""
    order = np.argsort(last, kind="stable")
    factor = np.linalg.cholesky(correlation[np.ix_(order, order)])
    found = np.empty_like(correlation)
    found[np.ix_(order, order)] = np.linalg.inv(factor)
    return found


def with_last(groups: Sequence[CorrelatedRows], last: BoolArray) -> tuple[CorrelatedRows, ...]:
    """Return the equations with some observations (all rows of their kind,) after the others of their group."""
    return tuple(
        CorrelatedRows(group.rows, group.correlation, whitening_of(group.correlation, last[group.rows]))
        for group in groups
    )


def decorrelated(groups: Sequence[CorrelatedRows], error: FloatArray, residual: FloatArray) -> FloatArray:
    """Return the residuals (n,) of equations from those of observations; both are in the unit of the errors (n,)."""
    found = residual.copy()
    for group in groups:
        found[group.rows] = error[group.rows] * (group.whitening @ (residual[group.rows] / error[group.rows]))
    return found


def as_observed(groups: Sequence[CorrelatedRows], error: FloatArray, residual: FloatArray) -> FloatArray:
    """Return the residuals (n,) of observations from those of equations: the inverse of `decorrelated`."""
    found = residual.copy()
    for group in groups:
        standard = np.linalg.solve(group.whitening, residual[group.rows] / error[group.rows])
        found[group.rows] = error[group.rows] * standard
    return found
