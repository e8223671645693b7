"""Tests of observations whose errors are correlated with those of others, each by what its own error would do.

An error of one observation acts on the decorrelated equations of its whole group, along a column of the whitening
matrix. Leaving the observation out is the same as estimating that error (the mean shift model), so that these
directions take the place of its rows: with directions D, orthonormal for each point, residuals D^T v, and cofactors
I - D^T (I - H) D, all formulas for independent observations hold.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from orip.adjustment.residual_sums import JointEffects
from orip.arrays import BoolArray, FloatArray, IntArray
from orip.bundle.correlated_rows import CorrelatedRows
from orip.bundle.kinds.observation import Observations
from orip.structs import replace


def correlated_groups(observations: Sequence[Observations]) -> list[CorrelatedRows]:
    """Return the groups of correlated observations of a block, their rows among all of it."""
    return list(_among_all(observations))


def _among_all(observations: Sequence[Observations]) -> Iterator[CorrelatedRows]:
    first = 0
    for kind in observations:
        for group in kind.correlations():
            yield replace(group, rows=first + group.rows)
        first += len(kind.rows.error)


def with_their_groups(groups: Sequence[CorrelatedRows], rows: IntArray) -> IntArray:
    """Return rows (k,) in ascending order, with all of the groups that they belong to."""
    touched = [group.rows for group in groups if np.isin(group.rows, rows).any()]
    return np.unique(np.concatenate([rows, *touched])) if touched else rows


def in_directions(
    groups: Sequence[CorrelatedRows], every: IntArray, effects: JointEffects, places: Sequence[IntArray], rows: IntArray
) -> JointEffects:
    """Return the effects of rows (k,) from those of all rows of their groups, each along the error of its observation.

    Parameters
    ----------
    every : array (c,) of int
        Rows that the effects are of, as `with_their_groups` returns them.
    places : sequence of arrays of int
        Those among `rows` of what is left out together.
    rows : array (k,) of int
    """
    directions = np.zeros((len(every), len(rows)))
    directions[np.searchsorted(every, rows), np.arange(len(rows))] = 1.0
    for group in groups:
        at = np.searchsorted(every, group.rows) if np.isin(group.rows, rows).any() else np.zeros(0, dtype=np.int64)
        if not len(at):
            continue
        used = effects.in_use[at]
        for own in places:
            if np.isin(rows[own], group.rows).all() and effects.in_use[np.searchsorted(every, rows[own])].all():
                shift = group.whitening[:, np.searchsorted(group.rows, rows[own])] * used[:, None]
                directions[:, own] = 0.0
                directions[np.ix_(at, own)] = np.linalg.qr(shift)[0]
    gram = directions.T @ directions
    return JointEffects(
        directions.T @ effects.residual,
        directions.T @ effects.cofactor @ directions - (gram - np.eye(len(rows))),
        effects.in_use[np.searchsorted(every, rows)],
    )


def size_of_errors(
    group: CorrelatedRows, rows: IntArray, residual: FloatArray, cofactor: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the estimated errors (k,) of observations left out, and their deviations, both over the a-priori errors.

    Parameters
    ----------
    group : CorrelatedRows
        With these observations after the others.
    rows : array (k,) of int
        All of the group that are left out.
    residual, cofactor : arrays (k,) and (k, k)
        Of the equations.
    """
    own = np.searchsorted(group.rows, rows)
    factor = np.linalg.inv(group.whitening[np.ix_(own, own)])
    covariance = factor @ (np.eye(len(own)) + cofactor) @ factor.T
    return -factor @ residual, np.sqrt(np.diag(covariance))


def are_correlated(groups: Sequence[CorrelatedRows], hypotheses: Sequence[Sequence[int]], count: int) -> BoolArray:
    """Return which hypotheses (u,) are of observations correlated with others beside them."""
    number, size = np.full(count, -1), np.array([len(group.rows) for group in groups], dtype=np.int64)
    for place, group in enumerate(groups):
        number[group.rows] = place
    return np.array([number[rows[0]] >= 0 and size[number[rows[0]]] > len(rows) for rows in hypotheses], dtype=bool)
